"""Islands are driven with a landscape of our own: what evolution decides must not depend on what a score means."""

import sys
from subprocess import run

import numpy as np
import pytest

from fractal_farm.config import EvolutionConfig
from fractal_farm.evolution.designs import Operator, design_dtype, total_order
from fractal_farm.evolution.epoch import Candidates, IslandState, Scores, founding_state, library_after
from fractal_farm.evolution.island import advance, drive
from fractal_farm.ifs.genome import Genome
from tests.table1 import TABLE1


def landscape(candidates: Candidates) -> Scores:
    """Fitness falls with the distance of the offsets from the origin; genomes with a steep first pitch are refused."""
    scores = Scores.unknown(len(candidates.n_maps))
    values, refusals = scores.values, scores.refusals
    values[:] = 0.0
    values[:, 3] = np.clip(1.0 - np.abs(candidates.genes[:, :, 4:]).sum(axis=(1, 2)) / 10.0, 0.0, 1.0)
    refusals[:] = candidates.genes[:, 0, 0] > 3.0
    values[refusals > 0, 3] = 0.0
    return scores


def evolve(config, epochs, island=0, inbox=(), evaluate=landscape):
    state, records = founding_state(config), []
    for epoch in range(epochs):
        record = drive(advance(state, list(inbox), config, island, epoch), evaluate)
        state = IslandState(epoch, library_after(state.library, record))
        records.append(record)
    return state, records


SMALL = EvolutionConfig.model_validate(
    {
        "method": "best",
        "offspring": 40,
        "generations_per_epoch": 3,
        "library": {"size": 20},
        "migration": {"emigrants": 3},
    }
)
PAPER = EvolutionConfig.model_validate(
    {
        "method": "paper",
        "accepted": 10,
        "library": {"size": 30, "growth": "append"},
        "migration": {"topology": "isolated"},
        "similarity_dimension": None,
    }
)


def test_the_library_keeps_the_best_of_all_that_were_born():
    state, records = evolve(SMALL, 4)
    born = np.concatenate([record.born for record in records])
    best = born[total_order(born)][:20]
    assert state.library["design_id"].tolist() == best["design_id"].tolist()
    assert len(np.unique(born["design_id"])) == len(born)


def test_evolution_improves_on_chance():
    chosen, _ = evolve(SMALL, 6)
    chance, _ = evolve(SMALL.model_copy(update={"method": "random"}), 6)
    assert chosen.library["fitness"].mean() > chance.library["fitness"].mean() + 0.1


def test_the_same_epoch_is_the_same_and_another_seed_island_or_lag_is_another():
    one, _ = evolve(SMALL, 2)
    again, _ = evolve(SMALL, 2)
    assert one.library.tobytes() == again.library.tobytes()
    other_seed, _ = evolve(SMALL.model_copy(update={"seed": 1}), 2)
    other_island, _ = evolve(SMALL, 2, island=1)
    assert len({one.library.tobytes(), other_seed.library.tobytes(), other_island.library.tobytes()}) == 3


def test_a_record_rebuilds_the_library_from_the_one_before():
    state, records = evolve(SMALL, 5)
    library = founding_state(SMALL).library
    for record in records:
        library = library_after(library, record)
        assert len(np.unique(library["design_id"])) == len(library)
    assert library.tobytes() == state.library.tobytes()
    assert len(records[-1].entrants) < len(library)


def test_identities_and_lineage_are_those_of_the_genomes():
    _, records = evolve(SMALL, 3)
    born = np.concatenate([record.born for record in records])
    known = set()
    for row in born:
        genome = Genome(row["genes"][: row["n_maps"]], SMALL.phenotype.phenotype())
        assert genome.design_id.encode() == row["design_id"]
        parents = [parent for parent in row["parents"] if parent]
        expected = {Operator.RANDOM: 0, Operator.MUTATION: 1, Operator.CROSSOVER: 2, Operator.CROSSOVER_MUTATION: 2}
        assert len(parents) == expected[Operator(row["operator"])]
        assert known.issuperset(parents)
        known.add(row["design_id"])
    assert {Operator.RANDOM, Operator.CROSSOVER_MUTATION} <= {Operator(row["operator"]) for row in born}


def test_refused_genomes_neither_join_nor_count_as_accepted():
    _, records = evolve(SMALL, 3)
    entries = [entry for record in records for entry in record.statistics]
    assert sum(entry.refused for entry in entries) > 0
    assert all((record.born["genes"][:, 0, 0] <= 3.0).all() for record in records)
    assert [entry.generation for entry in entries] == list(range(10))


def test_inferior_offspring_are_eliminated_but_founders_are_not():
    _, records = evolve(SMALL, 2)
    born = np.concatenate([record.born for record in records])
    founders = born["generation"] == 0
    assert born["fitness"][founders].min() < SMALL.elimination
    assert born["fitness"][~founders].min() >= SMALL.elimination


