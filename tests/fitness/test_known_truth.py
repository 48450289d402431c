"""D0 and D2 of fractals with closed-form dimensions, at the errors that DESIGN section 3 allows for 5,000 points."""

from functools import cache

import numpy as np
import pytest

from fractal_farm.bench.truth import Fractal, classic, overlapping, separated
from fractal_farm.fitness import capacity_dimension, correlation_dimension
from fractal_farm.fitness.dimensions import measured

SEEDS = range(8)  # each turns the fractal at random
GROUPS = {
    "classic": classic,
    "naturally weighted": lambda: separated("natural"),
    "floored weights": lambda: separated("floored"),
    "overlapping": overlapping,
}


@cache
def measurements(fractal: Fractal) -> np.ndarray:
    """(seeds, 2) D0 and D2."""
    return np.array([measured(fractal.points(seed))[:2] for seed in SEEDS])


@pytest.mark.parametrize(
    "fractal", [*classic(), *separated("natural"), *separated("floored")], ids=lambda fractal: fractal.name
)
def test_the_correlation_dimension_of_a_known_fractal_is_recovered(fractal):
    errors = measurements(fractal)[:, 1] - fractal.d2
    bias, rmse = abs(errors.mean()), np.sqrt(np.mean(errors**2))
    if fractal.d2 <= 1.6:
        assert bias <= 0.02
        assert rmse <= 0.03
    else:
        assert rmse <= (0.09 if fractal.d2 < 2.05 else 0.12)


@pytest.mark.parametrize(
    ("group", "allowed_rmse", "allowed_deviation"),
    [
        ("classic", 0.22, 0.055),
        ("naturally weighted", 0.045, 0.018),
        ("floored weights", 0.09, 0.02),
        ("overlapping", 0.06, 0.025),
    ],
)
def test_the_capacity_dimension_of_a_group_of_fractals_has_the_published_error(group, allowed_rmse, allowed_deviation):
    fractals = GROUPS[group]()
    errors = np.array([measurements(fractal)[:, 0] - fractal.d0 for fractal in fractals])
    assert np.sqrt(np.mean(errors**2)) <= allowed_rmse
    assert errors.std(axis=1).mean() <= allowed_deviation


@pytest.mark.parametrize(
    ("group", "allowed_rmse"),
    [("classic", 0.055), ("naturally weighted", 0.005), ("floored weights", 0.02), ("overlapping", 0.015)],
)
def test_the_correlation_dimension_of_a_group_of_fractals_has_the_published_error(group, allowed_rmse):
    errors = np.array([measurements(fractal)[:, 1] - fractal.d2 for fractal in GROUPS[group]()])
    assert np.sqrt(np.mean(errors**2)) <= allowed_rmse


def test_the_closed_forms_reproduce_the_textbook():
    dimensions = {fractal.name: fractal.d0 for fractal in classic()}
    assert dimensions["Cantor set"] == pytest.approx(np.log(2) / np.log(3))
    assert dimensions["Menger sponge"] == pytest.approx(np.log(20) / np.log(3))
    assert dimensions["Koch curve"] == pytest.approx(np.log(4) / np.log(3))
    assert dimensions["Sierpinski tetrahedron"] == pytest.approx(2)
    for fractal in separated("natural"):
        assert fractal.d2 == pytest.approx(fractal.d0)
    for fractal in separated("floored"):
        assert fractal.d2 <= fractal.d0 + 1e-9


def test_the_dimensions_of_smooth_sets_come_out_at_other_sizes_too():
    generator = np.random.default_rng(1)
    for n in (500, 2000, 20_000):
        line = np.outer(generator.random(n), [3.0, -2.0, 1.0])
        square = np.concatenate([generator.random((n, 2)), np.zeros((n, 1))], axis=1)
        assert correlation_dimension(line) == pytest.approx(1, abs=0.05)
        assert capacity_dimension(line) == pytest.approx(1, abs=0.06)
        assert correlation_dimension(square) == pytest.approx(2, abs=0.15)
        assert capacity_dimension(square) == pytest.approx(2, abs=0.45)
