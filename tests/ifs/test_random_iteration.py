import numpy as np
import pytest
from scipy import stats

from fractal_farm.errors import InputError
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.maps import resolved_maps, selection_probabilities
from fractal_farm.ifs.random_iteration import attractor_points
from tests.table1 import TABLE1


def _drawn_maps(points, genome):
    """Which map led from each point to the next: the one that reproduces it."""
    images = np.einsum("kij,tj->tki", resolved_maps(genome)[:, :, :3], points[:-1]) + resolved_maps(genome)[:, :, 3]
    distance = np.linalg.norm(images - points[1:, None, :], axis=2)
    assert distance.min(axis=1).max() < 1e-12 * np.abs(points).max()
    return distance.argmin(axis=1)


@pytest.mark.parametrize("name", TABLE1)
def test_every_point_is_the_image_of_the_one_before_and_maps_are_drawn_with_their_probabilities(name):
    points = attractor_points(TABLE1[name], 50_000)
    drawn = _drawn_maps(points, TABLE1[name])
    counts = np.bincount(drawn, minlength=len(TABLE1[name]))
    assert stats.chisquare(counts, selection_probabilities(TABLE1[name]) * counts.sum()).pvalue > 1e-4
    # Successive draws are independent: a contingency table of neighbours.
    pairs = np.histogram2d(drawn[:-1], drawn[1:], bins=len(counts))[0]
    assert stats.chi2_contingency(pairs).pvalue > 1e-4


def test_eight_maps_are_drawn_with_their_probabilities():
    genes = np.zeros((8, 7))
    genes[:, 3] = np.linspace(0.3, 0.45, 8)
    genes[:, 4:] = 4 * np.array(np.unravel_index(np.arange(8), (2, 2, 2))).T
    counts = np.bincount(_drawn_maps(attractor_points(genes, 50_000), genes), minlength=8)
    assert stats.chisquare(counts, selection_probabilities(genes) * counts.sum()).pvalue > 1e-4


@pytest.mark.parametrize("name", TABLE1)
def test_the_orbit_begins_on_the_attractor(name):
    # The predecessor of the first point is the fixed point of the most probable map.
    genome = TABLE1[name]
    first = attractor_points(genome, 1)[0]
    maps = resolved_maps(genome)
    likeliest = maps[int(np.argmax(selection_probabilities(genome)))]
    fixed = np.linalg.solve(np.eye(3) - likeliest[:, :3], likeliest[:, 3])
    images = maps[:, :, :3] @ fixed + maps[:, :, 3]
    assert np.linalg.norm(images - first, axis=1).min() < 1e-9


def test_a_longer_orbit_begins_with_the_shorter_and_map_order_does_not_matter():
    genes = np.array(TABLE1["06425"])
    long = attractor_points(genes, 5000)
    np.testing.assert_array_equal(attractor_points(genes, 100), long[:100])
    np.testing.assert_array_equal(attractor_points(genes[[2, 0, 1]], 5000), long)


def test_purposes_and_repeats_have_streams_of_their_own():
    genome = TABLE1["06425"]
    clouds = [
        attractor_points(genome, 500, purpose, repeat)
        for purpose, repeat in [("fitness", 0), ("display", 0), ("repeat", 0), ("repeat", 1)]
    ]
    for i, one in enumerate(clouds):
        for other in clouds[:i]:
            assert not np.array_equal(one[1:], other[1:])


def test_affine_maps_iterate():
    rng = np.random.default_rng(5)
    genes = rng.normal(size=(3, 12)) * 0.2
    genome = Genome(genes, Phenotype(family="affine"))
    np.testing.assert_allclose(resolved_maps(genome).reshape(3, 12), genes)
    _drawn_maps(attractor_points(genome, 2000), genome)


@pytest.mark.parametrize(("n", "purpose"), [(0, "fitness"), (10, "beauty")])
def test_a_senseless_request_is_refused(n, purpose):
    with pytest.raises(InputError):
        attractor_points(TABLE1["06582"], n, purpose)
