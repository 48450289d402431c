import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fractal_farm.errors import InputError
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.similarity_dimension import similarity_dimension, solve_moran


def equal_maps(count, ratio):
    return [[0.1 * k, 0.2, 0.3, ratio, k, 0, 0] for k in range(count)]


@pytest.mark.parametrize(
    ("count", "ratio", "dimension"),
    [
        (2, 1 / 3, math.log(2) / math.log(3)),
        (4, 1 / 2, 2.0),
        (8, 1 / 3, math.log(8) / math.log(3)),
        (8, 1 / 2, 3.0),
        (2, 0.99, math.log(2) / -math.log(0.99)),
    ],
)
def test_equal_ratios_have_the_closed_form(count, ratio, dimension):
    assert similarity_dimension(equal_maps(count, ratio)) == pytest.approx(dimension, rel=1e-12)


@given(st.lists(st.floats(1e-6, 0.999), min_size=2, max_size=8))
def test_the_powers_of_the_ratios_add_up_to_one_whatever_their_order(ratios):
    s = solve_moran(ratios)
    assert sum(ratio**s for ratio in ratios) == pytest.approx(1.0, abs=1e-9)
    assert solve_moran(ratios[::-1]) == s


def test_affine_maps_that_are_similarities_have_the_same_dimension():
    linear = 0.5 * np.eye(3)
    genes = np.array([np.column_stack([linear, [k, 0, 0]]).ravel() for k in range(3)])
    genome = Genome(genes, Phenotype(family="affine"))
    assert similarity_dimension(genome) == pytest.approx(math.log(3) / math.log(2))


def test_a_map_that_does_not_contract_is_refused():
    with pytest.raises(InputError):
        similarity_dimension(equal_maps(2, 1.2))
