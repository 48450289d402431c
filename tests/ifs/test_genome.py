import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fractal_farm.errors import InputError
from fractal_farm.ifs.genome import Genome, Phenotype, as_genome, canonical_rows
from tests.table1 import TABLE1

rows = st.lists(
    st.tuples(*[st.floats(-3, 3)] * 3, st.floats(0.01, 0.99), *[st.floats(-2, 2)] * 3), min_size=2, max_size=8
)


@given(rows, st.randoms(use_true_random=False))
def test_identity_does_not_depend_on_the_order_of_maps(genes, shuffle):
    shuffled = list(genes)
    shuffle.shuffle(shuffled)
    assert Genome(np.array(genes)).design_id == Genome(np.array(shuffled)).design_id


def test_identity_depends_on_every_allele_and_on_the_phenotype():
    genes = np.array(TABLE1["06582"])
    identities = {Genome(genes).design_id}
    for index in np.ndindex(genes.shape):
        changed = genes.copy()
        changed[index] = np.nextafter(changed[index], 10.0)
        identities.add(Genome(changed).design_id)
    phenotypes = [
        Phenotype(influence=2.0),
        Phenotype(map_form="rho R x + d"),
        Phenotype(rotation_sign=-1),
    ]
    identities |= {Genome(genes, phenotype).design_id for phenotype in phenotypes}
    identities.add(Genome(genes, probabilities=(0.5, 0.5)).design_id)
    assert len(identities) == genes.size + 5


def test_probabilities_set_by_hand_follow_their_maps_in_the_identity():
    genes = np.array(TABLE1["06582"])
    one = Genome(genes, probabilities=(0.3, 0.7))
    assert one.design_id == Genome(genes[::-1], probabilities=(0.7, 0.3)).design_id
    assert one.design_id != Genome(genes, probabilities=(0.7, 0.3)).design_id


def test_minus_zero_is_zero():
    genes = np.array(TABLE1["06582"])
    genes[0, 0] = 0.0
    negative = genes.copy()
    negative[0, 0] = -0.0
    assert Genome(genes).design_id == Genome(negative).design_id
    assert str(canonical_rows(negative)).count("-0.0,") == 0


@pytest.mark.parametrize(
    ("row", "column", "value", "words"),
    [
        (1, 3, 1.2, ["map 2", "rho is 1.2", "between 0 and 1"]),
        (0, 3, 0.0, ["map 1", "rho is 0", "between 0 and 1"]),
        (2, 4, float("nan"), ["map 3", "d1 is nan", "finite"]),
    ],
)
def test_an_invalid_gene_is_named(row, column, value, words):
    genes = np.array(TABLE1["06328"])
    genes[row, column] = value
    with pytest.raises(InputError) as error:
        as_genome(genes)
    assert all(word in str(error.value) for word in words)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("shape", [(1, 7), (9, 7), (2, 6), (7,)])
def test_a_table_of_another_shape_is_refused(shape):
    with pytest.raises(InputError, match="2 to 8 rows of 7 numbers"):
        as_genome(np.full(shape, 0.5))


def test_an_affine_map_that_does_not_contract_is_refused():
    genes = np.zeros((2, 12))
    genes[:, [0, 5, 10]] = 0.5
    assert as_genome(Genome(genes, Phenotype(family="affine"))).n_maps == 2
    genes[1, 1] = 1.5
    with pytest.raises(InputError, match="map 2: the spectral norm"):
        as_genome(Genome(genes, Phenotype(family="affine")))
