"""Dimensions, descriptor and scores are those of the shape: not of its size, place, orientation or description."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fractal_farm.fitness import evaluate, shape_descriptor
from fractal_farm.fitness.dimensions import measured
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.maps import resolved_maps
from fractal_farm.ifs.random_iteration import attractor_points

COLUMNS = ("d0", "d2", "lle", "fitness", "descriptor")
POINTS = 2000


@st.composite
def genomes(draw):
    n = draw(st.integers(2, 8))
    angle = st.floats(-np.pi, np.pi)
    offset = st.integers(-200, 200).map(lambda k: k / 100)  # shapes of 1e-100 would drown in rounding when moved
    row = st.tuples(angle, angle, angle, st.floats(0.05, 0.95), offset, offset, offset)
    return np.array(draw(st.lists(row, min_size=n, max_size=n)))


def is_lopsided(points):
    """Whether rounding cannot turn the principal axes: variances and third moments are told apart."""
    offsets = points - points.mean(axis=0)
    variances, axes = np.linalg.eigh(np.cov(offsets.T))
    third = np.abs((offsets**2).sum(axis=1) @ offsets / len(points) @ axes)
    return np.diff(variances).min() > 1e-6 * variances[2] > 0 and third.min() > 1e-6 * variances[2] ** 1.5


@settings(max_examples=60)
@given(genomes(), st.integers(0, 2**32 - 1), st.floats(0.01, 100), st.booleans())
def test_a_cloud_that_is_moved_turned_mirrored_and_scaled_keeps_its_dimensions(genome, seed, size, mirrored):
    points = attractor_points(genome, POINTS)
    turn = Rotation.random(random_state=seed).as_matrix() * [-1 if mirrored else 1, 1, 1]
    moved = size * (points @ turn.T + np.random.default_rng(seed).uniform(-5, 5, 3))
    exactly = is_lopsided(points)
    d0, d2 = measured(points)[:2]
    d0_moved, d2_moved = measured(moved)[:2]
    assert abs(d0 - d0_moved) <= (1e-3 if exactly else 0.2)
    assert abs(d2 - d2_moved) <= (1e-3 if exactly else 0.05)
    if exactly:
        assert np.allclose(shape_descriptor(points), shape_descriptor(moved), atol=1e-3)


@settings(max_examples=40)
@given(genomes(), st.randoms())
def test_scores_do_not_depend_on_the_order_of_the_maps(genome, random):
    shuffled = list(genome)
    random.shuffle(shuffled)
    first, second = evaluate([genome], POINTS), evaluate([np.array(shuffled)], POINTS)
    for name in COLUMNS:
        assert np.array_equal(getattr(first, name), getattr(second, name))


@settings(max_examples=40)
@given(genomes(), st.integers(0, 2**32 - 1), st.floats(0.01, 100))
def test_a_conjugated_system_scores_like_the_original_within_the_noise_of_another_cloud(genome, seed, size):
    """x -> s Q x + t makes of each map A x + b the map Q A Q' x + s Q b + (I - Q A Q') t: the same shape."""
    probabilities = tuple(np.full(len(genome), 1 / len(genome)))
    maps = resolved_maps(genome)
    turn = Rotation.random(random_state=seed).as_matrix()
    place = np.random.default_rng(seed).uniform(-5, 5, 3)
    linear = turn @ maps[:, :, :3] @ turn.T
    shifts = size * maps[:, :, 3] @ turn.T + place - linear @ place
    rows = np.concatenate([linear, shifts[:, :, None]], axis=2).reshape(-1, 12)
    affine = Phenotype(family="affine")
    original = Genome(maps.reshape(-1, 12), affine, probabilities)
    result = evaluate([original, Genome(rows, affine, probabilities)], 5000, repeats=12)
    tolerance = 8 * np.hypot(result.fitness_error[0], result.fitness_error[1]) + 0.02
    assert abs(result.fitness[0] - result.fitness[1]) <= tolerance
    assert abs(result.lle[0] - result.lle[1]) <= 1e-9
