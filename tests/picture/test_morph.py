import numpy as np
import pytest
from scipy.spatial import cKDTree

from fractal_farm.errors import InputError
from fractal_farm.ifs.corresponding import corresponding_points
from fractal_farm.ifs.cover import attractor_cover
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.maps import resolved_maps
from fractal_farm.picture.morph import morph_genomes, morph_pictures, morph_shares, slerp
from tests.constructed import about_z, conch, gene, star
from tests.table1 import TABLE1 as GENOMES


def hausdorff(one, two):
    return max(cKDTree(one).query(two)[0].max(), cKDTree(two).query(one)[0].max())


@pytest.mark.parametrize("pair", [("06582", "06582"), ("06328", "06447"), ("06582", "06425")])
def test_the_ends_of_a_morph_have_the_shapes_of_the_two_designs(pair):
    first, second = GENOMES[pair[0]], GENOMES[pair[1]]
    genomes = morph_genomes(first, second, 5)
    assert len({genome.n_maps for genome in genomes}) == 1
    for genome, end in ((genomes[0], first), (genomes[-1], second)):
        assert {tuple(row) for row in genome.genes} == {tuple(row) for row in np.asarray(end, float)}


def test_a_map_told_twice_leaves_the_shape():
    genomes = morph_genomes(conch(), star(5), 3)
    assert genomes[0].n_maps == 4
    cover = attractor_cover(conch(), 0.02)
    assert hausdorff(corresponding_points([genomes[0]], 20_000)[0], cover) < 0.06


def test_halfway_between_two_turned_squares_they_are_turned_by_half():
    def squares(angle, rho, offset):
        return Genome(np.array([gene(about_z(angle), rho, [offset, 0, 0]), gene(about_z(angle), rho, [-offset, 0, 0])]))

    middle = morph_genomes(squares(0.2, 0.25, 1), squares(0.8, 0.64, 1), 3)[1]
    for linear in resolved_maps(middle)[:, :, :3]:
        np.testing.assert_allclose(linear, 0.4 * about_z(0.5), atol=1e-12)


def test_slerp_goes_the_shortest_way_at_constant_speed():
    start, end = about_z(3.0), about_z(-3.0)
    np.testing.assert_allclose(slerp(start, end, 0.5), about_z(np.pi), atol=1e-12)


def test_both_readings_of_the_angles_give_the_same_way_of_the_maps():
    negated = [Genome(np.array(GENOMES[name]), Phenotype(rotation_sign=-1)) for name in ("06328", "06447")]
    first, *_ = [resolved_maps(genome) for genome in morph_genomes(*negated, 9)]
    for before, after in zip(morph_genomes(*negated, 41)[:-1], morph_genomes(*negated, 41)[1:], strict=True):
        assert np.abs(resolved_maps(after) - resolved_maps(before)).max() < 0.3
    assert first.shape == (3, 3, 4)


def test_pictures_of_the_ends_are_seen_as_the_designs_are():
    pictures = morph_pictures(morph_genomes(conch(), conch(), 2), 64, n_points=2_000)
    np.testing.assert_array_equal(np.asarray(pictures[0]), np.asarray(pictures[1]))
    assert morph_shares(3) == pytest.approx([0, 0.5, 1])


def test_what_has_nothing_between_is_refused():
    with pytest.raises(InputError, match="symmetry"):
        morph_genomes(conch(), Genome(conch().genes, symmetry="rotation:3"), 4)
    with pytest.raises(InputError, match="one phenotype"):
        morph_genomes(conch(), Genome(conch().genes, Phenotype(rotation_sign=-1)), 4)
    with pytest.raises(InputError, match="frames is 1"):
        morph_genomes(conch(), conch(), 1)
