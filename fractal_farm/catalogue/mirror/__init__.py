"""The mirror of a catalogue in an object store: a copy that is a sound catalogue at every instant.

`kept` copies what is new, in the order of dependence; `fetch` brings a catalogue back. Nothing in an object store is
written to in place, locked or listed by the farm's other parts: they work on directories.
"""

from fractal_farm.catalogue.mirror.fetch import Fetched, fetch
from fractal_farm.catalogue.mirror.keeping import LEASE_SECONDS, LeaseLostError, check_target, kept
from fractal_farm.catalogue.mirror.state import MIRROR_STATE, Backlog, read_state, write_state
from fractal_farm.catalogue.mirror.store import Store, StoreError
from fractal_farm.catalogue.mirror.upload import Uploader

__all__ = [
    "LEASE_SECONDS",
    "MIRROR_STATE",
    "Backlog",
    "Fetched",
    "LeaseLostError",
    "Store",
    "StoreError",
    "Uploader",
    "check_target",
    "fetch",
    "kept",
    "read_state",
    "write_state",
]
