import itertools

import networkx as nx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.stats import special_ortho_group

from fractal_farm.errors import InputError
from fractal_farm.ifs.cover import attractor_bounds, attractor_cover
from fractal_farm.ifs.gap import TOLERANCE, gap, gap_of_maps, gaps_within, measure_gap, new_gap_workspace
from fractal_farm.ifs.genome import as_genome
from fractal_farm.ifs.maps import resolved_maps
from tests.ifs.attractors import (
    CANTOR_SET,
    CANTOR_SQUARE,
    TETRAHEDRON,
    UNIT_CUBE,
    lattice,
    random_affine_genome,
    random_genome,
)
from tests.table1 import TABLE1


def brute_force(genome, radius):
    """The gap from dense covers of the pieces; too large by at most 2 radius / side."""
    points = attractor_cover(genome, radius)
    pieces = [points @ part[:, :3].T + part[:, 3] for part in resolved_maps(genome)]
    graph = nx.Graph()
    for (i, one), (j, other) in itertools.combinations(enumerate(pieces), 2):
        graph.add_edge(i, j, weight=cKDTree(one).query(other)[0].min())
    tree = nx.minimum_spanning_edges(graph, data=True)
    return max(data["weight"] for _, _, data in tree)


def gap_of(maps):
    return gap_of_maps(np.reshape(maps, (-1, 12)), len(maps), new_gap_workspace())[0]


@pytest.mark.parametrize(
    ("genome", "expected"),
    [
        (CANTOR_SET, 1 / 3),
        (CANTOR_SQUARE, 1 / 3),
        (lattice(0.25, 3.0, axes=2), 0.5),
        (TETRAHEDRON, 0.0),
        (UNIT_CUBE, 0.0),
        (lattice(0.5, 1.0, axes=1), 0.0),
    ],
)
def test_gaps_that_are_known(genome, expected):
    assert expected - 1e-9 <= gap(genome) <= expected + 1.3 * TOLERANCE


@given(
    st.floats(0.05, 0.6),
    st.floats(0.05, 0.35),
    st.integers(0, 1000),
)
def test_the_gap_of_a_two_part_cantor_set_in_any_position_and_size(first, second, seed):
    rng = np.random.default_rng(seed)
    frame, scale, shift = special_ortho_group.rvs(3, random_state=seed), rng.uniform(0.01, 100), rng.normal(size=3)
    end = scale * frame[:, 0]
    maps = []
    for ratio, fixed in ((first, shift), (second, shift + end)):
        turn = frame @ np.diag([1.0, -1.0, -1.0]) @ frame.T
        maps.append(np.column_stack([ratio * turn, fixed - ratio * turn @ fixed]))
    expected = (1 - first - second) / np.abs(frame[:, 0]).max()
    assert gap_of(maps) == pytest.approx(expected, abs=1.3 * TOLERANCE)


def test_the_longest_edge_of_the_tree_counts_and_not_the_longest_distance():
    # Pieces of length 0.1 at 0, 0.3 and 0.9 of a segment: gaps of 0.2 and 0.5, ends 0.8 apart.
    rows = np.array([[0, 0, 0, 0.1, place / 0.1, 0, 0] for place in (0.0, 0.3, 0.9)])
    assert gap(rows) == pytest.approx(0.5, abs=1.3 * TOLERANCE)


@pytest.mark.parametrize("genome", [random_genome(seed, (1.0, 2.2)) for seed in range(12)] + [TABLE1["06447"]])
def test_the_gap_agrees_with_brute_force_on_dense_covers(genome):
    lower, upper = attractor_bounds(genome, 1e-4)
    side = (upper - lower).max()
    radius = 4e-3 * side
    found, brute = gap(genome) * side, brute_force(genome, radius)
    assert brute - 2 * radius - 1e-9 <= found <= brute + 1.3 * TOLERANCE * side


@pytest.mark.parametrize("seed", range(3))
def test_the_gap_of_affine_maps_agrees_with_brute_force(seed):
    genome = random_affine_genome(seed)
    lower, upper = attractor_bounds(genome, 1e-4)
    side = (upper - lower).max()
    radius = 0.01 * side
    found, brute = gap(genome) * side, brute_force(genome, radius)
    assert brute - 2 * radius <= found <= brute + 1.3 * TOLERANCE * side


@pytest.mark.parametrize("name", TABLE1)
def test_the_kernel_takes_raw_maps_and_a_used_workspace(name):
    workspace = new_gap_workspace()
    for genome in (TABLE1["06425"], TABLE1[name]):
        maps = resolved_maps(sorted(genome)).reshape(-1, 12)
        value, excess, _ = gap_of_maps(maps, len(maps), workspace)
    assert value == gap(TABLE1[name])
    assert 0.0 <= excess <= TOLERANCE


def test_the_contacts_are_points_of_neighbouring_pieces_as_far_apart_as_the_tree_says():
    value, contacts, enclosure = measure_gap(as_genome(CANTOR_SQUARE))
    lengths = np.linalg.norm(contacts[:, 0] - contacts[:, 1], axis=1)
    assert contacts.shape == (3, 2, 3)
    np.testing.assert_allclose(lengths, 1 / 3, atol=1.3e-3)
    assert lengths.max() == pytest.approx(value * np.ptp(enclosure.attained, axis=0).max())


@pytest.mark.parametrize("name", TABLE1)
def test_the_gap_does_not_depend_on_the_order_of_the_rows(name):
    assert gap(TABLE1[name]) == gap(TABLE1[name][::-1])


def test_maps_that_share_their_fixed_point_have_no_gap():
    assert gap([[0.1, 0.2, 0.3, 0.5, 0, 0, 0], [1, 2, 3, 0.9, 0, 0, 0]]) == 0.0


def test_pieces_that_interlock_beyond_the_bound_still_give_an_upper_bound():
    genome = random_genome(25, (2.9, 3.0))
    workspace = new_gap_workspace()
    maps = resolved_maps(sorted(genome.tolist())).reshape(-1, 12)
    value, excess, _ = gap_of_maps(maps, len(maps), workspace)
    side = np.ptp(workspace.enclosure.attained, axis=0).max()
    assert value * side <= brute_force(genome, 0.04 * side) + 1.3 * TOLERANCE * side + excess * side


def test_an_invalid_genome_is_refused():
    with pytest.raises(InputError):
        gap(np.ones((2, 7)))


@pytest.mark.parametrize(("genome", "true_gap"), [(CANTOR_SET, 1 / 3), (lattice(0.25, 3.0, axes=2), 0.5)])
def test_a_limit_is_met_or_not_on_either_side_of_a_known_gap(genome, true_gap):
    limits = [0.0, 0.1 * true_gap, true_gap - TOLERANCE, true_gap + 2 * TOLERANCE, 2 * true_gap]
    assert [bool(gaps_within([as_genome(genome)], limit)[0]) for limit in limits] == [False, False, False, True, True]


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.001, 0.01, 0.8 / 30, 0.1, 0.3]))
def test_whether_a_gap_is_within_a_limit_is_what_the_gap_says(seed, limit):
    genomes = [as_genome(random_genome(seed + k)) for k in range(4)]
    assert gaps_within(genomes, limit).tolist() == [gap(genome) <= limit for genome in genomes]
