"""Batches that kill their workers: what is set aside, and what never is."""

import functools
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fractal_farm import farm
from fractal_farm.catalogue import committed_records
from fractal_farm.errors import FarmError
from fractal_farm.evolution.epoch import Candidates, founding_state
from fractal_farm.evolution.offspring import founders
from fractal_farm.farm import executor, trials
from fractal_farm.farm.events import Fault
from fractal_farm.farm.journal import Journal
from fractal_farm.farm.records import unpack_ledger
from fractal_farm.farm.trials import DEATHS, Death, evaluate_with_care, trial
from fractal_farm.farm.work import evaluate_candidates, split
from tests.farm import deadly
from tests.farm.runs import Recorder, small_config

CONFIG = small_config().evolution
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def candidates():
    brood = founders(CONFIG.model_copy(update={"library": CONFIG.library.model_copy(update={"size": 400})}), 1)
    return Candidates(brood.genes, brood.n_maps)


class Workers:
    """Workers that evaluate, unless a script says how they are lost; they count what they are asked."""

    def __init__(self, is_lost, alone=()):
        self.is_lost, self.alone = is_lost, list(alone)
        self.batches, self.trials = [], 0

    def evaluate_all(self, batches):
        self.batches += [len(batch.n_maps) for batch in batches]
        return [None if self.is_lost(batch) else evaluate_candidates(batch, CONFIG) for batch in batches]

    def try_alone(self, single):
        self.trials += 1
        outcome = self.alone.pop(0)
        return evaluate_candidates(single, CONFIG) if outcome is None else outcome

    def scores(self, candidates, size):
        return evaluate_with_care(split(candidates, size), self.evaluate_all, self.try_alone, CONFIG)


def _holds(genes):
    return lambda batch: any(np.array_equal(row, genes) for row in batch.genes)


@pytest.mark.parametrize("size", [None, 7, 64])
def test_one_deadly_genome_is_found_and_all_others_keep_their_scores(candidates, size):
    workers = Workers(_holds(candidates.genes[123]), [Death(signal.SIGSEGV)] * DEATHS)
    scores, set_aside = workers.scores(candidates, size)
    whole = evaluate_candidates(candidates, CONFIG)
    others = np.arange(len(candidates.n_maps)) != 123
    np.testing.assert_array_equal(scores.values[others], whole.values[others])
    assert scores.refusals[123] == 3
    assert scores.values[123, 3] == 0.0
    assert len(set_aside) == 1
    assert "SIGSEGV, SIGSEGV, SIGSEGV" in set_aside[0].reason
    np.testing.assert_array_equal(set_aside[0].genes, candidates.genes[123, : candidates.n_maps[123]])
    assert workers.trials == DEATHS


def test_kills_from_outside_set_nobody_aside(candidates):
    few = Candidates(candidates.genes[:5], candidates.n_maps[:5])
    outside = [Death(signal.SIGKILL), Death(signal.SIGTERM), Death(signal.SIGSEGV)] * 2
    workers = Workers(_holds(few.genes[2]), [*outside, Death(signal.SIGKILL), None])
    scores, set_aside = workers.scores(few, None)
    np.testing.assert_array_equal(scores.values, evaluate_candidates(few, CONFIG).values)
    assert not set_aside
    assert workers.trials == 8


def test_who_is_killed_for_ever_ends_the_run_with_a_line(candidates):
    workers = Workers(lambda batch: True, [Death(signal.SIGKILL)] * 1000)
    with pytest.raises(FarmError, match="from outside"):
        workers.scores(Candidates(candidates.genes[:1], candidates.n_maps[:1]), None)


def test_a_machine_on_which_everything_dies_sets_nobody_aside(candidates):
    workers = Workers(lambda batch: True, [Death(signal.SIGILL, control=True)])
    with pytest.raises(FarmError, match=r"SIGILL.*doctor"):
        workers.scores(Candidates(candidates.genes[:1], candidates.n_maps[:1]), None)


def test_a_batch_lost_once_is_done_again_as_it_is(candidates):
    lost = iter([True])
    workers = Workers(lambda batch: next(lost, False))
    workers.scores(candidates, None)
    assert workers.batches == [len(candidates.n_maps)] * 2


def _deadly_one(candidates):
    index = int(np.flatnonzero(deadly.deadly(np.ascontiguousarray(candidates.genes)))[0])
    return Candidates(candidates.genes[index : index + 1], candidates.n_maps[index : index + 1])


def test_a_trial_tells_how_its_process_died(candidates):
    assert trial(deadly.dies, _deadly_one(candidates), CONFIG) == Death(signal.SIGSEGV)
    assert trial(deadly.dies_of_everything, _deadly_one(candidates), CONFIG) == Death(signal.SIGILL, control=True)


def test_a_trial_gives_the_scores_of_who_survives(candidates):
    single = Candidates(candidates.genes[:1], candidates.n_maps[:1])
    scores = trial(evaluate_candidates, single, CONFIG)
    np.testing.assert_array_equal(scores.values, evaluate_candidates(single, CONFIG).values)


@pytest.mark.slow
def test_a_trial_that_does_not_end_is_ended_by_its_bound(candidates):
    assert trial(deadly.never_ends, _deadly_one(candidates), CONFIG) == Death(signal.SIGPROF)


def _serial(tmp_path, monkeypatch, config, evaluate):
    """A run in this process with evaluations of our own."""
    monkeypatch.setattr(
        "fractal_farm.farm.workforce.SerialExecutor", functools.partial(executor.SerialExecutor, evaluate=evaluate)
    )
    return farm.submit(config, tmp_path / "serial", executor="serial")


