import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from scipy.spatial.transform import Rotation

from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.linear_algebra import determinant, largest_singular_value
from fractal_farm.ifs.maps import resolved_maps, selection_probabilities
from tests.table1 import PROBABILITIES, TABLE1


@pytest.mark.parametrize("name", TABLE1)
@pytest.mark.parametrize("sign", [1, -1])
def test_maps_are_rho_times_a_rotation_about_y_then_x_then_z(name, sign):
    genes = np.array(TABLE1[name])
    maps = resolved_maps(Genome(genes, Phenotype(rotation_sign=sign)))
    for (pitch, yaw, roll, rho, *offset), resolved in zip(genes, maps, strict=True):
        rotation = Rotation.from_euler("yxz", [sign * yaw, sign * pitch, sign * roll]).as_matrix()
        np.testing.assert_allclose(resolved[:, :3], rho * rotation, atol=1e-14)
        np.testing.assert_allclose(resolved[:, 3], rho * rotation @ offset, atol=1e-14)


def test_the_other_reading_adds_the_offset_outside():
    genes = np.array(TABLE1["06425"])
    inside = resolved_maps(genes)
    outside = resolved_maps(Genome(genes, Phenotype(map_form="rho R x + d")))
    np.testing.assert_array_equal(outside[:, :, :3], inside[:, :, :3])
    np.testing.assert_array_equal(outside[:, :, 3], genes[:, 4:])


@pytest.mark.parametrize("name", TABLE1)
def test_probabilities_of_table_1_are_those_worked_out_by_hand(name):
    probabilities = selection_probabilities(TABLE1[name])
    assert tuple(np.round(probabilities, 4)) == PROBABILITIES[name]
    assert probabilities.sum() == pytest.approx(1.0, abs=1e-15)


def _probabilities(rho, influence):
    genes = np.zeros((len(rho), 7))
    genes[:, 3] = rho
    genes[:, 4] = np.arange(len(rho))
    return selection_probabilities(Genome(genes, Phenotype(influence=influence)))


ratios = st.lists(st.floats(0.001, 0.999), min_size=2, max_size=8)


@given(ratios, st.floats(2.6, 20.0))
def test_only_the_largest_pays_for_the_floor(rho, influence):
    volume = np.array(rho) ** 3 / sum(r**3 for r in rho)
    probabilities = _probabilities(rho, influence)
    floored = np.maximum(volume, 1.0 / (influence * len(rho)))
    payers = np.flatnonzero(probabilities < floored - 1e-12)
    assert len(payers) <= 1
    assert all(volume[payer] == pytest.approx(volume.max()) for payer in payers)


@given(ratios, st.floats(1.0, 20.0))
def test_probabilities_keep_the_floor_for_any_influence(rho, influence):
    probabilities = _probabilities(rho, influence)
    assert probabilities.sum() == pytest.approx(1.0, abs=1e-12)
    assert probabilities.min() >= (1 - 1e-12) / (influence * len(rho))


def test_equal_maps_share_equally_and_affine_maps_by_their_determinant():
    genes = np.zeros((3, 7))
    genes[:, 3] = 0.5
    np.testing.assert_allclose(selection_probabilities(genes), 1 / 3)
    affine = np.zeros((2, 12))
    affine[0, [0, 5, 10]] = 0.5, 0.5, 0.8
    affine[1, [0, 5, 10]] = 0.5, 0.5, 0.4
    np.testing.assert_allclose(selection_probabilities(Genome(affine, Phenotype(family="affine"))), [2 / 3, 1 / 3])


def test_probabilities_set_by_hand_stand():
    genome = Genome(np.array(TABLE1["06425"]), probabilities=(0.2, 0.5, 0.3))
    np.testing.assert_array_equal(selection_probabilities(genome), [0.2, 0.5, 0.3])


@given(npst.arrays(np.float64, (3, 3), elements=st.floats(-2, 2)))
def test_the_closed_forms_agree_with_lapack(matrix):
    entries = matrix.ravel().tolist()
    assert largest_singular_value(*entries) == pytest.approx(np.linalg.norm(matrix, 2), rel=1e-6, abs=1e-7)
    assert determinant(*entries) == pytest.approx(np.linalg.det(matrix), rel=1e-9, abs=1e-9)