def test_seeds_come_first_and_keep_every_bit():
    seeds = tuple(tuple(tuple(row) for row in TABLE1[name]) for name in ("06328", "06582"))
    library = SMALL.library.model_copy(update={"seeds": seeds})
    _, records = evolve(SMALL.model_copy(update={"library": library}), 1)
    planted = records[0].born[records[0].born["operator"] == Operator.SEED]
    assert [row["genes"][: row["n_maps"]].tolist() for row in planted] == [TABLE1["06328"], TABLE1["06582"]]


def test_the_papers_generation_accepts_exactly_ten_in_the_order_of_slots():
    blocks = []

    def watched(candidates):
        scores = landscape(candidates)
        blocks.append(scores)
        return scores

    state, records = evolve(PAPER, 2, evaluate=watched)
    entries = [entry for record in records for entry in record.statistics[-5:]]
    assert [entry.accepted for entry in entries] == [10] * 10
    assert [entry.joined for entry in entries] == [10] * 10
    founders = records[0].statistics[0].joined
    assert len(state.library) == founders + 100
    first = records[0].born[records[0].born["generation"] == 1]
    fitness = np.concatenate([block.values[block.refusals == 0, 3] for block in blocks[1:]])
    assert first["fitness"].tolist() == fitness[fitness >= PAPER.elimination][:10].tolist()
    assert entries[0].evaluated == first["slot"][-1] + 1


def test_a_slot_that_never_fits_the_similarity_dimensions_stays_empty():
    narrow = SMALL.model_copy(update={"similarity_dimension": (1.0, 1.02)})
    _, records = evolve(narrow, 1)
    founding, *bred = records[0].statistics
    assert 0 < founding.evaluated < 20
    assert min(entry.evaluated for entry in bred) < 40
    for row in records[0].born:
        rho = row["genes"][: row["n_maps"], 3]
        assert rho.sum() >= 1.0 >= (rho**1.02).sum()


def test_arrivals_settle_before_the_first_generation_and_can_become_parents():
    _, records = evolve(SMALL, 2, island=1)
    state, _ = evolve(SMALL, 1)
    arrivals = records[1].born[total_order(records[1].born)][:3].copy()
    arrivals["fitness"] = 0.99
    record = drive(advance(state, [(1, arrivals)], SMALL, 0, 1), landscape)
    assert record.settled == 3
    assert record.arrivals == ((1, 3),)
    after = library_after(state.library, record)
    assert set(arrivals["design_id"].tolist()) <= set(after["design_id"].tolist())
    parents = set(record.born["parents"].ravel().tolist())
    assert parents & set(arrivals["design_id"].tolist())
    # They were born elsewhere, and keep their birth place.
    assert set(after["island"].tolist()) == {0, 1}


def test_emigrants_are_members_of_the_new_library():
    state, records = evolve(SMALL, 2)
    assert records[-1].emigrants.tolist() == total_order(state.library)[:3].tolist()


@pytest.mark.parametrize("family", ["similarity", "affine"])
def test_both_families_evolve(family):
    config = SMALL.model_copy(update={"phenotype": SMALL.phenotype.model_copy(update={"family": family})})
    state, _ = evolve(config, 2)
    assert state.library["genes"].shape == (20, 3, 7 if family == "similarity" else 12)
    assert state.library["fitness"].max() > 0.5


def test_islands_import_neither_numba_nor_ray_nor_storage():
    code = (
        "import sys, fractal_farm.evolution.island, fractal_farm.farm.work;"
        "print(sorted({'numba', 'ray', 'zarr', 'pyarrow', 'scipy'} & set(sys.modules)))"
    )
    done = run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_arrivals_of_several_sources_do_not_take_each_others_places():
    state, _ = evolve(SMALL, 1)
    _, records = evolve(SMALL, 1, island=1)
    arrivals = records[0].born[:10].copy()
    arrivals["fitness"] = 0.999
    record = drive(advance(state, [(1, arrivals[:5]), (2, arrivals[5:])], SMALL, 0, 1), landscape)
    after = set(library_after(state.library, record)["design_id"].tolist())
    assert record.settled == 10
    assert set(arrivals["design_id"].tolist()) <= after


def test_an_island_without_founders_takes_in_what_arrives():
    config = SMALL.model_copy(update={"similarity_dimension": (2.9999, 3.0)})
    founded, _ = evolve(config, 1)
    assert len(founded.library) == 0
    _, records = evolve(SMALL, 1, island=1)
    record = drive(advance(founded, [(1, records[0].born[:3])], config, 0, 1), landscape)
    assert record.settled >= 1


def test_rows_of_records_from_before_there_were_symmetries_are_rows_without_one():
    dtype = design_dtype(3, 7)
    before = np.dtype([(name, "<i8") if name == "n_maps" else (name, dtype[name]) for name in dtype.names[:3]])
    row = np.zeros(1, before)
    row["n_maps"] = 3
    now = np.frombuffer(row.tobytes(), np.dtype([(name, dtype[name]) for name in dtype.names[:4]]))
    assert dtype.names[2:4] == ("n_maps", "symmetry")
    assert (now["n_maps"][0], now["symmetry"][0]) == (3, 0)
