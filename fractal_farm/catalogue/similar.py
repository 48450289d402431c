"""What looks like a design: the nearest by signature, each checked by laying its cloud upon the one that is asked for.

The signatures of a million designs are looked at in milliseconds, but unrelated ones may coincide; so the clouds of the
few nearest are grown and aligned (`likeness`), and by that distance the hits are ordered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fractal_farm.catalogue.rows import GENOME_COLUMNS, genome_of
from fractal_farm.catalogue.signatures import SignatureIndex
from fractal_farm.distinctness import DISTINCT, signatures
from fractal_farm.errors import InputError
from fractal_farm.fitness import evaluate
from fractal_farm.fitness.evaluation import POINTS
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.random_iteration import attractor_points
from fractal_farm.likeness import SAME_SHAPE, aligned_distances

Cloud = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Similar:
    """A design that is like another.

    Attributes:
        design_id: 32 hex digits.
        distance: of the signatures, in units of what makes two designs distinct.
        aligned_distance: of the clouds, in radii of the shape, see `likeness.aligned_distance`.
        fitness: of the design.
        gap: of the design, over its longest side.
        n_maps: number of its maps.
    """

    design_id: str
    distance: float
    aligned_distance: float
    fitness: float
    gap: float
    n_maps: int

    @property
    def same_shape(self) -> bool:
        """Whether the signatures are not distinct, and the clouds cover each other, mirror images included."""
        return self.distance < DISTINCT and self.aligned_distance < SAME_SHAPE


def similar_to_design(index: SignatureIndex, design_id: str, count: int) -> list[Similar]:
    """The designs that are most like one of the catalogue.

    Args:
        index: the signatures of the catalogue.
        design_id: 32 hex digits, or the first four or more.
        count: how many.

    Raises:
        InputError: no such design, several, or one without a descriptor.
        FarmError: a manifest part is missing or damaged.
    """
    own = index.find(design_id)
    mark = index.marks[:, own]
    if not np.isfinite(mark).all():
        raise InputError(f"design {index.design_id(own)} has no descriptor; ask with its genome in a file, --genome")
    found = [place for place in index.nearest(mark, count + 1).tolist() if place != own][:count]
    cloud, *clouds = _clouds(index, [own, *found])
    return _checked(index, mark, found, cloud, clouds)


def similar_to_genome(index: SignatureIndex, genome: Genome, count: int) -> list[Similar]:
    """The designs that are most like a genome, itself included if the catalogue holds it.

    Raises:
        InputError: a genome that cannot be scored.
        FarmError: a manifest part is missing or damaged.
    """
    scores = evaluate([genome])
    mark = signatures(scores.descriptor, scores.d0, scores.d2)[0]
    if not np.isfinite(mark).all():
        raise InputError(f"genome {genome.design_id}: its cloud has no shape to compare; give one that contracts")
    found = index.nearest(mark, count).tolist()
    return _checked(index, mark, found, attractor_points(genome, POINTS), _clouds(index, found))


def _checked(
    index: SignatureIndex, mark: npt.ArrayLike, found: Sequence[int], cloud: Cloud, clouds: Sequence[Cloud]
) -> list[Similar]:
    distances = index.distances(mark)
    hits = [
        Similar(
            index.design_id(place),
            float(distances[place]),
            float(aligned),
            float(index.fitness[place]),
            float(index.gap[place]),
            int(index.n_maps[place]),
        )
        for place, aligned in zip(found, aligned_distances(cloud, clouds), strict=True)
    ]
    return sorted(hits, key=lambda hit: (hit.aligned_distance, hit.design_id))


def _clouds(index: SignatureIndex, places: Sequence[int]) -> list[Cloud]:
    return [attractor_points(genome_of(row), POINTS) for row in index.rows(places, GENOME_COLUMNS)]
