"""Runs bred from chosen designs: nobody else is in their family, and children resemble their parents."""

import shutil

import numpy as np
import pytest

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue, judge
from fractal_farm.errors import InputError
from fractal_farm.hand.breeding import breeding_config, favourites, founders_of
from fractal_farm.hand.keeping import keep
from fractal_farm.ifs.genome import Genome
from tests.farm.test_niches import marks_of, published

FEW = ("evolution.offspring=64", "evolution.islands=2", "catalogue.durability=process")


def bred(root, chosen, out, *overrides):
    config = breeding_config(founders_of(root, chosen), [*FEW, *overrides])
    return farm.submit(config, out, executor="serial")


@pytest.fixture(scope="module")
def brood(grown, ids, tmp_path_factory):
    """Three parents, and the catalogue of two generations of their descendants."""
    path = tmp_path_factory.mktemp("brood") / "run"
    return ids[:3], bred(grown, ids[:3], path, "stop.epochs=2"), path


def test_every_design_descends_from_the_chosen_ones_and_from_nobody_else(brood):
    chosen, _, path = brood
    rows = Catalogue.open(path).designs(["design_id", "parents", "operator"], ancestors=True).to_pylist()
    parents = {row["design_id"]: row["parents"] for row in rows}
    assert sorted(row["design_id"] for row in rows if row["operator"] == "seed") == chosen
    assert len(rows) > 20
    for row in rows:
        line = {row["design_id"]}
        while not line <= set(chosen):
            assert all(parents[one] for one in line - set(chosen))
            line = {parent for one in line for parent in (parents[one] or [one])}


def test_children_differ_from_their_parents_by_small_moves(brood):
    _, _, path = brood
    rows = {row["design_id"]: row for row in Catalogue.open(path).designs(ancestors=True).to_pylist()}
    mutants = [row for row in rows.values() if row["operator"] == "mutation"]
    assert len(mutants) > 20
    moves = []
    for row in mutants:
        (parent,) = row["parents"]
        change = (np.array(row["genes"]) - np.array(rows[parent]["genes"])).reshape(-1, 7)
        change[:, :3] = np.remainder(change[:, :3] + np.pi, 2 * np.pi) - np.pi
        moves += [abs(move) for move in change.ravel() if abs(move) > 1e-12]
    assert 0.01 < np.median(moves) < 0.1
    assert max(moves) < 0.6  # six times the widest scale
    marks = marks_of(published(path))
    seeds = np.array([rows[one]["operator"] == "seed" for one in published(path).column("design_id").to_pylist()])
    nearest = np.linalg.norm(marks[~seeds][:, None] - marks[seeds][None], axis=2).min(axis=1)
    assert np.quantile(nearest, 0.1) < 3.0


def test_a_brood_depends_on_the_set_of_parents_and_the_seed_alone(brood, grown, tmp_path):
    chosen, summary, _ = brood
    again = bred(grown, [chosen[2], chosen[0], chosen[1][:12], chosen[0]], tmp_path / "again", "stop.epochs=2")
    assert again.run_id == summary.run_id
    assert again.ended.digest == summary.ended.digest
    other = breeding_config(founders_of(grown, chosen), [*FEW, "evolution.seed=1"])
    assert other.run_id != summary.run_id


def test_a_single_parent_has_children(grown, ids, tmp_path):
    bred(grown, ids[:1], tmp_path / "run")
    rows = Catalogue.open(tmp_path / "run").designs(["parents", "operator"]).to_pylist()
    children = [row for row in rows if row["operator"] != "seed"]
    assert children
    assert all(set(row["parents"]) == {ids[0]} for row in children)


def test_a_favourite_of_poor_fitness_and_wide_gap_is_bred_all_the_same(grown, tmp_path):
    shutil.copytree(grown, tmp_path / "grown")
    poor = Genome(np.array([[0.3, 0, 0, 0.35, 0, 0, 0], [0, 0.4, 0, 0.3, 1.5, 0.5, 0], [0, 0, 1, 0.3, 0, 1, 1]]))
    (row,) = keep(tmp_path / "grown", [poor])
    founders = founders_of(tmp_path / "grown", [row["design_id"]])
    assert row["fitness"] < founders.config.evolution.qualified
    assert row["gap"] > founders.config.evolution.niches.gap
    summary = bred(tmp_path / "grown", [row["design_id"]], tmp_path / "run")
    rows = Catalogue.open(tmp_path / "run").designs(["parents", "operator"]).to_pylist()
    assert summary.ended.progress.designs == len(rows) > 3
    assert {parent for row in rows for parent in row["parents"]} == {poor.design_id}


def test_a_brood_that_joins_the_catalogue_leaves_its_runs_and_the_parents_lineage_as_they_were(grown, ids, tmp_path):
    path = tmp_path / "run"
    shutil.copytree(grown, path)
    catalogue = Catalogue.open(path)
    (first,) = catalogue.runs()
    chosen = [row["design_id"] for row in catalogue.designs(["design_id", "parents"]).to_pylist() if row["parents"]][:2]
    before = catalogue.digest(first.run_id), [catalogue.design(one) for one in chosen]
    config = breeding_config(founders_of(path, chosen), FEW)
    farm.submit(config, path, executor="serial", into=True)
    catalogue = Catalogue.open(path)
    assert {run.run_id for run in catalogue.runs()} == {first.run_id, config.run_id}
    assert (catalogue.digest(first.run_id), [catalogue.design(one) for one in chosen]) == before
    children = [row for row in catalogue.designs(["parents"], config.run_id).to_pylist() if row["parents"]]
    assert {parent for row in children for parent in row["parents"]} == set(chosen)


def test_favourites_are_found_or_the_remedy_is_named(grown, ids, tmp_path):
    shutil.copytree(grown, tmp_path / "run")
    with pytest.raises(InputError, match=r"farm rate .* --favourite"):
        favourites(tmp_path / "run")
    judge(tmp_path / "run", ids[3:5], favourite=True)
    judge(tmp_path / "run", ids[5:6], stars=5)
    assert favourites(tmp_path / "run") == ids[3:5]


def test_designs_with_probabilities_set_by_hand_cannot_be_parents(grown, ids, tmp_path):
    shutil.copytree(grown, tmp_path / "run")
    genome = Catalogue.open(grown).genome(ids[0])
    by_hand = Genome(genome.genes, genome.phenotype, (1.0 / genome.n_maps,) * genome.n_maps)
    keep(tmp_path / "run", [by_hand])
    with pytest.raises(InputError, match="probabilities"):
        founders_of(tmp_path / "run", [by_hand.design_id])
