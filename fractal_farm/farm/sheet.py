"""`catalogue.png`: the best designs of a run at a glance, different ones first.

The best of a library resemble each other. Designs are taken in the order of fitness, but one whose shape descriptor
lies close to one already taken waits until all others have had their turn.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow.compute as pc

from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue.durable import put
from fractal_farm.config import RunConfig
from fractal_farm.picture import design_sheet, encoded

COLUMNS = 6
ROWS = 5
_CONSIDERED = 2000


def write_sheet(root: Path, config: RunConfig, *, whole: bool = False) -> Path | None:
    """Draw the sheet of a run's best designs into its catalogue.

    Args:
        root: the catalogue.
        config: the run's configuration.
        whole: draw those of all runs.

    Returns:
        The picture's path, or None if there is no design yet.
    """
    catalogue = Catalogue.open(root)
    columns = ["design_id", "fitness", "descriptor"]
    best = catalogue.designs(columns, None if whole else config.run_id).slice(0, _CONSIDERED)
    if best.num_rows == 0:
        return None
    qualified = pc.sum(pc.greater(best.column("fitness"), config.evolution.qualified)).as_py()
    best = best.slice(0, max(qualified, COLUMNS * ROWS))
    descriptors = np.array(best.column("descriptor").to_pylist(), np.float64)
    chosen = different_first(descriptors, COLUMNS * ROWS)
    rows = best.select(["design_id", "fitness"]).take(chosen).to_pylist()
    designs = [(catalogue.genome(row["design_id"]), f"{row['design_id'][:8]}  {row['fitness']:.3f}") for row in rows]
    path = root / "catalogue.png"
    put(path, encoded(design_sheet(designs, columns=COLUMNS)), config.catalogue.durability)
    return path


def different_first(descriptors: npt.NDArray[np.float64], count: int) -> list[int]:
    """Indices of `count` rows, earlier ones preferred, close ones avoided.

    Args:
        descriptors: (n, k) float64, best first.
        count: how many to choose.

    Returns:
        At most `count` indices in increasing order: the largest of a falling series of radii decides at which enough
        rows are further apart than that.
    """
    if len(descriptors) <= count:
        return list(range(len(descriptors)))
    radius = float(np.ptp(descriptors, axis=0).max())
    while True:
        chosen: list[int] = []
        for index, descriptor in enumerate(descriptors):
            distances = np.linalg.norm(descriptors[chosen] - descriptor, axis=1)
            if len(chosen) == 0 or distances.min() > radius:
                chosen.append(index)
                if len(chosen) == count:
                    return chosen
        radius *= 0.8 if radius > 1e-9 else 0.0
        if radius == 0.0:
            return sorted({*chosen, *range(count)})[:count]
