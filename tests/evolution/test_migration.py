import networkx as nx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fractal_farm.evolution.designs import design_dtype
from fractal_farm.evolution.migration import emigrants, settle, sources


def _members(fitness, start=0):
    rows = np.zeros(len(fitness), design_dtype(2, 7))
    rows["fitness"] = fitness
    rows["slot"] = np.arange(start, start + len(fitness))
    rows["design_id"] = [f"{k:032x}".encode() for k in rows["slot"]]
    return rows


TOPOLOGIES = ["ring", "full", "random", "isolated"]


@given(st.sampled_from(TOPOLOGIES), st.integers(1, 12), st.integers(1, 5), st.integers(0, 9))
def test_topologies_are_regular_and_nobody_sends_to_itself(topology, islands, degree, seed):
    links = sources(topology, islands, degree, seed)
    expected = {"full": islands - 1, "isolated": 0}.get(topology, min(degree, islands - 1))
    assert [len(set(links[k]) - {k}) for k in range(islands)] == [expected] * islands
    destinations = np.bincount([source for own in links for source in own], minlength=islands)
    assert destinations.tolist() == [expected] * islands


def test_a_ring_of_degree_two_is_a_circle_of_neighbours():
    assert sources("ring", 5, 2, 0) == [(1, 4), (0, 2), (1, 3), (2, 4), (0, 3)]
    assert sources("ring", 3, 1, 0) == [(2,), (0,), (1,)]


def test_a_random_graph_depends_on_the_seed_alone():
    assert sources("random", 16, 3, 7) == sources("random", 16, 3, 7)
    assert len({tuple(sources("random", 16, 3, seed)) for seed in range(10)}) == 10


def test_random_graphs_connect_all_islands():
    for seed in range(30):
        graph = nx.DiGraph()
        graph.add_edges_from((s, k) for k, own in enumerate(sources("random", 8, 2, seed)) for s in own)
        assert nx.is_strongly_connected(graph)


def test_the_best_leave_in_the_total_order():
    library = _members([0.3, 0.9, 0.9, 0.1])
    assert emigrants(library, library["fitness"], "best", 3, 1, 0, 5) == [1, 2, 0]


def test_random_emigrants_are_different_members_and_change_with_the_generation():
    library = _members(np.linspace(0, 1, 50))
    leaving = [emigrants(library, library["fitness"], "random", 5, 1, 0, generation) for generation in range(20)]
    assert all(len(set(one)) == 5 for one in leaving)
    assert len({tuple(one) for one in leaving}) == 20
    assert emigrants(library, library["fitness"], "random", 80, 1, 0, 5) == list(range(50))


def test_an_arrival_takes_the_place_of_the_worst_if_it_is_better():
    library, settled = settle(_members([0.5, 0.2, 0.8]), _members([0.6, 0.1], 10), "worst_if_better", 1, 0, 1)
    assert library["fitness"].tolist() == [0.5, 0.6, 0.8]
    assert settled == 1


def test_worst_and_random_replacement_admit_everybody_new():
    for policy in ("worst", "random"):
        library, settled = settle(_members([0.5, 0.2, 0.8]), _members([0.1], 10), policy, 1, 0, 1)
        assert settled == 1
        assert 0.1 in library["fitness"]
        assert len(library) == 3


@pytest.mark.parametrize("policy", ["worst_if_better", "worst", "random"])
def test_who_is_present_already_is_turned_away(policy):
    before = _members([0.5, 0.2, 0.8])
    library, settled = settle(before, before[2:], policy, 1, 0, 1)
    assert settled == 0
    np.testing.assert_array_equal(library, before)
