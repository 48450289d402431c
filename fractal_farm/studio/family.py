"""The descent of a catalogue's designs, read when it is first asked for, and again when there are further designs."""

from __future__ import annotations

import threading
import time

from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue.layout import PartName
from fractal_farm.catalogue.lineage import Lineage, read_lineage
from fractal_farm.catalogue.parts import list_parts

_PATIENCE = 10.0  # a large catalogue that grows is read no more often than this times as long as it takes


class Family:
    """The lineage of a catalogue.

    Args:
        catalogue: whose.
    """

    def __init__(self, catalogue: Catalogue) -> None:
        self._catalogue = catalogue
        self._reading = threading.Lock()
        self._known: Lineage | None = None
        self._parts: list[PartName] = []
        self._until = 0.0

    def lineage(self) -> Lineage:
        """As it is now; of a large catalogue that grows, as it was not long ago."""
        with self._reading:
            parts = list_parts(self._catalogue.path)
            if self._known is None or (parts != self._parts and time.monotonic() > self._until):
                began = time.monotonic()
                self._known, self._parts = read_lineage(self._catalogue), parts
                now = time.monotonic()
                self._until = now + _PATIENCE * (now - began)
            return self._known
