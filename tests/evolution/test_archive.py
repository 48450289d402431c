"""The archive: who enters, who is a hit, who gives way, who breeds."""

import numpy as np
import pytest

from fractal_farm.config import EvolutionConfig
from fractal_farm.distinctness import DISTINCT, projection
from fractal_farm.evolution.archive import Archive, parent_weights, signatures_of
from fractal_farm.evolution.designs import design_dtype
from fractal_farm.evolution.epoch import IslandState, Scores, founding_state, library_after
from fractal_farm.evolution.island import advance, drive
from fractal_farm.farm.work import evaluate_candidates

NICHES = EvolutionConfig.model_validate(
    {
        "method": "niches",
        "offspring": 48,
        "generations_per_epoch": 2,
        "library": {"size": 60},
        "phenotype": {"points": 1000},
        "qualified": 0.7,
    }
)


def with_capacity(capacity):
    return NICHES.model_copy(update={"niches": NICHES.niches.model_copy(update={"capacity": capacity})})


def rows_at(places, gap=np.nan, n_maps=2, first_slot=0):
    """Rows whose signatures are the given places (n, 6)."""
    places = np.atleast_2d(np.asarray(places, float))
    rows = np.zeros(len(places), design_dtype(3, 7))
    features = places @ np.linalg.pinv(np.array(projection())).T
    rows["descriptor"], rows["d0"], rows["d2"] = features[:, :14], features[:, 14], features[:, 15]
    rows["gap"], rows["n_maps"] = gap, n_maps
    rows["slot"] = first_slot + np.arange(len(places))
    rows["design_id"] = [f"{slot:032x}".encode() for slot in rows["slot"].tolist()]
    return rows


def empty():
    return rows_at(np.zeros((0, 6)))


def test_what_enters_is_what_a_greedy_pass_over_all_finds():
    generator = np.random.default_rng(1)
    archive, kept, hits = Archive(empty(), NICHES), [], []
    for batch in range(6):
        places = generator.normal(size=(80, 6)) * 0.6
        marks = signatures_of(rows_at(places))
        entered, _ = archive.sift(rows_at(places, first_slot=80 * batch))
        expected = []
        for index, place in enumerate(marks):
            distances = [np.linalg.norm(place - other) for other in kept]
            if distances and min(distances) < DISTINCT:
                hits[int(np.argmin(distances))] += 1
            else:
                kept.append(place)
                hits.append(0)
                expected.append(index)
        assert entered == expected
        if batch == 2:  # members move from memory into the tree
            archive = Archive(archive.library, NICHES)
    assert np.allclose(signatures_of(archive.library), kept, atol=1e-5)
    assert archive.library["hits"].tolist() == hits


def test_what_is_like_a_shape_found_elsewhere_neither_enters_nor_is_a_hit():
    archive = Archive(rows_at([[0] * 6]), NICHES)
    archive.hear(signatures_of(rows_at([[9] * 6])))
    entered, rivals = archive.sift(rows_at([[9.1] * 6, [0.1] * 6, [20] * 6, [20.1] * 6], first_slot=1))
    assert (entered, rivals) == ([2], [(1, 0)])
    assert archive.library["hits"].tolist() == [1, 1]


def test_a_migrant_counts_its_hits_though_there_is_news_of_it():
    archive = Archive(rows_at([[0] * 6, [9] * 6]), NICHES)
    archive.hear(signatures_of(rows_at([[9] * 6, [30] * 6])))
    entered, rivals = archive.sift(rows_at([[9.1] * 6, [20] * 6, [20.1] * 6, [30] * 6], first_slot=2))
    assert (entered, rivals) == ([1], [(0, 1)])
    assert archive.library["hits"].tolist() == [0, 1, 1]


