"""Runs with niches: what they publish is distinct, and the same after any interruption and on any executor."""

import numpy as np
import pytest

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue
from fractal_farm.distinctness import DISTINCT, signatures
from tests.farm.runs import small_config

NICHES = (
    "evolution.method=niches",
    "evolution.qualified=0.8",
    "evolution.niches.expected_fitness=0.8",
    "catalogue.keep=distinct",
)


def niches(*overrides):
    return small_config(*NICHES, *overrides)


def published(path):
    columns = ["design_id", "fitness", "gap", "d0", "d2", "descriptor", "n_maps"]
    return Catalogue.open(path).designs(columns)


def marks_of(designs):
    shapes = np.array(designs.column("descriptor").to_pylist())
    return signatures(shapes, designs.column("d0").to_numpy(), designs.column("d2").to_numpy())


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("niches") / "run"
    return farm.submit(niches(), path, executor="serial"), path


def test_what_is_published_is_distinct_over_all_islands_and_prints(whole):
    summary, path = whole
    designs = published(path)
    assert len(designs) == summary.ended.progress.designs == summary.ended.progress.distinct > 30
    marks = marks_of(designs)
    distances = np.linalg.norm(marks[:, None] - marks[None], axis=2)[np.triu_indices(len(marks), 1)]
    assert distances.min() >= DISTINCT
    assert min(designs.column("fitness").to_pylist()) > 0.8
    limit = niches().evolution.niches.gap
    assert np.mean(np.array(designs.column("gap")) <= limit) > 0.6  # founders may have any gap


def test_an_interrupted_and_extended_run_publishes_the_same(whole, tmp_path):
    path = tmp_path / "run"
    farm.submit(niches("stop.epochs=3"), path, executor="serial")
    farm.resume(path, overrides=["stop.epochs=5"], executor="serial")
    extended = farm.resume(path, overrides=["stop.epochs=8"], executor="serial")
    assert extended.ended.digest == whole[0].ended.digest
    assert extended.ended.progress.distinct == whole[0].ended.progress.distinct


def test_the_count_of_distinct_designs_survives_an_interruption_when_all_qualified_are_kept(tmp_path):
    keep = "catalogue.keep=qualified"
    one = farm.submit(niches(keep, "evolution.method=best"), tmp_path / "one", executor="serial")
    farm.submit(niches(keep, "evolution.method=best", "stop.epochs=3"), tmp_path / "two", executor="serial")
    two = farm.resume(tmp_path / "two", overrides=["stop.epochs=8"], executor="serial")
    assert one.ended.progress.distinct == two.ended.progress.distinct
    assert 0 < one.ended.progress.distinct < one.ended.progress.designs


def test_a_run_ends_at_the_epoch_that_reaches_the_distinct_designs_asked_for(whole, tmp_path):
    summary = farm.submit(niches("stop.distinct=20"), tmp_path / "run", executor="serial")
    assert summary.ended.progress.distinct >= 20
    assert summary.ended.progress.epochs < whole[0].ended.progress.epochs


@pytest.mark.ray
@pytest.mark.slow
def test_ray_finds_what_the_serial_executor_finds(whole, tmp_path, ray_cluster):
    config = niches("execution.batch_size=7")
    assert farm.submit(config, tmp_path / "run").ended.digest == whole[0].ended.digest
