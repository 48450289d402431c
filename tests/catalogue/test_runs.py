import json
import os
import signal
import subprocess
import sys
import time

import pytest

from fractal_farm.catalogue import (
    Catalogue,
    create_run,
    read_run,
    record_end,
    run_ends,
    run_ids,
    run_lock,
)
from fractal_farm.errors import FarmError, InputError
from tests.catalogue.examples import RUN, commit_epochs, files

DESCRIPTION = {"config": {"name": "tests", "seed": 1}, "versions": {"numpy": "2"}}


def test_a_run_is_described_once(root):
    create_run(root, RUN, DESCRIPTION)
    assert read_run(root, RUN) == DESCRIPTION
    assert run_ids(root) == [RUN]
    before = files(root)
    with pytest.raises(InputError, match="exists already"):
        create_run(root, RUN, {})
    assert files(root) == before


def test_an_unknown_run_is_refused_with_the_names_of_those_there(root):
    with pytest.raises(InputError, match="the runs are none"):
        read_run(root, RUN)
    create_run(root, RUN, DESCRIPTION)
    with pytest.raises(InputError, match=f"no run 1111; the runs are {RUN}"):
        read_run(root, "1111")
    for name in ("../../etc", "", "A" * 16, "a/b", "x" * 40):
        with pytest.raises(InputError, match="run id"):
            read_run(root, name)


def test_a_changed_description_is_reported(root):
    create_run(root, RUN, DESCRIPTION)
    path = root / "runs" / RUN / "run.json"
    changed = json.loads(path.read_text())
    changed["config"]["seed"] = 2
    path.write_text(json.dumps(changed))
    with pytest.raises(FarmError, match="checksum does not match"):
        read_run(root, RUN)
    path.write_text("half of a")
    with pytest.raises(FarmError, match="not JSON"):
        read_run(root, RUN)


def test_a_run_may_end_several_times(root):
    create_run(root, RUN, DESCRIPTION)
    assert run_ends(root, RUN) == []
    for epoch in (3, 7, 12):
        record_end(root, RUN, {"epoch": epoch, "reason": "epochs"})
    assert [end["epoch"] for end in run_ends(root, RUN)] == [3, 7, 12]


def test_runs_say_what_is_known_of_them(root):
    create_run(root, RUN, DESCRIPTION)
    commit_epochs(root, 0, 2)
    with run_lock(root, RUN):
        (run,) = Catalogue.open(root).runs()
        assert run.live
    record_end(root, RUN, {"epoch": 2})
    (run,) = Catalogue.open(root).runs()
    assert (run.run_id, run.description, run.commits, run.rows, run.live) == (RUN, DESCRIPTION, 3, 24, False)
    assert run.ends == ({"epoch": 2},)


def test_a_run_that_somebody_holds_is_refused_until_it_is_free(root, monkeypatch):
    monkeypatch.setattr("fractal_farm.catalogue.runs._PATIENCE_SECONDS", 0.05)
    with run_lock(root, RUN):
        with pytest.raises(InputError, match=f"in the hands of process {os.getpid()} on"), run_lock(root, RUN):
            pass
        with run_lock(root, "another"):
            pass
    with run_lock(root, RUN):
        pass


def test_the_lock_of_a_killed_process_is_free(root):
    hold = (
        "import sys, time; from pathlib import Path; from fractal_farm.catalogue.runs import run_lock\n"
        "with run_lock(Path(sys.argv[1]), sys.argv[2]): print('held', flush=True); time.sleep(60)"
    )
    holder = subprocess.Popen([sys.executable, "-c", hold, str(root), RUN], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(InputError, match=f"process {holder.pid}"), run_lock(root, RUN):
            pass
    finally:
        holder.send_signal(signal.SIGKILL)
        holder.wait()
    started = time.monotonic()
    with run_lock(root, RUN):
        assert time.monotonic() >= started
