"""Morphs: from one design to another by way of designs, each of which is a genome.

Rotations turn along the shortest way (slerp), ratios change geometrically, offsets in a straight line. Maps are paired
so that they change least. Where one design has fewer maps, some of its maps are told twice, which leaves its shape as
it is; each of the two then goes its own way.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from PIL import Image

from fractal_farm.errors import InputError
from fractal_farm.ifs.corresponding import corresponding_points
from fractal_farm.ifs.genome import RHO, Genome, as_genome
from fractal_farm.ifs.maps import resolved_maps
from fractal_farm.picture.cloud import cloud_picture
from fractal_farm.picture.colours import coloured, legible
from fractal_farm.picture.view import choose_view

FloatArray = npt.NDArray[np.float64]

N_POINTS = 20_000


def morph_genomes(first: Genome | npt.ArrayLike, second: Genome | npt.ArrayLike, frames: int) -> list[Genome]:
    """Genomes from one to another.

    Args:
        first: of similarity maps.
        second: of similarity maps, with the phenotype and the symmetry of the first.
        frames: number of genomes, 2 to 1000.

    Returns:
        The first has the shape of `first`, the last that of `second`; all have as many maps as the larger of the two,
        in corresponding order, and no probabilities set by hand.

    Raises:
        InputError: an invalid genome, or two that have nothing between them.
    """
    one, two = as_genome(first, "first genome"), as_genome(second, "second genome")
    if not 2 <= frames <= 1000:
        raise InputError(f"frames is {frames}; give 2 to 1000")
    if one.phenotype.family != "similarity" or one.phenotype != two.phenotype:
        raise InputError("a morph needs two designs of similarity maps and of one phenotype; choose others")
    if one.symmetry != two.symmetry:
        raise InputError(
            f"one design has symmetry {one.symmetry}, the other {two.symmetry}; choose two of one symmetry"
        )
    pairs = _pairs(one, two)
    starts, ends = one.genes[[a for a, _ in pairs]], two.genes[[b for _, b in pairs]]
    turns = resolved_maps(replace(one, genes=starts, probabilities=None))[:, :, :3] / starts[:, RHO, None, None]
    others = resolved_maps(replace(two, genes=ends, probabilities=None))[:, :, :3] / ends[:, RHO, None, None]
    genomes = []
    for share in morph_shares(frames):
        if share in (0.0, 1.0):
            genes = starts if share == 0.0 else ends
        else:
            genes = (1.0 - share) * starts + share * ends
            genes[:, RHO] = np.exp((1.0 - share) * np.log(starts[:, RHO]) + share * np.log(ends[:, RHO]))
            for k in range(len(pairs)):
                genes[k, :3] = one.phenotype.rotation_sign * _angles(slerp(turns[k], others[k], share))
        genomes.append(replace(one, genes=genes, probabilities=None))
    return genomes


def morph_shares(frames: int) -> list[float]:
    """How far each of the genomes of a morph lies on the way, 0 to 1: slow at both ends, where much changes."""
    return [0.5 - 0.5 * math.cos(math.pi * k / (frames - 1)) for k in range(frames - 1)] + [1.0]


def slerp(start: FloatArray, end: FloatArray, share: float) -> FloatArray:
    """The rotation (3, 3) that lies between two, at a share of the shortest way from the first."""
    from scipy.spatial.transform import Rotation

    way = Rotation.from_matrix(start.T @ end).as_rotvec()
    between: FloatArray = start @ Rotation.from_rotvec(share * way).as_matrix()
    return between


def morph_pictures(
    genomes: Sequence[Genome], size: int = 512, colouring: str = "gradient", n_points: int = N_POINTS
) -> list[Image.Image]:
    """Pictures of the genomes of a morph, each shape as large as its picture, seen from where each end looks best.

    Args:
        genomes: what `morph_genomes` returns.
        size: width and height of each, pixels.
        colouring: "gradient" or "dual".
        n_points: points of each, at most.

    Raises:
        InputError: arguments out of range.
    """
    if n_points < 100:
        raise InputError(f"points is {n_points}; draw at least 100")
    clouds = corresponding_points(genomes, n_points)
    first, last = choose_view(clouds[0]), choose_view(clouds[-1])
    pictures = []
    for share, points in zip(morph_shares(len(clouds)), clouds, strict=True):
        view = first if share == 0.0 else last if share == 1.0 else slerp(first.T, last.T, share).T
        colours = legible(coloured(points, colouring))
        pictures.append(Image.fromarray(cloud_picture(points, size, colours, view=view)))
    return pictures


def _pairs(one: Genome, two: Genome) -> list[tuple[int, int]]:
    """Rows of both that belong together, each row of both at least once, so that they change least in all."""
    count = max(one.n_maps, two.n_maps)
    costs = _costs(one, two)
    best: tuple[float, list[tuple[int, int]]] = (math.inf, [])
    from scipy.optimize import linear_sum_assignment

    few = min(one.n_maps, two.n_maps)
    for more in itertools.combinations_with_replacement(range(few), count - few):
        repeated = [*range(few), *more]
        table = costs[repeated] if one.n_maps == few else costs[:, repeated]
        rows, columns = linear_sum_assignment(table)
        total = float(table[rows, columns].sum())
        if total < best[0]:
            chosen = zip(rows.tolist(), columns.tolist(), strict=True)
            best = total, [(repeated[a], b) if one.n_maps == few else (a, repeated[b]) for a, b in chosen]
    return best[1]


def _costs(one: Genome, two: Genome) -> FloatArray:
    """How much each map of one (rows) differs from each of the other: angle, logarithm of the ratio, offset."""
    starts, ends = (resolved_maps(genome)[:, :, :3] / genome.genes[:, RHO, None, None] for genome in (one, two))
    cosines = (np.einsum("aij,bij->ab", starts, ends) - 1.0) / 2.0
    ratios = np.log(one.genes[:, None, RHO] / two.genes[None, :, RHO])
    offsets = np.linalg.norm(one.genes[:, None, RHO + 1 :] - two.genes[None, :, RHO + 1 :], axis=2)
    costs: FloatArray = np.arccos(np.clip(cosines, -1.0, 1.0)) + np.abs(ratios) + offsets
    return costs


def _angles(rotation: FloatArray) -> FloatArray:
    """Pitch, yaw and roll of R = R_z(roll) R_x(pitch) R_y(yaw)."""
    pitch = math.asin(min(1.0, max(-1.0, float(rotation[2, 1]))))
    roll = math.atan2(-float(rotation[0, 1]), float(rotation[1, 1]))
    yaw = math.atan2(-float(rotation[2, 0]), float(rotation[2, 2]))
    return np.array([pitch, yaw, roll])
