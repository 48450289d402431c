"""Clouds laid upon each other: copies meet, unrelated shapes do not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fractal_farm.bench.genomes import random_genomes
from fractal_farm.fitness import evaluate
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.random_iteration import attractor_points
from fractal_farm.ifs.similarity_dimension import similarity_dimension
from fractal_farm.likeness import SAME_SHAPE, aligned_distance, aligned_distances


def qualified(candidates: int, seed: int) -> list[Genome]:
    genes, n_maps = random_genomes(candidates, seed)
    genomes = [Genome(table[:count]) for table, count in zip(genes, n_maps, strict=True)]
    fitness = evaluate(genomes).fitness
    return [g for g, f in zip(genomes, fitness, strict=True) if f > 0.85 and 1 <= similarity_dimension(g) <= 3]


@pytest.fixture(scope="module")
def genomes() -> list[Genome]:
    return qualified(400, seed=4)[:50]


def test_reseeded_turned_scaled_and_mirrored_copies_lie_upon_their_originals(genomes: list[Genome]) -> None:
    generator = np.random.default_rng(8)
    distances = []
    for number, genome in enumerate(genomes):
        turn = Rotation.random(random_state=number).as_matrix() * [generator.choice([-1, 1]), 1, 1]
        copy = attractor_points(genome, 5000, "repeat", 1) @ turn.T * generator.uniform(0.01, 100) + [3, -2, 7]
        distances.append(aligned_distance(attractor_points(genome, 5000), copy))
    assert len(distances) == 50
    assert np.mean(np.array(distances) < SAME_SHAPE) >= 0.98


def test_unrelated_designs_do_not(genomes: list[Genome]) -> None:
    clouds = [attractor_points(genome, 5000) for genome in genomes]
    distances = np.concatenate([aligned_distances(clouds[k], clouds[k + 1 : k + 3]) for k in range(0, 40, 2)])
    assert distances.min() > SAME_SHAPE


def test_the_distance_is_how_far_points_have_moved_in_radii_of_the_shape() -> None:
    generator = np.random.default_rng(2)
    lattice = np.stack(np.meshgrid(np.arange(9.0), np.arange(7.0), np.arange(5.0)), axis=-1).reshape(-1, 3)
    lopsided = lattice[lattice.sum(axis=1) < 13]
    moved = lopsided + Rotation.random(len(lopsided), random_state=1).apply([0.2, 0.0, 0.0])
    radius = np.sqrt(np.square(lopsided - lopsided.mean(axis=0)).sum(axis=1).mean())
    turn = Rotation.random(random_state=3).as_matrix()
    assert aligned_distance(lopsided, generator.permutation(4 * moved @ turn)) == pytest.approx(0.2 / radius, rel=0.1)
    assert aligned_distance(lopsided, 4 * lopsided @ turn) == pytest.approx(0.0, abs=1e-6)


def test_single_points_are_alike_and_like_nothing_else() -> None:
    point, cloud = np.ones((100, 3)), np.random.default_rng(0).random((100, 3))
    assert aligned_distance(point, 2 * point) == 0.0
    assert aligned_distance(point, cloud) == aligned_distance(cloud, point) == np.inf
