"""The paper, made again: tiny experiments by default; all of it, as a user has it, with -m slow."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from fractal_farm.catalogue import Catalogue
from fractal_farm.cli.main import main
from fractal_farm.config import RunConfig
from fractal_farm.errors import InputError
from fractal_farm.experiments.paper import FIGURES, Scale, remake
from fractal_farm.experiments.paper import trial as trials
from fractal_farm.experiments.paper.cases import CASES, OURS, READINGS
from fractal_farm.experiments.paper.findings import best_fit, fig4, fig5
from fractal_farm.experiments.paper.trial import catalogue_of

ROOT = Path(__file__).parents[3]
TINY = Scale(experiments=2, generations=2, accepted=3, library=12, fractals=20)
CLIPPED = next(reading for reading in READINGS if reading.name == "clipped")
TIMES = ("seconds", "evaluation_s", "each_s")


def without_times(value):
    """What must be the same each time."""
    if isinstance(value, dict):
        return {key: without_times(each) for key, each in value.items() if key not in TIMES}
    return [without_times(each) for each in value] if isinstance(value, list) else value


def test_case_3_is_the_papers_experiment_on_isolated_islands():
    theirs = RunConfig.from_yaml(ROOT / "configs" / "paper.yaml").evolution.model_dump()
    ours = OURS.config("case3", Scale()).evolution.model_dump()
    differ = {key for key in ours if ours[key] != theirs[key]}
    assert differ <= {"islands", "generations_per_epoch", "migration"}
    assert ours["migration"]["topology"] == "isolated"
    assert (ours["islands"], ours["generations_per_epoch"]) == (10, 15)


def test_cases_1_and_2_are_random_and_differ_in_the_family_alone():
    first, second = (OURS.config(case, Scale()).evolution.model_dump() for case in CASES[:2])
    assert first["method"] == second["method"] == "random"
    assert {key for key in first if first[key] != second[key]} == {"phenotype"}
    assert (first["phenotype"]["family"], second["phenotype"]["family"]) == ("affine", "similarity")


def test_every_reading_changes_case_3_and_is_named_once():
    ids = {reading.config("case3", Scale()).run_id for reading in READINGS}
    assert len(ids) == len(READINGS) == len({reading.name for reading in READINGS})
    assert OURS.config("case2", TINY).run_id == CLIPPED.config("case2", TINY).run_id


@pytest.fixture(scope="module")
def remade(tmp_path_factory):
    """A tiny experiment with two readings; its directory and what it found."""
    root = tmp_path_factory.mktemp("paper") / "paper"
    heard = []
    results = remake(
        root,
        ("fig4", "fig5", "sensitivity"),
        TINY,
        workers=1,
        readings=(OURS, CLIPPED),
        tell=lambda *so_far: heard.append(so_far),
    )
    assert heard[0] == (0, 4)
    assert heard[-1] == (4, 4)
    return root, results


def test_figures_are_those_of_the_catalogue(remade):
    root, results = remade
    rows = Catalogue.open(catalogue_of(root, OURS.config("case3", TINY))).designs(["generation", "island", "fitness"])
    generation, island, fitness = (rows[name].to_numpy() for name in ("generation", "island", "fitness"))
    for number in (1, 2):
        means = [fitness[(generation == number) & (island == k)].mean() for k in range(2)]
        assert results["fig4"]["mean"][number - 1] == pytest.approx(np.mean(means))
        assert results["fig4"]["sd"][number - 1] == pytest.approx(np.std(means, ddof=1))
    assert fitness[generation > 0].min() >= 0.6
    assert results["fig5"]["cases"]["case2"]["evaluations"] == TINY.fractals


def test_the_report_is_one_page_that_names_the_differences(remade):
    root, results = remade
    page = (root / "report.html").read_text()
    assert json.loads((root / "results.json").read_text()) == json.loads(json.dumps(results))
    assert page.count('role="img"') == 1
    assert not re.search(r"<script|<link|https?://", page)
    for said in ("What the paper does not say", "The algorithm makes a factor of", "Best fit", "clipped"):
        assert said in page


def test_a_killed_command_goes_on_to_the_same_numbers(remade, tmp_path, monkeypatch):
    root = tmp_path / "paper"
    put = trials.put

    def dying(path, content):
        if len(list(path.parent.glob("*.json"))) == 2:
            raise KeyboardInterrupt
        put(path, content)

    monkeypatch.setattr(trials, "put", dying)
    with pytest.raises(KeyboardInterrupt):
        remake(root, ("fig5",), TINY, workers=1)
    monkeypatch.setattr(trials, "put", put)
    kept = {path: path.read_bytes() for path in (root / "runs").glob("*.json")}
    assert len(kept) == 2
    again = remake(root, ("fig4", "fig5"), TINY, workers=1)
    assert {path: path.read_bytes() for path in kept} == kept
    for name in ("fig4", "fig5"):
        assert without_times(again[name]) == without_times(remade[1][name])


def test_other_scales_figures_and_places_are_refused(remade, tmp_path):
    root, _ = remade
    with pytest.raises(InputError, match="name a new --out"):
        remake(root, ("fig4",), Scale(experiments=3), workers=1)
    with pytest.raises(InputError, match="choose from fig4"):
        remake(tmp_path / "new", ("fig3",), TINY)
    assert not (tmp_path / "new").exists()


def figures(mean, qualified, accepted=10, evaluated=15):
    """Figures of four experiments of one generation."""
    columns = {"mean": mean, "qualified": qualified, "accepted": [accepted] * 4, "evaluated": [evaluated] * 4}
    found = {name: [[value] for value in column] for name, column in columns.items()}
    return found | {"founders": found, "seconds": 1.0, "evaluation_s": 0.001}


def test_orders_and_their_confidence_are_told():
    low, middle, high = (
        figures([k, k + 0.01, k + 0.02, k + 0.03], [j, j, j, j + 1]) for k, j in ((0.1, 1), (0.5, 4), (0.8, 8))
    )
    clear = fig5({"case1": low, "case2": middle, "case3": high})
    assert clear["ordered"]
    assert clear["confidence"] > 0.9
    assert clear["cases"]["case3"]["excellent"][0] == pytest.approx(0.825)
    assert not fig5({"case1": middle, "case2": low, "case3": high})["ordered"]
    assert fig5({"case1": low, "case2": middle, "case3": middle})["confidence"] == 0.0
    assert fig4(high)["above"] == 1
    assert fig4(high)["evaluations_each"] == 1.5


def test_the_best_reading_agrees_in_most_and_costs_what_the_papers_did():
    rows = [{"name": name, "agrees": n, "evaluations_each": each} for name, n, each in
            (("a", 2, 1.62), ("b", 3, 1.4), ("c", 3, 1.5), ("d", 3, 3.2))]  # fmt: skip
    assert best_fit(rows)["name"] == "c"


@pytest.mark.slow
def test_farm_paper_all_makes_everything(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    out = str(tmp_path / "paper")
    assert main(["paper", "all", "--out", out, "--experiments", "5", "--json"]) == 0
    results = json.loads(capsys.readouterr().out)
    assert set(FIGURES) <= set(results)
    assert results["fig5"]["ordered"]
    assert results["fig5"]["confidence"] > 0.5  # of five experiments; ten give more
    above = {row["name"] for row in results["sensitivity"]["rows"] if row["above"] == row["generations"]}
    assert above
    assert all(name.startswith("clipped") for name in above)  # with ten experiments "clipped" itself is among them
    for piece in results["fig8"]["pieces"]:
        assert piece["certificates"][piece["metal"]]["passes"]
    for row in results["table1"]["rows"]:
        assert (row["watertight"], row["bodies"]) == (True, 1)
        assert max(row["grid"]) in (200, 201)
