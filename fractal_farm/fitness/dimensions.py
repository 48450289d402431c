"""The fractal dimensions of a cloud: D0, D2 and the pair counts behind it (NOTES, 'Fitness').

A cloud is turned into its own frame, sorted along the Morton curve once for each grid, box-counted, and pair-counted
in that order: all pairs up to `ALL_PAIRS` points, those of a sample of reference points beyond. The same kernel serves
single clouds here and batches of genomes in `evaluation`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.fitness.capacity import BoxWorkspace, box_dimension, new_box_workspace
from fractal_farm.fitness.cloud_frame import FrameWorkspace, fit_frame, new_frame_workspace
from fractal_farm.fitness.correlation import SlopeWorkspace, correlation_slope, new_slope_workspace
from fractal_farm.fitness.morton import gather, sort_by_key
from fractal_farm.fitness.octave_counter import N_BINS
from fractal_farm.fitness.pair_counting import PairWorkspace, count_pairs, new_pair_workspace
from fractal_farm.fitness.points import as_cloud
from fractal_farm.fitness.reference_pairs import ReferenceWorkspace, count_reference_pairs, new_reference_workspace
from fractal_farm.ifs.kernel import kernel

ALL_PAIRS = 20_000  # points of the largest cloud of which D2 takes all pairs


class CloudWorkspace(NamedTuple):
    """Memory for measuring clouds of n points, one after the other.

    Attributes:
        frame: for the principal axes.
        coordinates: (3, n) float32, the cloud in its frame.
        boxes: for the box counts.
        pairs: for the pair counts; `pairs.points` holds the cloud in Morton order after `measure`.
        references: for a sample of them.
        slope: for the fit of D2.
        counts: (16,) int64 pair counts of the cloud measured last.
    """

    frame: FrameWorkspace
    coordinates: npt.NDArray[np.float32]
    boxes: BoxWorkspace
    pairs: PairWorkspace
    references: ReferenceWorkspace
    slope: SlopeWorkspace
    counts: npt.NDArray[np.int64]


def new_cloud_workspace(n: int) -> CloudWorkspace:
    """Working space for clouds of n points."""
    return CloudWorkspace(
        new_frame_workspace(),
        np.empty((3, n), np.float32),
        new_box_workspace(n),
        new_pair_workspace(n),
        new_reference_workspace(),
        new_slope_workspace(),
        np.zeros(N_BINS, np.int64),
    )


def capacity_dimension(points: npt.ArrayLike) -> float:
    """Capacity dimension D0 of a cloud, by box counting in its principal frame.

    Args:
        points: (n, 3) real array, n >= 2.

    Returns:
        D0 in [0, 3]; 0 if all points are equal to 1e-9 of their coordinates.

    Raises:
        InputError: the points are not an (n, 3) table of finite numbers.
    """
    return measured(points)[0]


def correlation_dimension(points: npt.ArrayLike) -> float:
    """Correlation dimension D2 of a cloud, from exact pair counts (Grassberger and Procaccia 1983).

    Args:
        points: (n, 3) real array, n >= 2.

    Returns:
        D2 in [0, 3]; 0 if all points are equal to 1e-9 of their coordinates, or too few are close.

    Raises:
        InputError: the points are not an (n, 3) table of finite numbers.
    """
    return measured(points)[1]


def pair_counts(points: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Pairs of points in octaves of squared distance.

    Distances are in units of the longest side of the cloud's bounding box in its own frame, and computed in float32.
    The counts are exact, for any number of points: the same for every instruction set.

    Args:
        points: (n, 3) real array, n >= 2.

    Returns:
        (16,) int64: [0] pairs with d^2 < 2^-20, [k] those with 2^(k-21) <= d^2 < 2^(k-20) up to k = 14, [15] the
        rest; their sum is n (n - 1) / 2. All pairs are in [0] if the cloud is a single point.

    Raises:
        InputError: the points are not an (n, 3) table of finite numbers.
    """
    cloud = as_cloud(points)
    work = new_cloud_workspace(cloud.shape[1])
    _count_all_pairs(cloud, work)
    return work.counts


@kernel
def _count_all_pairs(cloud, work):  # type: ignore[no-untyped-def]
    n = cloud.shape[1]
    if not fit_frame(cloud, work.frame, work.coordinates):
        work.counts[0] = n * (n - 1) // 2
        return
    sort_by_key(work.coordinates, n, np.float32(1.0), work.boxes.morton)
    gather(work.coordinates, work.boxes.morton.keys, n, work.pairs.points)
    count_pairs(work.pairs, n, True, work.counts)


def measured(points: npt.ArrayLike) -> tuple[float, float, float, float]:
    """D0, D2 and the standard errors of their slopes, of a validated cloud."""
    cloud = as_cloud(points)
    d0, d2, d0_error, d2_error = measure(cloud, new_cloud_workspace(cloud.shape[1]))
    return float(d0), float(d2), float(d0_error), float(d2_error)


@kernel
def measure(cloud, work):  # type: ignore[no-untyped-def]
    """D0, D2 and the standard errors of their slopes; leaves the pair counts in work.counts.

    They are all 0 if the cloud is a single point, and so are the counts.

    Args:
        cloud: (3, n) float64, finite; overwritten.
        work: `CloudWorkspace` for n points.
    """
    n = cloud.shape[1]
    work.counts[:] = 0
    if not fit_frame(cloud, work.frame, work.coordinates):
        return 0.0, 0.0, 0.0, 0.0
    d0, d0_error = box_dimension(work.coordinates, n, work.boxes)
    gather(work.coordinates, work.boxes.morton.keys, n, work.pairs.points)
    if n <= ALL_PAIRS:
        count_pairs(work.pairs, n, True, work.counts)
    else:
        count_reference_pairs(work.pairs, n, work.references, work.counts)
    d2, d2_error = correlation_slope(work.counts, work.slope)
    return d0, d2, d0_error, d2_error
