"""One design from its genome again: the same cloud to the bit, the same scores?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from fractal_farm.catalogue.clouds import CloudArrays
from fractal_farm.catalogue.formula import formula_of_row
from fractal_farm.catalogue.layout import crc32c
from fractal_farm.catalogue.reader import Catalogue
from fractal_farm.catalogue.rows import genome_of
from fractal_farm.catalogue.verify.content import recomputed
from fractal_farm.errors import FarmError
from fractal_farm.ifs.quantised_cloud import quantised_attractors
from fractal_farm.ifs.random_iteration import GENERATOR_VERSION


@dataclass(frozen=True)
class Quantity:
    """Something that the catalogue holds, and what its genome gives here and now.

    Attributes:
        name: a column of the manifest, or "stored points".
        recorded: its value in the catalogue; of stored points their checksum.
        again: the value computed now.
        same: whether they are equal to the bit.
    """

    name: str
    recorded: Any
    again: Any
    same: bool


@dataclass(frozen=True)
class Reproduction:
    """A design, computed again.

    Attributes:
        design_id: 32 hex digits.
        n_points: points of its cloud; 0 for an ancestor, which has none.
        quantities: all that was compared.
    """

    design_id: str
    n_points: int
    quantities: list[Quantity]

    @property
    def same(self) -> bool:
        """Whether everything is equal to the bit."""
        return all(quantity.same for quantity in self.quantities)


def reproduce(catalogue: Catalogue, design_id: str) -> Reproduction:
    """Grow the cloud of a design again and score it again.

    Args:
        catalogue: that holds it.
        design_id: 32 hex digits, or the first four or more.

    Raises:
        InputError: no such design, or several.
        FarmError: the manifest or the stored cloud is missing or damaged, the genome is not the one that the
            design_id stands for, or another version of the random iteration grew it.
    """
    row = catalogue.design(design_id)
    genome = genome_of(row)
    if row["generator_version"] != GENERATOR_VERSION:
        raise FarmError(
            f"design {row['design_id']}: grown by generator {row['generator_version']}, this is {GENERATOR_VERSION}; "
            "reproduce it with the version that grew it"
        )
    formula = formula_of_row(catalogue.path, row)
    quantities = _cloud(catalogue, row) if row["cloud_crc32c"] is not None else []
    for name, value in recomputed([row], [genome], formula)[0].items():
        same = np.array_equal(np.array(row[name], np.float64), np.array(value, np.float64), equal_nan=True)
        quantities.append(Quantity(name, row[name], value, same))
    return Reproduction(row["design_id"], row["n_points"] or 0, quantities)


def _cloud(catalogue: Catalogue, row: dict[str, Any]) -> list[Quantity]:
    grown = quantised_attractors([genome_of(row)], row["n_points"])[0]
    sums, origin, scale = _checksum(grown.points), grown.origin.tolist(), float(grown.scale)
    found = [
        Quantity("cloud_crc32c", row["cloud_crc32c"], sums, row["cloud_crc32c"] == sums),
        Quantity("origin", row["origin"], origin, row["origin"] == origin),
        Quantity("scale", row["scale"], scale, row["scale"] == scale),
    ]
    if row["cloud_row"] is not None:
        stored = CloudArrays(catalogue.path).read(row["writer"], row["cloud_array"], np.array([row["cloud_row"]]))[0]
        found.append(Quantity("stored points", _checksum(stored), sums, bool(np.array_equal(stored, grown.points))))
    return found


def _checksum(points: npt.NDArray[np.uint16]) -> int:
    return crc32c(points.astype("<u2", copy=False).tobytes())
