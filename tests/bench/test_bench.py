"""`farm bench` measures what it says: the ceilings are physical, peers count the same pairs, the report is whole."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from fractal_farm.bench import peers, throughput
from fractal_farm.bench.ceilings import Ceilings, measure_ceilings
from fractal_farm.bench.genomes import TABLE1, random_genomes
from fractal_farm.bench.peer_rules import d0_by_rules, d2_by_rules
from fractal_farm.bench.solids import STAGES as SOLID_STAGES
from fractal_farm.bench.solids import measure_solids
from fractal_farm.bench.stages import measure_stages
from fractal_farm.bench.stopwatch import load, shortest, this_machine
from fractal_farm.bench.truth import classic
from fractal_farm.cli import main
from fractal_farm.errors import FarmError
from fractal_farm.fitness import evaluate_batch
from fractal_farm.fitness.formula import FitnessFormula
from fractal_farm.ifs.genome import Phenotype


def test_random_genomes_are_valid_and_half_of_each_size():
    genes, n_maps = random_genomes(50)
    assert sorted(set(n_maps.tolist())) == [2, 3]
    assert (n_maps == 2).sum() == 25
    assert not evaluate_batch(genes, n_maps, Phenotype(), 100, FitnessFormula()).refusal.any()


def test_a_stopwatch_counts_the_time_of_its_own_thread():
    loops = shortest(lambda: sum(range(20_000)), 0.02)
    longer = shortest(lambda: sum(range(200_000)), 0.02)
    assert 0 < loops < longer
    assert load() >= 0
    machine = this_machine()
    assert machine.cores >= 1
    assert machine.instruction_set


def test_ceilings_are_those_of_a_processor():
    ceilings = measure_ceilings()
    assert 1e8 < ceilings.clock < 1e10
    assert 1e8 < ceilings.bandwidth < 1e13
    assert 1e-10 < ceilings.recurrence < 1e-7


def test_floors_count_what_a_stage_cannot_do_without():
    # A machine of one cycle a nanosecond, one byte a nanosecond: floors are counts, whatever runs beside the test.
    stages = {stage.name: stage for stage in measure_stages(Ceilings(1e9, 1e9, 1e-9), count=2)}
    assert all(stage.microseconds > 0 for stage in stages.values())
    assert all(math.isnan(stage.floor) or stage.floor > 0 for stage in stages.values())
    assert stages["random iteration"].floor == pytest.approx(5.0)  # 5,000 steps, one after the other
    assert stages["principal axes"].floor >= 5000 * (3 * 8 + 3 * 4) / 1000  # doubles read, floats written
    assert stages["pair counts"].floor < stages["pair counts by brute force"].floor


def test_all_peers_are_compared_and_the_tree_counts_the_pairs_that_we_count():
    compared = list(peers.compare(clouds=1))
    names = {peer.peer.split()[0] for peer in compared}
    assert names == {"scipy", "numpy"} | ({"nolds"} if peers.has_nolds() else set())
    assert all(peer.ratio > 1 for peer in compared)


def test_a_peer_that_counts_other_pairs_is_a_defect():
    points = np.random.default_rng(0).random((5000, 3))
    with pytest.raises(FarmError, match="pairs more or less"):
        peers._Tree(points, np.full(16, 1000))


def test_threads_and_sizes_are_timed():
    scaling = throughput.by_threads(2, rounds=1, genomes=4)
    assert [row.threads for row in scaling] == [1, 2]
    assert scaling[0].speedup == 1
    assert throughput.milliseconds(1000, 4) < throughput.milliseconds(20_000, 4)


@pytest.mark.parametrize("fractal", classic()[:7], ids=lambda fractal: fractal.name)
def test_peers_rules_come_near_the_truth(fractal):
    points = fractal.points(0)
    d2 = d2_by_rules(points, 0)
    assert d2[:2] == pytest.approx([fractal.d2] * 2, abs=0.25)
    assert d0_by_rules(points)[0] == pytest.approx(fractal.d0, abs=0.5)


@pytest.mark.slow
def test_the_report_has_every_part(capsys, tmp_path):
    assert main(["bench", "--json", "-o", str(tmp_path / "bench.json")]) == 0
    captured = capsys.readouterr()
    report = json.loads(captured.out)
    assert json.loads((tmp_path / "bench.json").read_text()) == report
    assert set(report) >= {"machine", "load", "ceilings", "evaluation", "stages", "sizes", "threads", "peers"}
    assert [row["points"] for row in report["sizes"]][-1] == 200_000
    assert "farm bench" in captured.err


@pytest.mark.slow
def test_every_bound_of_the_design_is_kept(capsys):
    assert main(["bench", "--accuracy", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert len(report["bounds"]) >= 18
    assert all(bound["met"] for bound in report["bounds"])


def test_table_1_is_that_of_the_configuration():
    held = yaml.safe_load((Path(__file__).parents[2] / "configs" / "table1.yaml").read_text())
    assert held["genomes"] == TABLE1


def test_a_solid_is_measured_by_stages_in_a_process_of_its_own():
    heard = []
    (cost,) = measure_solids(heard.append, ("06447",), (150,))
    assert heard == ["farm bench: 06447 at 150 voxels"]
    assert tuple(cost.seconds) == SOLID_STAGES
    assert all(seconds >= 0 for seconds in cost.seconds.values())
    assert cost.total == pytest.approx(sum(cost.seconds.values()))
    assert 50e6 < cost.peak_bytes <= cost.predicted_bytes < 4e9
    assert cost.cover == "cut set"


def test_two_kinds_of_measurement_at_once_are_refused(capsys):
    assert main(["bench", "--farm", "--solids"]) == 2
    assert "--farm and --solids" in capsys.readouterr().err
