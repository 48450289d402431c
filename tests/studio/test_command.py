"""`farm studio` at the terminal: one line, a clean end, and one line for what is wrong."""

import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

import pytest

from fractal_farm.cli import main
from tests.studio.running import FARM, running_studio


@pytest.mark.slow
def test_it_prints_one_line_and_ctrl_c_ends_it_and_its_workers(small_catalogue, tmp_path):
    shutil.copytree(small_catalogue, tmp_path / "run")
    with running_studio(tmp_path / "run") as studio:
        assert studio.get("data/catalogue.json").status_code == 200
        pid = studio.process.pid
        workers = [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
        assert workers
        began = time.monotonic()
        studio.process.send_signal(signal.SIGINT)
        assert studio.process.wait(10) == 0
        assert time.monotonic() - began < 5
        assert studio.process.stdout.read() == ""
    assert not [each for each in workers if Path(f"/proc/{each}").exists()]


@pytest.mark.slow
def test_workers_do_not_outlive_a_studio_that_is_killed(small_catalogue, tmp_path):
    shutil.copytree(small_catalogue, tmp_path / "run")
    with running_studio(tmp_path / "run") as studio:
        time.sleep(0.5)
        pid = studio.process.pid
        workers = [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
        studio.process.kill()
        studio.process.wait()
        deadline = time.monotonic() + 10
        while any(_lives(each) for each in workers):
            assert time.monotonic() < deadline
            time.sleep(0.1)


def _lives(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_a_port_in_use_is_one_line(small_catalogue, capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["studio", str(small_catalogue), "--port", str(port), "--no-open"]) == 2
    error = capsys.readouterr().err
    assert f"port {port}: is in use" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("name", ["nothing", "empty", "file"])
def test_what_is_no_catalogue_is_one_line(name, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("x")
    done = subprocess.run([*FARM, "studio", str(tmp_path / name), "--no-open"], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith(f"farm: error: {tmp_path / name}")
    assert done.stderr.count("\n") == 1
