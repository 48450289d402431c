"""`farm experiment methods`: its runs are the farm's, finds are measured again, and what it says is arithmetic."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue
from fractal_farm.cli import main
from fractal_farm.config import RunConfig
from fractal_farm.distinctness import DISTINCT, LENGTH, DistinctSet
from fractal_farm.errors import InputError
from fractal_farm.evolution.epoch import Candidates
from fractal_farm.experiments.methods import compare, trial
from fractal_farm.experiments.methods.course import Course, Finds
from fractal_farm.experiments.methods.presets import PRESETS, Preset
from fractal_farm.experiments.methods.remeasured import PRINTS, Counter, Measured, joined, measured_again
from fractal_farm.experiments.methods.verdict import (
    AIMS,
    Aim,
    factors,
    held_against,
    in_seconds,
    ratio,
    spread,
    summary,
)
from fractal_farm.farm.work import evaluate_candidates
from fractal_farm.ifs.gap import gap
from fractal_farm.ifs.genome import Genome, Phenotype
from tests.farm.runs import small_config

ROOT = Path(__file__).parents[2]
TINY = {
    "islands": 2,
    "generations_per_epoch": 1,
    "offspring": 24,
    "library": {"size": 16},
    "migration": {"emigrants": 2},
    "phenotype": {"points": 1000},
    "elimination": 0.75,
    "qualified": 0.8,
    "niches": {"expected_fitness": 0.8},
}
PAPER = {key: value for key, value in TINY.items() if key != "offspring"} | {"accepted": 5, "islands": 1}
SMALL = [
    Preset("niches", "small", {**TINY, "method": "niches"}),
    Preset("paper", "small", {**PAPER, "method": "paper", "library": {"size": 16, "growth": "append"}}),
]


def test_the_papers_preset_is_that_of_the_configuration_file():
    ours = PRESETS["paper"].config(2009).evolution
    assert ours == RunConfig.from_yaml(ROOT / "configs" / "paper.yaml").evolution
    assert PRESETS["niches"].config(5).evolution == RunConfig.from_dict({"evolution": {"seed": 5}}).evolution


@pytest.mark.parametrize(
    "overrides",
    [
        ("evolution.method=niches", "evolution.qualified=0.8", "evolution.niches.expected_fitness=0.8"),
        ("evolution.method=best",),
        ("evolution.method=paper", "evolution.offspring=null", "evolution.accepted=5", "evolution.islands=1"),
    ],
)
def test_a_course_is_the_farms_run(tmp_path, overrides):
    config = small_config(*overrides, "catalogue.keep=qualified", "stop.epochs=4")
    progress = farm.submit(config, tmp_path / "run", executor="serial").ended.progress
    course = Course(config.evolution)
    found = [course.epoch() for _ in range(4)]
    assert course.totals[-1].evaluated == progress.evaluated
    genomes = {
        Genome(genes[:count], Phenotype()).design_id
        for finds in found
        for genes, count in zip(finds.genes, finds.n_maps, strict=True)
    }
    published = Catalogue.open(tmp_path / "run").designs(["design_id"])["design_id"].to_pylist()
    assert len(published) == progress.kept_qualified > 10
    assert genomes.issuperset(published)
    numbers = np.concatenate([finds.number for finds in found])
    assert (np.diff(numbers) > 0).all()
    assert len(numbers) == progress.qualified


@pytest.fixture(scope="module")
def finds():
    """What a small random search found."""
    course = Course(small_config("evolution.method=random", "evolution.similarity_dimension=null").evolution)
    parts = [course.epoch() for _ in range(12)]
    return Finds(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def test_measuring_again_depends_on_the_genome_and_not_on_the_run(finds):
    one, two = (
        measured_again(finds, small_config(f"evolution.seed={seed}", "evolution.method=random").evolution)
        for seed in (1, 2)
    )
    for first, second in zip(one, two, strict=True):
        assert np.array_equal(first, second)
    assert len(one.number) > 50
    config = small_config().evolution
    kept = np.isin(finds.number, one.number)
    in_the_run = evaluate_candidates(Candidates(finds.genes[kept], finds.n_maps[kept]), config).values[:, 3]
    assert (in_the_run != one.fitness).mean() > 0.99
    assert one.fitness.min() > config.qualified


def test_luck_does_not_count(finds):
    """Of the finds nearest to the threshold, about half are below it with another cloud."""
    config = small_config().evolution
    fitness = evaluate_candidates(Candidates(finds.genes, finds.n_maps), config).values[:, 3]
    lucky = np.argsort(fitness)[:20]
    again = measured_again(Finds(*(column[lucky] for column in finds)), config)
    assert 2 <= len(again.number) <= 18


def counted(marks, fitness=None):
    """Designs with given signatures, of equal genomes."""
    n = len(marks)
    genes = np.tile(small_genome(), (n, 1, 1))
    ids = np.array([f"{k:032x}" for k in range(n)], "S32")
    fitness = np.linspace(1.0, 0.9, n) if fitness is None else fitness
    return Measured(np.arange(n), ids, genes, np.full(n, 2), fitness, marks, np.full(n, 1.5))


def small_genome():
    return np.array([[0.3, 0.1, 0.2, 0.7, 1.0, 0.0, 0.5], [1.1, 0.4, -0.3, 0.6, -1.0, 0.5, 0.0]])


def test_distinct_designs_are_those_that_a_distinct_set_keeps():
    marks = np.random.default_rng(4).normal(size=(2000, LENGTH))
    designs = counted(marks, np.random.default_rng(5).random(2000))
    order = np.argsort(-designs.fitness)
    _, entered = DistinctSet(np.zeros((0, LENGTH))).sift(marks[order])
    kept = Counter(designs, Phenotype()).distinct(designs)
    assert kept.number.tolist() == order[entered].tolist()
    assert 50 < len(kept.number) < 1900


def test_shapes_are_counted_once_and_the_best_of_each_stands():
    marks = np.zeros((5, LENGTH))
    marks[:, 0] = [0.0, 0.9 * DISTINCT, 1.8 * DISTINCT, 3.0 * DISTINCT, 3.0 * DISTINCT]
    designs = counted(marks)
    kept = Counter(designs, Phenotype()).distinct(designs)
    assert kept.number.tolist() == [0, 2, 3]


def test_what_does_not_print_covers_nothing_and_only_its_gap_is_searched():
    genes = small_genome()
    wide = genes.copy()
    wide[:, 3] = 0.1
    assert gap(genes) <= PRINTS < gap(wide)
    marks = np.zeros((4, LENGTH))
    marks[:, 0] = [0.0, 0.5, 0.6, 5.0]
    designs = counted(marks)
    designs.genes[[0, 3]] = wide
    counter = Counter(designs, Phenotype())
    figures, printable = counter.figures(4)
    assert printable.number.tolist() == [1]
    assert figures == {"qualified": 4, "distinct": 2, "printable": 1, "crisp": 1, "three_maps": 0.0}
    assert sorted(counter.gaps) == [0, 1, 3]  # not that of what the second covers
    assert counter.figures(1)[0] == {"qualified": 1, "distinct": 1, "printable": 0, "crisp": 0, "three_maps": None}


def test_a_genome_that_was_found_twice_counts_once():
    designs = counted(np.arange(3.0)[:, None] * np.ones(LENGTH) * 5)
    again = designs._replace(number=designs.number + 3)
    assert joined([designs, again]).number.tolist() == [0, 1, 2]


def figures_of(root, evaluations, config):
    """A result without its seconds."""
    result = trial.finished(root, config, evaluations)
    for entry in result["milestones"]:
        assert entry.pop("cpu_s") > 0
        assert entry.pop("wall_s") > 0
    return result


@pytest.fixture
def short_stretches(monkeypatch):
    monkeypatch.setattr(trial, "_STRETCH", 60)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    root = tmp_path_factory.mktemp("trial")
    config = SMALL[0].config(3)
    trial.run_trial(root, config, 400)
    return figures_of(root, 400, config)


@pytest.mark.parametrize("writes", range(0, 11, 2))
def test_a_run_that_dies_at_any_write_goes_on_to_the_same_figures(
    tmp_path, monkeypatch, short_stretches, undisturbed, writes
):
    config = SMALL[0].config(3)
    left = [writes]
    put = trial.put

    def dying(path, content):
        if not left[0]:
            raise KeyboardInterrupt
        left[0] -= 1
        put(path, content)

    monkeypatch.setattr(trial, "put", dying)
    with pytest.raises(KeyboardInterrupt):
        trial.run_trial(tmp_path, config, 400)
    monkeypatch.setattr(trial, "put", put)
    assert trial.finished(tmp_path, config, 400) is None
    trial.run_trial(tmp_path, config, 400)
    assert figures_of(tmp_path, 400, config) == undisturbed


def test_a_run_that_is_extended_is_one_long_run(tmp_path, short_stretches, undisturbed):
    config = SMALL[0].config(3)
    trial.run_trial(tmp_path, config, 150)
    trial.run_trial(tmp_path, config, 400)
    assert figures_of(tmp_path, 400, config) == undisturbed
    assert undisturbed["milestones"][-1]["crisp"] > 5
    ids = [design["design_id"] for design in undisturbed["sample"]]
    assert ids == sorted(ids)
    assert all(design["gap"] <= PRINTS for design in undisturbed["sample"])


def test_milestones_end_with_the_last_evaluation():
    assert trial.milestones(200) == [200]
    assert trial.milestones(1000) == [1000]
    assert trial.milestones(20_000) == [1000, 2000, 5000, 10_000, 20_000]
    assert trial.milestones(1_000_000)[-4:] == [100_000, 200_000, 500_000, 1_000_000]


def results(*crisp, at=20_000, share=0.5):
    """Results of so many seeds that found so much at one milestone."""
    found = {"qualified": 1000, "distinct": 500, "printable": 400}
    spent = {"foreseen": 0, "gap_searches": 0, "cpu_s": 10.0, "wall_s": 20.0}
    return [{"milestones": [{"evaluations": at, **found, **spent, "crisp": n, "three_maps": share}]} for n in crisp]


def test_spreads_and_ratios_are_those_of_the_seeds():
    assert spread([1, 2, 6]) == {"mean": 3, "sd": pytest.approx(7**0.5), "low": 1, "high": 6, "values": [1, 2, 6]}
    assert spread([4])["sd"] == 0
    assert spread([None, 2.0])["mean"] == 2
    assert spread([None])["mean"] is None
    assert ratio(spread([20, 40]), spread([1, 4])) == {"mean": 12.0, "low": 5.0, "high": 40.0}
    assert ratio(spread([20]), spread([0, 4])) == {"mean": 10.0, "low": 5.0, "high": None}
    assert ratio(spread([20]), spread([0])) is None
    each = summary(results(100, 200))[0]
    assert each["evaluations_each"]["values"] == [200, 100]
    assert each["cpu_s_each"]["mean"] == pytest.approx(0.075)


def test_aims_are_held_against_the_means():
    methods = {
        "niches": summary(results(3000, 5000)),
        "paper": summary(results(150, 250)),
        "best": summary(results(600)),
    }
    methods["best-plain"] = summary(results(300))
    verdicts = held_against(AIMS, methods)
    assert [(entry["over"], entry["reached"]) for entry in verdicts] == [("paper", True), ("best", False), (None, True)]
    assert verdicts[0]["found"] == 20.0
    assert "reached on the mean, not by every seed" in verdicts[0]["text"]
    assert "missed by a factor of 1.20" in verdicts[1]["text"]
    methods["niches"] = summary(results(4000, share=0.325))
    assert "missed by 2.5 points" in held_against(AIMS, methods)[2]["text"]
    assert held_against([Aim(1_000_000, 5.0, "paper")], methods) == []
    assert held_against(AIMS, {"paper": methods["paper"]}) == []


def test_processor_time_is_told_beside_evaluations():
    methods = {"niches": summary(results(1000)), "paper": summary(results(100, 400)), "best": summary(results(0))}
    assert in_seconds(methods) == "In processor time one costs niches 10.0 ms; paper 62.5 ms, 6.2 times as much."
    assert in_seconds({"paper": methods["paper"]}) is None


def test_factors_multiply_to_the_ratio():
    ours, theirs = (summary([{"milestones": [dict(entry)]}])[0] for entry in two_entries())
    found = factors(ours, theirs)
    assert found == {"qualified": 2.0, "distinct": 2.0, "printable": 0.5, "crisp": 4.0}
    assert np.prod(list(found.values())) == ours["crisp"]["mean"] / theirs["crisp"]["mean"]


def two_entries():
    spent = {"evaluations": 1000, "foreseen": 0, "gap_searches": 0, "cpu_s": 1.0, "wall_s": 1.0, "three_maps": 0.5}
    yield {**spent, "qualified": 800, "distinct": 400, "printable": 100, "crisp": 80}
    yield {**spent, "qualified": 400, "distinct": 100, "printable": 50, "crisp": 10}


def test_an_experiment_writes_its_figures_a_page_and_sheets_and_goes_on_with_more_seeds(tmp_path):
    root = tmp_path / "experiment"
    heard = []
    first = compare(root, SMALL, 1, 200, workers=1, tell=heard.append)
    assert (heard[0].trials, heard[-1].trials, heard[-1].evaluations) == (0, 2, 400)
    report = compare(root, SMALL, 2, 200, workers=1)
    assert json.loads((root / "results.json").read_text()) == json.loads(json.dumps(report))
    for name in ("niches", "paper"):
        once, twice = (found["methods"][name]["milestones"][-1]["crisp"]["values"] for found in (first, report))
        assert twice[:1] == once
        assert len(twice) == 2
        assert (root / "sheets" / f"{name}.jpg").read_bytes().startswith(b"\xff\xd8")
    page = (root / "report.html").read_text()
    assert page.count("<svg") == 5
    assert page.count("data:image/jpeg;base64,") == 2
    assert not re.search(r"<script|<link|https?://", page)
    assert "cannot say whether they are reached" in page


def test_a_directory_of_something_else_or_of_other_sources_is_refused(tmp_path, monkeypatch):
    (tmp_path / "letter").write_text("dear")
    with pytest.raises(InputError, match="holds something else"):
        compare(tmp_path, SMALL, 1, 200)
    with pytest.raises(InputError, match="is a file; name another place"):
        compare(tmp_path / "letter" / "experiment", SMALL, 1, 200)
    root = tmp_path / "experiment"
    root.mkdir()
    (root / ".experiment.json.of-a-killed-attempt.partial").touch()
    compare(root, SMALL[1:], 1, 100, workers=1)
    monkeypatch.setattr("fractal_farm.experiments.methods.comparison.sources", lambda: "0123456789abcdef")
    with pytest.raises(InputError, match="name a new --out"):
        compare(root, SMALL[1:], 1, 100, workers=1)


@pytest.mark.parametrize("names", ["niches,nonsense", "", "best,best"])
def test_methods_that_are_none_are_refused_in_one_line(tmp_path, capsys, names):
    assert main(["experiment", "methods", "--out", str(tmp_path / "new"), "--methods", names]) == 2
    error = capsys.readouterr().err
    assert error.startswith("farm: error: --methods")
    assert error.count("\n") == 1
    assert not (tmp_path / "new").exists()


def test_the_help_names_every_preset(capsys):
    assert main(["experiment", "methods", "--help"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert ", ".join(PRESETS) in said


def test_the_command_prints_what_was_found(tmp_path, capsys):
    words = ["--out", str(tmp_path / "new"), "--methods", "paper,random-plain", "--evaluations", "200", "--seeds", "2"]
    assert main(["experiment", "methods", *words, "--workers", "1"]) == 0
    said = capsys.readouterr()
    assert re.search(r"^paper +\d+ +\d+", said.out, re.MULTILINE)
    assert "4 of 4 runs, 800 of 800 evaluations" in said.err


@pytest.mark.slow
def test_workers_end_with_the_command_and_another_goes_on(tmp_path):
    program = "import sys; from fractal_farm.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", program, "experiment", "methods", "--out", str(tmp_path / "new")]
    command += ["--methods", "best,random", "--evaluations", "40000", "--seeds", "1", "--workers", "2"]
    process = subprocess.Popen(command, start_new_session=True)
    runs = tmp_path / "new" / "runs"
    deadline = time.monotonic() + 300
    while not list(runs.glob("*/state~*")):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.1)
    process.send_signal(signal.SIGKILL)
    process.wait()
    while list(members(process.pid)):
        assert time.monotonic() < deadline
        time.sleep(0.1)
    assert not list(runs.glob("*/result~*"))
    assert subprocess.run(command, check=False).returncode == 0
    assert len(list(runs.glob("*/result~40000.json"))) == 2


def members(session):
    """Live processes of a session."""
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = status.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if fields[0] != "Z" and int(fields[3]) == session and int(status.parent.name) != os.getpid():
            yield int(status.parent.name)
