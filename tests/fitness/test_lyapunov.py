import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fractal_farm.errors import InputError
from fractal_farm.fitness import lyapunov_exponent
from fractal_farm.fitness.lyapunov import new_tangent_workspace, tangent_growth
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.maps import resolved_maps, selection_probabilities
from fractal_farm.ifs.random_iteration import attractor_points, stream_keys, stream_number, system_of
from tests.table1 import TABLE1

AFFINE = Phenotype(family="affine")


def affine(*matrices):
    """A genome of the affine family with offsets that keep the maps apart."""
    rows = [np.column_stack([m, [i, 0, 0]]).ravel() for i, m in enumerate(np.asarray(matrices, float))]
    return Genome(np.array(rows), AFFINE)


def closed_form(genome):
    """The sum of P ln rho."""
    rho = np.asarray(genome)[:, 3]
    return math.fsum(selection_probabilities(genome) * np.log(rho))


@pytest.mark.parametrize("name", TABLE1)
def test_the_exponent_of_similarities_is_the_closed_form(name):
    assert lyapunov_exponent(TABLE1[name]) == pytest.approx(closed_form(TABLE1[name]), abs=1e-12)


def test_the_exponent_uses_probabilities_set_by_hand():
    genome = Genome(np.array(TABLE1["06582"]), probabilities=(0.5, 0.5))
    assert lyapunov_exponent(genome) == pytest.approx(0.5 * math.log(0.2793) + 0.5 * math.log(0.9677), abs=1e-12)


@pytest.mark.parametrize("name", TABLE1)
def test_tangent_growth_along_the_orbit_of_similarities_is_the_closed_form(name):
    system = system_of(Genome(np.array(TABLE1[name])))
    growth = tangent_growth(system, len(TABLE1[name]), np.uint32(1), np.uint32(2), new_tangent_workspace())
    assert growth == pytest.approx(closed_form(TABLE1[name]), abs=1e-12)


@given(st.lists(st.tuples(*[st.floats(0.02, 0.99)] * 3), min_size=2, max_size=8))
def test_the_exponent_of_diagonal_maps_is_that_of_their_slowest_axis(diagonals):
    genome = affine(*(np.diag(diagonal) for diagonal in diagonals))
    logs = np.log(np.array(diagonals))
    axes = selection_probabilities(genome) @ logs
    spread = (logs - logs.mean(axis=1, keepdims=True)).std()  # what the control variate leaves
    assert lyapunov_exponent(genome) == pytest.approx(axes.max(), abs=0.01 + 5 * spread / math.sqrt(5000))


def test_the_exponent_of_affine_maps_is_the_growth_rate_of_a_long_matrix_product():
    generator = np.random.default_rng(3)
    for n in (2, 3):
        matrices = generator.normal(size=(n, 3, 3))
        matrices *= (generator.uniform(0.4, 0.95, n) / np.linalg.norm(matrices, 2, axis=(1, 2)))[:, None, None]
        genome = affine(*matrices)
        vector, growth, steps = np.ones(3), 0.0, 200_000
        for k in generator.choice(n, steps, p=selection_probabilities(genome)):
            vector = matrices[k] @ vector
            size = np.linalg.norm(vector)
            growth += math.log(size)
            vector /= size
        assert lyapunov_exponent(genome) == pytest.approx(growth / steps, abs=0.025)


def test_the_tangent_vector_follows_the_maps_that_the_orbit_drew():
    genome = affine(np.diag([0.9, 0.1, 0.1]), np.diag([0.3, 0.1, 0.1]))
    work = new_tangent_workspace()
    system = system_of(genome)
    first, second = stream_keys(system.keys, stream_number("fitness"))
    tangent_growth(system, 2, first, second, work)
    n = work.drawn.shape[1]
    points = attractor_points(genome, n)
    canonical = sorted(range(2), key=lambda i: genome.genes[i].tolist())
    maps = resolved_maps(genome)[canonical]
    k = work.drawn[0, 1:].astype(int)
    assert set(k.tolist()) == {0, 1}
    images = np.einsum("tij,tj->ti", maps[k][:, :, :3], points[:-1]) + maps[k][:, :, 3]
    assert np.allclose(images, points[1:], atol=1e-14)


def test_maps_that_annihilate_every_vector_have_exponent_minus_infinity():
    nilpotent = np.zeros((3, 3))
    nilpotent[0, 1] = 0.5
    assert lyapunov_exponent(affine(nilpotent, nilpotent)) == -math.inf


def test_very_strong_contraction_does_not_underflow():
    genome = affine(np.diag([1e-150, 1e-160, 1e-170]), np.diag([1e-150, 1e-160, 1e-170]))
    assert lyapunov_exponent(genome) == pytest.approx(-150 * math.log(10), rel=1e-9)


def test_an_invalid_genome_is_refused():
    with pytest.raises(InputError, match="rho"):
        lyapunov_exponent([[0, 0, 0, 1.5, 0, 0, 0], [0, 0, 0, 0.5, 1, 0, 0]])


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ([[0.5, -0.4, 0], [-0.4, 0.5, 0], [0, 0, 0.1]], 1.0, math.log(0.9)),
        ([[0.5, -0.4, 0], [-0.4, 0.5, 0], [0, 0, 0.1]], 0.5, math.log(0.9)),
        ([[0.45, -0.45, 0], [-0.45, 0.45, 0], [0, 0, 0]], 1.0, math.log(0.9)),
        ([[0.1, 0.3, 0.3], [0.3, 0.1, 0.3], [0.3, 0.3, 0.1]], 1.0, math.log(0.7)),
        (np.full((3, 3), 0.3) - 0.9 * np.eye(3), 1.0, math.log(0.9)),
    ],
)
def test_symmetric_maps_do_not_hide_the_direction_of_fastest_growth(first, second, expected):
    genome = affine(np.array(first), np.array(first) * second)
    halves = selection_probabilities(genome)[1] * math.log(second)
    assert lyapunov_exponent(genome) == pytest.approx(expected + halves, abs=0.005)
