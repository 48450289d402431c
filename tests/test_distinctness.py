"""Signatures tell designs apart, and not the chances of one design."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fractal_farm.bench.discriminants import rates
from fractal_farm.bench.genomes import random_genomes
from fractal_farm.distinctness import (
    DISTINCT,
    DistinctSet,
    first_of_each_shape,
    projection,
    signatures,
    squared_distances,
)
from fractal_farm.errors import InputError
from fractal_farm.fitness import evaluate, shape_descriptor
from fractal_farm.fitness.dimensions import measured
from fractal_farm.ifs.random_iteration import attractor_points
from fractal_farm.ifs.similarity_dimension import similarity_dimension


def test_near_says_what_distances_say():
    generator = np.random.default_rng(4)
    members, marks = generator.normal(size=(2, 400, 6)) * 0.9
    marks[0], marks[1] = members[0], np.nan
    expected = [bool((np.linalg.norm(members - mark, axis=1) < DISTINCT).any()) for mark in marks]
    assert 50 < sum(expected) < 350
    assert DistinctSet(members).near(marks).tolist() == expected
    assert not DistinctSet(members[:0]).near(marks).any()


def mark(points):
    d0, d2 = measured(points)[:2]
    return signatures(shape_descriptor(points)[None], [d0], [d2])[0]


def test_copies_are_grouped_and_unrelated_designs_are_not():
    grouped, merged = rates(3000, seed=5)
    assert grouped >= 0.98
    assert merged <= 0.01


def test_copies_that_are_reseeded_turned_scaled_mirrored_and_rewritten_are_grouped():
    genes, n_maps = random_genomes(2500, seed=12)
    genomes = [table[:n] for table, n in zip(genes, n_maps, strict=True)]
    fitness = evaluate(genomes).fitness
    crisp = [b for b, genome in enumerate(genomes) if fitness[b] > 0.85 and 1 <= similarity_dimension(genome) <= 3]
    qualified = crisp[:200]
    generator = np.random.default_rng(3)
    near = 0
    for b in qualified:
        genome = genomes[b]
        original = mark(attractor_points(genome, 5000))
        again = attractor_points(generator.permutation(genome), 5000, "repeat", int(generator.integers(1, 1000)))
        turn = Rotation.random(random_state=b).as_matrix() * [generator.choice([-1, 1]), 1, 1]
        near += np.linalg.norm(mark(again @ turn.T * generator.uniform(0.01, 100)) - original) < DISTINCT
    assert len(qualified) == 200
    assert near >= 0.98 * 200


def test_signatures_are_the_projection_of_descriptor_and_dimensions():
    generator = np.random.default_rng(0)
    shapes, d0, d2 = generator.random((7, 14)), generator.random(7), generator.random(7)
    expected = np.column_stack([shapes, d0, d2]) @ np.array(projection()).T
    assert np.allclose(signatures(shapes, d0, d2), expected, rtol=1e-12)
    one, many = expected[0], expected
    assert np.allclose(squared_distances(one, many), ((many - one) ** 2).sum(axis=1))
    assert np.isnan(signatures(np.full((1, 14), np.nan), [1.0], [1.0])).all()


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match=r"shape \(2, 13\)"):
        signatures(np.zeros((2, 13)), [1, 1], [1, 1])
    with pytest.raises(InputError, match="n values"):
        signatures(np.zeros((2, 14)), [1], [1, 1])


@pytest.mark.parametrize("spread", [0.3, 2.0, 6.0])
def test_by_the_million_says_what_one_after_the_other_says(spread):
    generator = np.random.default_rng(int(10 * spread))
    marks = generator.normal(0, spread, (9000, 6))
    marks[7::100] = marks[::100]  # copies
    marks[50] = np.nan
    _, entered = DistinctSet(np.zeros((0, 6))).sift(marks)
    assert first_of_each_shape(marks).tolist() == entered
    assert 1 < sum(entered) < len(marks)


def test_no_signature_has_no_shape():
    assert first_of_each_shape(np.zeros((0, 6))).tolist() == []