def _on_ray(tmp_path, monkeypatch, config, evaluate, callbacks=()):
    from fractal_farm.farm.on_ray import executor as on_ray

    monkeypatch.setattr(on_ray, "RayExecutor", functools.partial(on_ray.RayExecutor, evaluate=evaluate))
    return farm.submit(config, tmp_path / "ray", executor="ray", callbacks=callbacks)


def _verdicts(root, config):
    dtype = founding_state(config.evolution).library.dtype
    ledgers = [unpack_ledger(blob, dtype) for _, blob in committed_records(root, config.run_id)]
    return [verdict for ledger in ledgers for _, _, verdict in ledger.set_aside]


SESSION = """
import functools, sys
from pathlib import Path
from fractal_farm import farm
from fractal_farm.farm import executor, workforce
from tests.farm import deadly
from tests.farm.runs import small_config

if __name__ == "__main__":
    workforce.SerialExecutor = functools.partial(executor.SerialExecutor, evaluate=deadly.dies)
    path = Path(sys.argv[1])
    config = small_config("stop.epochs=1")
    summary = farm.resume(path) if path.exists() else farm.submit(config, path, executor="serial")
    print(summary.ended.digest)
"""


@pytest.mark.slow
def test_a_run_in_one_process_dies_of_a_genome_and_its_next_session_sets_it_aside(tmp_path, monkeypatch):
    config, path = small_config("stop.epochs=1"), tmp_path / "run"
    expected = _serial(tmp_path, monkeypatch, config, deadly.refuses)
    ends = []
    while not ends or (ends[-1].returncode and len(ends) < 10):
        command = [sys.executable, "-c", SESSION, str(path)]
        ends.append(subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False))
    assert {end.returncode for end in ends[:-1]} == {-signal.SIGSEGV}
    assert ends[-1].stdout.split()[-1] == expected.ended.digest, ends[-1].stderr
    verdicts = _verdicts(path, config)
    assert len(ends) <= len(verdicts) + 1
    assert all("SIGSEGV" in verdict.reason for verdict in verdicts)
    assert not list((path / "logs").glob("*.evaluating"))


def test_the_journal_tells_the_next_session_where_this_one_died(tmp_path):
    before = Journal(tmp_path, "run")
    for place in ((0, 0, 0), (1, 0, 1)):
        before.enter(place)
    once = Journal(tmp_path, "run")
    assert once.suspects == {(1, 0, 1)}
    once.enter((0, 0, 0))
    twice = Journal(tmp_path, "run")
    assert twice.suspects == {(0, 0, 0), (1, 0, 1)}
    twice.clear((1, 0, 1))
    twice.enter((0, 0, 0))
    (tmp_path / "logs" / "run.evaluating").open("a").write("4 5")  # torn
    after = Journal(tmp_path, "run")
    assert after.suspects == {(0, 0, 0)}
    after.close()
    assert Journal(tmp_path, "run").suspects == set()


@pytest.mark.slow
@pytest.mark.ray
def test_a_run_sets_deadly_genomes_aside_and_finds_all_others(ray_cluster, tmp_path, monkeypatch):
    config, recorder = small_config("stop.epochs=1"), Recorder()
    expected = _serial(tmp_path, monkeypatch, config, deadly.refuses)
    found = _on_ray(tmp_path, monkeypatch, config, deadly.dies, [recorder])
    assert found.ended.digest == expected.ended.digest
    assert found.ended.progress == expected.ended.progress
    told = {event.where.split()[1] for event in recorder.of(Fault) if event.where.startswith("genome")}
    committed = _verdicts(tmp_path / "ray", config)
    assert committed
    assert {verdict.design_id for verdict in committed} == told
    assert all("SIGSEGV" in verdict.reason for verdict in committed)


@pytest.mark.slow
@pytest.mark.ray
def test_an_island_that_dies_of_a_genome_while_it_screens_sets_it_aside(ray_cluster, tmp_path, monkeypatch):
    niches = ("evolution.method=niches", "evolution.islands=1", "evolution.offspring=8", "stop.epochs=2")
    config = small_config(*niches, "catalogue.keep=distinct")
    expected = _serial(tmp_path, monkeypatch, config, deadly.refuses_seldom)
    found = _on_ray(tmp_path, monkeypatch, config, deadly.dies_seldom)
    assert found.ended.digest == expected.ended.digest
    verdicts = _verdicts(tmp_path / "ray", config)
    assert verdicts
    assert all("SIGSEGV" in verdict.reason for verdict in verdicts)


@pytest.mark.slow
@pytest.mark.ray
def test_batches_killed_from_outside_change_nothing(ray_cluster, tmp_path, monkeypatch):
    config, recorder = small_config("stop.epochs=1"), Recorder()
    expected = farm.submit(config, tmp_path / "serial", executor="serial")
    found = _on_ray(tmp_path, monkeypatch, config, deadly.is_killed, [recorder])
    assert found.ended.digest == expected.ended.digest
    assert not [event for event in recorder.of(Fault) if event.where.startswith("genome")]


@pytest.mark.slow
@pytest.mark.ray
def test_evaluations_that_die_everywhere_end_the_run_with_a_line(ray_cluster, tmp_path, monkeypatch):
    with pytest.raises(FarmError, match="died of a first evaluation"):
        _on_ray(tmp_path, monkeypatch, small_config(), deadly.dies_of_everything)


def test_the_bound_is_far_above_what_an_evaluation_takes():
    assert trials._SECONDS_A_POINT * 5000 >= 10 * 0.0009
