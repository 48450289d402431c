"""The promise of DESIGN section 4 under fire; see `storm` for how it is done."""

import subprocess

import pytest

from tests.farm.storm import KINDS, Storm, commits, duplicates, torn_files


@pytest.mark.storm
def test_fifty_kills_of_every_kind_of_process_lose_and_change_nothing(tmp_path):
    storm = Storm(tmp_path, seed=20261123, kills=50)
    storm.rage()
    epochs = storm.calm_down() + 2
    digest = storm.finish(epochs)
    assert sum(storm.killed.values()) >= 50
    assert set(storm.killed) == set(KINDS)
    # A session that could not go on says why.
    assert all(code == 1 and line.startswith("farm: error:") for code, line in storm.ends)
    assert storm.acknowledged
    assert storm.acknowledged <= commits(storm.catalogue)
    assert torn_files(storm.catalogue) == []
    assert duplicates(storm.catalogue) == []
    assert digest == storm.undisturbed(epochs)
    verified = storm.command("verify", str(storm.catalogue), "full")
    assert subprocess.run(verified, capture_output=True, check=False, timeout=600).returncode == 0
