import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fractal_farm.fitness.formula import FitnessFormula, fitness, numbers_of

DEFAULT = FitnessFormula()
dimensions = st.floats(0, 3)
exponents = st.floats(-20, 0)


def by_hand(d0, d2, lle, f):
    distance = sum(
        (value - centre) ** 2 / (2 * width**2)
        for value, (centre, width) in ((d0 / 3, f.d0), (d2 / 3, f.d2), (lle, f.lle))
    )
    return min(1.0, max(0.0, f.amplitude * math.exp(-distance) + f.baseline))


@given(
    dimensions,
    dimensions,
    exponents,
    st.builds(
        FitnessFormula,
        st.floats(0.5, 2),
        st.floats(-1, 0),
        *[st.tuples(st.floats(-1, 1), st.floats(0.1, 2)) for _ in range(3)],
    ),
)
def test_fitness_is_equation_3_7_with_any_constants(d0, d2, lle, formula):
    assert fitness(d0, d2, lle, numbers_of(formula)) == pytest.approx(by_hand(d0, d2, lle, formula), abs=1e-12)


def test_the_top_is_where_the_three_centres_are():
    assert fitness(3 * 0.334, 1.5, -0.057, numbers_of(DEFAULT)) == pytest.approx(0.993)


@given(dimensions, dimensions, exponents)
def test_fitness_lies_between_zero_and_one_and_is_zero_far_out(d0, d2, lle):
    assert 0 <= fitness(d0, d2, lle, numbers_of(DEFAULT)) <= 0.993
    assert fitness(d0, d2, -10.0, numbers_of(DEFAULT)) == 0.0
    assert fitness(d0, d2, -math.inf, numbers_of(DEFAULT)) == 0.0


def test_whole_numbers_from_a_configuration_are_taken():
    formula = FitnessFormula(2, 0, (0, 1), (0, 1), (0, 1))
    assert fitness(0.0, 0.0, -2.0, numbers_of(formula)) == pytest.approx(2 * math.exp(-2))
