import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from fractal_farm.farm.sheet import different_first


def test_the_best_comes_first_and_its_copies_wait():
    rng = np.random.default_rng(0)
    kinds = rng.normal(size=(10, 14))
    descriptors = np.repeat(kinds, 20, axis=0) + rng.normal(size=(200, 14)) * 1e-3
    chosen = different_first(descriptors, 10)
    assert chosen == [20 * kind for kind in range(10)]


@given(npst.arrays(np.float64, (40, 3), elements=st.floats(-1, 1)), st.integers(1, 50))
def test_the_number_asked_for_is_chosen_once_each(descriptors, count):
    chosen = different_first(descriptors, count)
    assert len(chosen) == len(set(chosen)) == min(count, 40)
    assert chosen == sorted(chosen)


def test_equal_designs_are_taken_in_their_order():
    assert different_first(np.ones((50, 3)), 4) == [0, 1, 2, 3]
