"""Real processes, really killed: what was acknowledged is there, whole, and once."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fractal_farm.catalogue import Catalogue, RunWriter, committed_records, remove_orphans
from tests.catalogue import under_fire
from tests.catalogue.examples import RUN, files

HOUSE = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("kills", [12, pytest.param(60, marks=pytest.mark.slow)])
def test_a_run_killed_again_and_again_loses_nothing_tears_nothing_and_repeats_nothing(root, tmp_path, kills):
    environment = os.environ | {"PYTHONPATH": str(HOUSE)}
    command = [sys.executable, "-m", "tests.catalogue.under_fire", str(root), str(kills)]
    fire = subprocess.Popen(command, cwd=HOUSE, env=environment, stdout=subprocess.PIPE, text=True)
    reads = 0
    while fire.poll() is None:
        seen = [epochs[0] for epochs, _ in committed_records(root, RUN)]
        assert seen == list(range(len(seen)))
        for _ in Catalogue.open(root).dense_points(limit=4).batches():
            reads += 1
    assert fire.returncode == 0, fire.stdout.read()
    told = json.loads(fire.stdout.read().splitlines()[-1])
    assert told["kills"] == kills
    assert reads

    acknowledged = [int(line) for line in (root / "logs" / "acknowledged").read_text().split()]
    committed = list(committed_records(root, RUN))
    assert [epochs for epochs, _ in committed] == [(epoch, epoch) for epoch in range(len(committed))]
    assert acknowledged
    assert set(acknowledged) <= set(range(len(committed)))
    assert len(acknowledged) == len(set(acknowledged))
    assert len(committed) - len(acknowledged) <= kills
    for epoch, (_, blob) in enumerate(committed):
        assert blob == under_fire.epoch_content(epoch)[2]

    undisturbed = Catalogue.create(tmp_path / "undisturbed")
    writer = RunWriter(undisturbed.path, RUN, "node", 0, under_fire.N_POINTS, durability="process")
    for epoch in range(len(committed)):
        under_fire.commit(writer, epoch)
    catalogue = Catalogue.open(root)
    assert catalogue.digest() == undisturbed.digest()
    for ours, theirs in zip(catalogue.dense_points().batches(), undisturbed.dense_points().batches(), strict=True):
        np.testing.assert_array_equal(ours, theirs)

    remove_orphans(root, RUN)
    assert remove_orphans(root, RUN) == 0
    assert not [name for name in files(root) if name.endswith(".partial")]
    in_parts = sum(name.startswith("manifest/") for name in files(root))
    assert in_parts == len(committed)
