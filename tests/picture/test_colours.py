import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fractal_farm.errors import InputError
from fractal_farm.picture import dual_tone, linear_gradient
from fractal_farm.picture.colours import LEAST_VALUE, coloured, legible


def test_the_linear_gradient_is_position_over_range():
    points = np.array([[0.0, 10, -1], [2, 20, -1], [1, 15, -1]])
    np.testing.assert_allclose(linear_gradient(points), [[0, 0, 0], [1, 1, 0], [0.5, 0.5, 0]])


def test_dual_tone_is_the_first_colour_minus_the_second_times_the_gradient():
    points = np.random.default_rng(0).normal(size=(50, 3))
    expected = np.clip([0.9, 0.8, 0.7] - np.array([0.5, 1.0, 0.2]) * linear_gradient(points), 0, 1)
    np.testing.assert_allclose(dual_tone(points, (0.9, 0.8, 0.7), (0.5, 1.0, 0.2)), expected)


@given(st.integers(0, 1000))
def test_legible_colours_are_bright_enough_and_keep_the_order_of_their_channels(seed):
    colours = np.random.default_rng(seed).random((40, 3))
    brightened = legible(colours)
    assert brightened.max(axis=1).min() >= LEAST_VALUE
    assert brightened.max() <= 1.0 + 1e-12
    np.testing.assert_array_equal(np.argsort(brightened, axis=1), np.argsort(colours, axis=1))


def test_an_unknown_colouring_is_refused_by_name():
    with pytest.raises(InputError, match=r"rainbow.*gradient, dual"):
        coloured(np.zeros((3, 3)), "rainbow")
