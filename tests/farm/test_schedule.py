"""The schedule is driven by a simulated farm that finishes work in any order."""

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fractal_farm.evolution.designs import design_dtype
from fractal_farm.evolution.epoch import ELSEWHERE, EpochRecord, IslandState
from fractal_farm.evolution.hearsay import FIND, Hearsay
from fractal_farm.evolution.migration import sources
from fractal_farm.farm.schedule import LEAD, Schedule

DTYPE = design_dtype(2, 7)
NOTHING = np.zeros(0, np.int32)


def _record(island, epoch):
    """A library of one design that is born in this epoch and leaves."""
    design = np.zeros(1, DTYPE)
    design["island"], design["epoch"] = island, epoch
    index = np.zeros(1, np.int32)
    return EpochRecord(island, epoch, NOTHING, design, index, index, design, ())


def _simulate(links, lag, epochs, seed, hearsay=None, heard=None):
    """Start all that is ready, finish in random order; returns every inbox and the order of completed epochs."""
    schedule = Schedule(links, lag, {k: IslandState(-1, np.zeros(0, DTYPE)) for k in range(len(links))}, -1, hearsay)
    schedule.last_epoch = epochs - 1
    order = random.Random(seed)
    running, inboxes, completed = [], {}, []
    while schedule.complete < epochs - 1:
        for island, epoch in schedule.ready():
            inbox, state = schedule.start(island, epoch)
            inboxes[island, epoch] = [(s, int(r["epoch"][0])) for s, r in inbox if s != ELSEWHERE]
            if heard is not None:
                news = next(found for source, found in inbox if source == ELSEWHERE)
                heard[island, epoch] = [found[["epoch", "island"]].tolist() for found in (state.elsewhere, news)]
            running.append((island, epoch))
        assert running, "deadlock"
        assert max(epoch for _, epoch in running) <= schedule.complete + LEAD
        island, epoch = running.pop(order.randrange(len(running)))
        for records, states in schedule.finish(_record(island, epoch)):
            assert [record.island for record in records] == list(range(len(links)))
            assert {state.epoch for state in states.values()} == {records[0].epoch}
            completed.append(records[0].epoch)
    return inboxes, completed


@given(
    st.sampled_from(["ring", "full", "random", "isolated"]),
    st.integers(1, 6),
    st.integers(1, 4),
    st.integers(0, 1000),
)
def test_inboxes_depend_on_epoch_numbers_and_never_on_the_order_of_work(topology, islands, lag, seed):
    links = sources(topology, islands, 2, 3)
    inboxes, completed = _simulate(links, lag, 8, seed)
    assert completed == list(range(8))
    assert inboxes == {
        (island, epoch): [(source, epoch - lag) for source in links[island]] if epoch >= lag else []
        for island in range(islands)
        for epoch in range(8)
    }


@given(st.integers(1, 5), st.integers(1, 3), st.integers(0, 1000))
def test_islands_hear_of_all_that_others_found_an_epoch_after_the_migrants(islands, lag, seed):
    heard = {}
    _simulate(sources("ring", islands, 2, 3), lag, 40, seed, Hearsay(np.zeros(0, FIND)), heard)
    for (island, epoch), (before, news) in heard.items():
        found = [(then, other) for then in range(epoch) for other in range(islands) if other != island]
        assert before == [(then, other) for then, other in found if then < epoch - lag - 1]
        assert news == [(then, other) for then, other in found if then == epoch - lag - 1]


def test_neighbours_wait_for_each_other_but_there_is_no_barrier():
    links = sources("ring", 6, 2, 0)
    schedule = Schedule(links, 1, {k: IslandState(-1, np.zeros(0, DTYPE)) for k in range(6)})
    for island, epoch in schedule.ready():
        schedule.start(island, epoch)
    for island in (0, 1, 2):
        schedule.finish(_record(island, 0))
    assert schedule.ready() == [(1, 1)]
    assert schedule.complete == -1


@pytest.mark.parametrize("lag", [1, 2, 3])
def test_a_restored_schedule_needs_the_emigrants_under_way(lag):
    links = sources("ring", 4, 2, 0)
    schedule = Schedule(links, lag, {k: IslandState(6, np.zeros(0, DTYPE)) for k in range(4)})
    assert schedule.ready() == []
    for island in range(4):
        for epoch in range(7 - lag, 7):
            schedule.remember(island, epoch, _record(island, epoch).born)
    assert schedule.ready() == [(k, 7) for k in range(4)]
    assert [(s, int(r["epoch"][0])) for s, r in schedule.start(2, 7)[0]] == [(1, 7 - lag), (3, 7 - lag)]
