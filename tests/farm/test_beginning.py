"""No instant of the beginning of a run is a dead end: submit again, or resume, whichever of them says so."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue, begin_run, is_unbegun, run_ids
from fractal_farm.cli import main
from fractal_farm.errors import InputError
from tests.catalogue.examples import RUN, files
from tests.farm.runs import small_config

ROOT = Path(__file__).parents[2]
HALF_MADE = (
    (),
    (".zarr.json.1f.partial",),
    ("zarr.json",),
    ("zarr.json", "clouds/"),
    ("zarr.json", "clouds/zarr.json", "runs/", f"runs/{RUN}/"),
    ("zarr.json", "clouds/zarr.json", f"runs/{RUN}/.run.json.1f.partial"),
)


@pytest.fixture(params=HALF_MADE)
def half_made(request, tmp_path):
    root = tmp_path / "run"
    root.mkdir()
    for key in request.param:
        path = root / key
        path.parent.mkdir(parents=True, exist_ok=True)
        path.mkdir() if key.endswith("/") else path.write_bytes(b"{")
    return root


def test_what_a_dead_submit_left_is_taken_over(half_made):
    assert is_unbegun(half_made)
    begin_run(half_made, RUN, {"config": {}})
    assert run_ids(half_made) == [RUN]
    assert Catalogue.open(half_made).designs().num_rows == 0
    assert not [key for key in files(half_made) if key.endswith(".partial")]
    assert not is_unbegun(half_made)
    with pytest.raises(InputError, match=f"holds run {RUN}.*farm resume"):
        begin_run(half_made, "another", {})


def test_resume_says_what_to_do_with_it(half_made, capsys):
    assert main(["resume", str(half_made)]) == 2
    assert f"farm submit CONFIG --out {half_made}" in capsys.readouterr().err


@pytest.mark.parametrize("key", ["notes.txt", "clouds/mine", "photos/", "runs/My Run/"])
def test_what_somebody_else_put_there_is_refused_and_left_alone(half_made, key):
    path = half_made / key
    path.parent.mkdir(exist_ok=True)
    path.mkdir() if key.endswith("/") else path.touch()
    before = sorted(half_made.rglob("*"))
    with pytest.raises(InputError, match="is not empty"):
        farm.submit(small_config(), half_made, executor="serial")
    with pytest.raises(InputError, match="is not empty"):
        begin_run(half_made, RUN, {})
    assert sorted(half_made.rglob("*")) == before


@pytest.mark.slow
def test_a_submit_that_dies_before_any_of_its_first_steps_can_be_given_again_or_resumed(tmp_path):
    command = [sys.executable, "-m", "tests.farm.killed_at", str(tmp_path), "1", "18"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True, timeout=900)
    said = [json.loads(line) for line in done.stdout.splitlines()]
    killed = [entry["before"] for entry in said if "before" in entry]
    lives = [entry for entry in said if "resume" in entry]
    assert len(killed) == len(lives) == 18
    assert any("run.json" in step and step.startswith("os.rename") for step in killed)
    assert any("fence" in step for step in killed)
    assert {entry["digest"] for entry in said if "digest" in entry} == {said[-1]["digest"]}
    assert all(entry["sound"] for entry in lives)
    assert {entry["resume"] == "went on" or "farm submit" in entry["resume"] for entry in lives[1:]} == {True}
