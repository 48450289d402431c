import numpy as np
import pytest
from scipy.spatial.distance import cdist

from fractal_farm.errors import FarmError
from fractal_farm.ifs.gap import measure_gap
from fractal_farm.ifs.genome import as_genome
from fractal_farm.solid.certificate import certificate
from fractal_farm.solid.parameters import SolidParameters
from fractal_farm.solid.pipeline import make_solid
from fractal_farm.solid.struts import HIDDEN, along, strut_ends
from tests.ifs.attractors import CANTOR_SET, CANTOR_SQUARE, lattice, random_genome


def cantor_gaps(shortest):
    """The middle thirds of [0, 3] that are longer than `shortest`."""
    spans, gaps = [(0.0, 3.0)], []
    while spans:
        low, high = spans.pop()
        third = (high - low) / 3.0
        if third > shortest:
            gaps.append((low + third, high - third))
            spans += [(low, low + third), (high - third, high)]
    return np.array(sorted(gaps))


def test_the_struts_of_the_cantor_set_are_its_middle_thirds():
    genome = as_genome(CANTOR_SET)
    gap, contacts, enclosure = measure_gap(genome)
    assert gap == pytest.approx(1 / 3, abs=2e-3)
    wall = 0.05 / HIDDEN
    struts = np.sort(strut_ends(genome, contacts, enclosure, wall)[:, :, 0], axis=1)
    struts = struts[struts[:, 0].argsort()]
    left, right = float(struts.min()), float(struts.max())
    side = 3.0 * (struts[:, 1] - struts[:, 0]).max()
    expected = cantor_gaps(0.05 * 3.0 / side) * side / 3.0
    assert len(struts) == len(expected)
    middle = 0.5 * (left + right)
    np.testing.assert_allclose(struts - middle, expected - 0.5 * side, atol=5e-3 * side)


def test_points_on_struts_are_as_dense_as_asked_for_and_reach_both_ends():
    struts = np.array([[[0, 0, 0], [3, 0, 4]], [[1, 1, 1], [1, 1, 1.01]]], float)
    points = along(struts, 0.5)
    first = points[: len(points) - 3] if len(points) else points
    np.testing.assert_array_equal(first[0], struts[0, 0])
    assert np.linalg.norm(np.diff(points, axis=0), axis=1)[:20].max() <= 0.25
    for end in struts.reshape(-1, 3):
        assert cdist(points, [end]).min() == 0.0
    assert along(np.empty((0, 2, 3)), 1.0).shape == (0, 3)


@pytest.mark.parametrize("genome", [CANTOR_SET, CANTOR_SQUARE, lattice(0.2, 4.0, axes=2)])
def test_dust_that_falls_apart_without_is_one_body_with_bridges_at_the_wall_asked_for(genome):
    genome = as_genome(genome)
    with pytest.raises(FarmError, match="or bridges") as refusal:
        make_solid(genome, SolidParameters(thicken=False))
    assert float(str(refusal.value).split("wall >= ")[1].split()[0]) > 5.0
    mesh = make_solid(genome, SolidParameters(thicken=False, bridges=True))
    facts = certificate(mesh)
    assert facts["watertight"]
    assert facts["bodies"] == 1
    assert facts["wall_measured_mm"] >= 0.76
    assert mesh.metadata["wall_used_mm"] == pytest.approx(0.8)
    assert mesh.metadata["struts"] >= len(genome.genes) - 1
    assert max(facts["box_mm"]) == pytest.approx(30.0, abs=1e-3)
    assert facts["volume_mm3"] < 0.2 * make_solid(genome, SolidParameters()).volume


def test_the_cantor_set_with_bridges_is_a_rod():
    mesh = make_solid(as_genome(CANTOR_SET), SolidParameters(30.0, 2.0, bridges=True))
    assert mesh.volume == pytest.approx(np.pi * 28.0 + 4.0 / 3.0 * np.pi, rel=0.06)
    assert mesh.euler_number == 2


@pytest.mark.parametrize("seed", range(4))
def test_random_designs_with_bridges_are_one_body_of_the_wall(seed):
    facts = certificate(make_solid(as_genome(random_genome(seed)), SolidParameters(resolution=120, bridges=True)))
    assert facts["watertight"]
    assert facts["bodies"] == 1
    assert facts["wall_measured_mm"] >= 0.76


def test_too_many_struts_are_refused_with_what_would_pass():
    genome = as_genome(lattice(0.47, 1.0))
    _, contacts, enclosure = measure_gap(genome)
    with pytest.raises(FarmError, match=r"100000 struts.*raise the wall"):
        strut_ends(genome, contacts, enclosure, 1e-6)
