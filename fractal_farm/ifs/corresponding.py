"""Points of several designs that correspond to each other: the same words of the address tree in each.

Pictures of a design that changes need points that move with it. A word w of maps is a place in every system of as
many maps, f_w(a), and it moves continuously with the genes. One cut set is chosen for all: a word is long enough once
its piece is small in each of them, so that the points are even in all, and as many.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError
from fractal_farm.ifs.copies import copied
from fractal_farm.ifs.enclosure import compose, image, make_identity
from fractal_farm.ifs.genome import RHO, Genome
from fractal_farm.ifs.kernel import kernel
from fractal_farm.ifs.linear_algebra import largest_singular_value
from fractal_farm.ifs.maps import resolved_maps
from fractal_farm.ifs.random_iteration import system_of
from fractal_farm.ifs.system import fixed_point

FloatArray = npt.NDArray[np.float64]

_BISECTIONS = 40
_SMALLEST = 1e-12  # of the attractor's size
_ENOUGH = 0.97
_AT_ONCE = 64  # genomes of which words are composed together
_STACK = 4096


def corresponding_points(genomes: Sequence[Genome], n_points: int) -> list[FloatArray]:
    """Points of valid genomes, as many of each; point i of one corresponds to point i of another.

    Args:
        genomes: of as many maps each, in corresponding order of their rows, and of one symmetry.
        n_points: points of each at most, at least one for each copy and map; nearly as many come.

    Returns:
        (m, 3) float64 for each genome, IFS units.

    Raises:
        InputError: the genomes differ in their number of maps or in symmetry.
    """
    if len({(genome.n_maps, genome.symmetry) for genome in genomes}) != 1:
        raise InputError("designs of different numbers of maps or symmetries have no points that correspond")
    systems = [system_of(genome) for genome in genomes]
    n_maps, n_copies = genomes[0].n_maps, int(systems[0].n_copies[0])
    ratios = np.stack([_ratios(genome) for genome in genomes])
    wanted = max(n_maps, n_points // n_copies)
    small = _small_enough(np.unique(ratios, axis=0), wanted)
    maps = np.stack([resolved_maps(genome).reshape(n_maps, 12) for genome in genomes])
    anchors = np.empty((len(genomes), 3))
    likeliest = int(ratios.mean(axis=0).argmax())
    for index in range(len(genomes)):
        fixed_point(maps[index, likeliest], anchors[index])
    words = [
        _images(maps[start : start + _AT_ONCE], ratios, small, anchors[start : start + _AT_ONCE], 2 * wanted)
        for start in range(0, len(genomes), _AT_ONCE)
    ]
    return [copied(points, system) for points, system in zip(np.concatenate(words), systems, strict=True)]


def _ratios(genome: Genome) -> FloatArray:
    """How much each map contracts: rho, or the spectral norm of A."""
    if genome.phenotype.family == "similarity":
        return np.ascontiguousarray(genome.genes[:, RHO])
    return np.array([largest_singular_value(*row[0:3], *row[4:7], *row[8:11]) for row in genome.genes.tolist()])


def _small_enough(ratios: FloatArray, wanted: int) -> float:
    """The size of pieces of which there are nearly `wanted`, and not more."""
    high, low = 0.0, math.log(_SMALLEST)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        count = _count(ratios, math.exp(middle), wanted)
        if count > wanted:
            low = middle
        else:
            high = middle
            if count >= _ENOUGH * wanted:
                break
    return math.exp(high)


@kernel
def _count(ratios, small, limit):  # type: ignore[no-untyped-def]
    """Words whose piece is at most `small` in every one of (K, N) ratios; limit + 1 if they are more than `limit`."""
    kinds, n_maps = ratios.shape
    stack = np.ones((_STACK, kinds))
    word = np.empty(kinds)
    height = 1
    count = 0
    while height > 0:
        height -= 1
        word[:] = stack[height]
        if word.max() <= small:
            count += 1
            if count > limit:
                return count
            continue
        if height + n_maps > len(stack):
            stack = _longer(stack)
        for i in range(n_maps):
            for k in range(kinds):
                stack[height, k] = word[k] * ratios[k, i]
            height += 1
    return count


@kernel
def _images(maps, ratios, small, anchors, limit):  # type: ignore[no-untyped-def]
    """The same words applied to an anchor of each system.

    Args:
        maps: (F, N, 12) float64.
        ratios: (K, N) float64, of all systems that decide how long words are.
        small: see `_count`.
        anchors: (F, 3) float64, a point of each attractor.
        limit: number of words, at most.

    Returns:
        (F, n, 3) float64.
    """
    frames, n_maps, _ = maps.shape
    kinds = len(ratios)
    width = 12 * frames + kinds
    stack = np.empty((_STACK, width))
    word = np.empty(width)
    for f in range(frames):
        make_identity(stack[0, 12 * f : 12 * f + 12])
    stack[0, 12 * frames :] = 1.0
    points = np.empty((frames, limit, 3))
    height = 1
    count = 0
    while height > 0:
        height -= 1
        word[:] = stack[height]
        if word[12 * frames :].max() <= small:
            for f in range(frames):
                place = image(word[12 * f : 12 * f + 12], anchors[f, 0], anchors[f, 1], anchors[f, 2])
                points[f, count, 0], points[f, count, 1], points[f, count, 2] = place
            count += 1
            continue
        if height + n_maps > len(stack):
            stack = _longer(stack)
        for i in range(n_maps):
            for f in range(frames):
                compose(word[12 * f : 12 * f + 12], maps[f, i], stack[height, 12 * f : 12 * f + 12])
            for k in range(kinds):
                stack[height, 12 * frames + k] = word[12 * frames + k] * ratios[k, i]
            height += 1
    return points[:, :count].copy()


@kernel
def _longer(stack):  # type: ignore[no-untyped-def]
    longer = np.empty((2 * len(stack), stack.shape[1]))
    longer[: len(stack)] = stack
    return longer
