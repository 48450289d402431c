"""`farm merge`: catalogues put together, with a picture of the best of all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fractal_farm.catalogue import merging, run_ids
from fractal_farm.catalogue.merging import Merged
from fractal_farm.catalogue.settings import read_settings
from fractal_farm.config import RunConfig
from fractal_farm.farm.sheet import write_sheet
from fractal_farm.farm.stopping import chosen_run


def merge(out: Path, sources: Sequence[Path]) -> Merged:
    """Put catalogues together in a new directory; see `catalogue.merging.merge`."""
    return merging.merge(out, sources, _draw)


def _draw(place: Path) -> None:
    if run_ids(place):
        settings = read_settings(place, chosen_run(place, None))
        write_sheet(place, RunConfig.from_dict(settings, f"{place}: run.json"), whole=True)