def test_a_near_duplicate_with_a_smaller_gap_takes_the_place_of_a_member_that_does_not_print():
    wide, printable = 0.2, 0.01
    archive = Archive(np.concatenate([rows_at([[0] * 6], wide), rows_at([[5] * 6], printable, first_slot=1)]), NICHES)
    offered = rows_at([[0.1] * 6, [5.1] * 6, [9] * 6], first_slot=2)
    entered, rivals = archive.sift(offered)
    assert (entered, rivals) == ([2], [(0, 0)])
    challenger = offered[[0]]
    challenger["gap"] = 0.19
    assert len(archive.replace(challenger, [0])) == 0
    challenger["gap"] = 0.1
    assert archive.replace(challenger, [0])["slot"].tolist() == [2]
    assert archive.library["gap"][0] == pytest.approx(0.1)
    assert archive.library["hits"].tolist() == [1, 1, 0]


def test_each_number_of_maps_has_its_quota_and_few_hits_and_small_gaps_weigh_more():
    limit = NICHES.niches.gap
    library = np.concatenate([rows_at(np.zeros((3, 6)), limit), rows_at(np.zeros((1, 6)), limit, n_maps=3)])
    library["hits"] = [0, 1, 0, 7]
    library["gap"][2] = 4 * limit
    weights = parent_weights(library, NICHES)
    assert weights[:3].sum() == pytest.approx(0.5)
    assert weights[3] == pytest.approx(0.5)
    assert weights[0] / weights[1] == pytest.approx(4)
    assert weights[0] / weights[2] == pytest.approx(4)
    library["gap"] = np.nan
    assert np.all(parent_weights(library, NICHES) > 0)


def test_beyond_capacity_the_crowded_and_those_with_wide_gaps_leave():
    rows = rows_at(np.arange(6)[:, None] * 3.0 * np.ones(6), 0.01)
    rows["hits"] = [0, 50, 0, 0, 60, 0]
    rows["gap"][3] = 0.5
    archive = Archive(rows, with_capacity(3))
    archive.trim()
    assert archive.library["slot"].tolist() == [0, 2, 5]
    entered, _ = archive.sift(rows_at([[3.0] * 6], first_slot=9))  # the place of one that left is free again
    assert entered == [0]


def evolve(epochs, batch=None, config=NICHES):
    def evaluate(candidates):
        if batch is None:
            return evaluate_candidates(candidates, config)
        parts = []
        for start in range(0, len(candidates.n_maps), batch):
            cut = slice(start, start + batch)
            part = candidates.part(cut)
            parts.append(evaluate_candidates(part, config))
        return Scores(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    state, records = founding_state(config), []
    for epoch in range(epochs):
        record = drive(advance(state, [], config, 0, epoch), evaluate)
        state = IslandState(epoch, library_after(state.library, record))
        records.append(record)
    return state, records


def test_an_island_keeps_an_archive_of_distinct_qualified_designs_with_their_gaps():
    state, records = evolve(4)
    library = state.library
    assert len(library) > 20
    assert np.all(library["fitness"] > NICHES.qualified)
    assert np.all(np.isfinite(library["gap"]) & np.isfinite(library["descriptor"]).all(axis=1))
    marks = signatures_of(library)
    distances = np.linalg.norm(marks[:, None] - marks[None], axis=2)[np.triu_indices(len(marks), 1)]
    assert np.mean(distances >= DISTINCT) > 0.995  # those that took a place lie a little beside it
    assert library["hits"].sum() > 0
    born = np.concatenate([record.born for record in records])
    assert set(library["design_id"].tolist()) <= set(born["design_id"].tolist())
    assert len(set(born["operator"].tolist())) > 2


def test_an_archive_does_not_depend_on_the_batches():
    whole, parts = evolve(3)[0], evolve(3, batch=7)[0]
    assert whole.library.tobytes() == parts.library.tobytes()


def test_arrivals_enter_where_they_are_distinct():
    state, _ = evolve(2)
    foreign = rows_at([[40.0] * 6, [40.01] * 6], 0.01, first_slot=1000)
    foreign["fitness"] = 0.99
    near = state.library[:1].copy()
    near["design_id"] = b"f" * 32
    steps = advance(state, [(1, foreign), (2, near)], NICHES, 0, 2)
    record = drive(steps, lambda candidates: evaluate_candidates(candidates, NICHES))
    assert record.settled == 1
    assert record.entrants["slot"].tolist().count(1000) == 1
