"""Runs that a cluster keeps: handed over, watched and stopped by separate commands, with a token."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil
import pytest

from fractal_farm import farm
from fractal_farm.catalogue import last_epoch, run_ids
from fractal_farm.cli import main
from fractal_farm.farm.on_ray import extras
from tests.farm.runs import small_config
from tests.farm.test_metrics import free_port

ROOT = Path(__file__).parents[2]
TOKEN = "a-token-of-forty-characters-for-the-tests"
COMMAND = [sys.executable, "-c", "import sys; from fractal_farm.cli import main; sys.exit(main())"]


@pytest.fixture(scope="module")
def cluster():
    """A head with a dashboard and two processors on loopback; yields the environment of its users and its address."""
    port = free_port()
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "RAY_AUTH_MODE": "token",
        "RAY_AUTH_TOKEN": TOKEN,
        "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",
        "RAY_USAGE_STATS_ENABLED": "0",
        # Here Ray writes which cluster is this machine's, and sockets, whose paths must be short.
        "RAY_TMPDIR": tempfile.mkdtemp(prefix="ray-", dir="/tmp"),
    }
    words = ["start", "--head", "--block", "--port=0", "--num-cpus=2", "--include-dashboard=true"]
    words += [f"--dashboard-port={port}", "--dashboard-agent-listen-port=0", "--object-store-memory=104857600"]
    start = subprocess.Popen(
        [sys.executable, "-m", "ray.scripts.scripts", *words],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    family = []
    try:
        for line in start.stdout:
            if "--block" in line:
                break
        family = psutil.Process(start.pid).children(recursive=True)
        yield environment, f"http://127.0.0.1:{port}"
    finally:
        for process in [*family, psutil.Process(start.pid)]:
            try:
                process.kill()
            except psutil.NoSuchProcess:
                continue
        start.wait()
        shutil.rmtree(environment["RAY_TMPDIR"], ignore_errors=True)


def command(cluster, *words, code=0):
    """A `farm` command on another terminal."""
    environment, address = cluster
    done = subprocess.run(
        [*COMMAND, *words, "--address", address], env=environment, capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done


def written(tmp_path, *overrides):
    path = tmp_path / "run.yaml"
    path.write_text(json.dumps(small_config(*overrides).to_dict()))
    return path


@pytest.mark.slow
def test_a_run_is_handed_over_stopped_resumed_and_ends_with_the_digest_of_one_process(cluster, tmp_path):
    out = tmp_path / "run"
    config = written(tmp_path, "stop.epochs=10000")
    job = command(cluster, "submit", str(config), "--out", str(out), "--detach").stdout.strip()
    # The cluster works, while this process only looks at the files.
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and not (out / "manifest").exists():
        time.sleep(0.5)
    assert json.loads(command(cluster, "jobs", "status", job, "--json").stdout)["status"] == "RUNNING"
    assert farm.status(out)["state"] == "running"
    assert job in command(cluster, "jobs", "list").stdout
    command(cluster, "jobs", "stop", job)
    stopped = farm.status(out)
    assert stopped["state"] == "interrupted"
    assert "SIGTERM" in stopped["reason"]
    assert "go on with: farm resume" in command(cluster, "jobs", "logs", job).stdout

    longer = f"stop.epochs={stopped['epochs'] + 2}"
    again = command(cluster, "resume", str(out), "--set", longer, "--detach").stdout.strip()
    text = command(cluster, "jobs", "logs", again, "--follow").stdout
    facts = json.loads(command(cluster, "jobs", "status", again, "--json").stdout)
    assert (facts["status"], facts["exit_code"], facts["catalogue"]) == ("SUCCEEDED", 0, str(out)), text
    whole = farm.submit(small_config(longer), tmp_path / "whole", executor="serial")
    assert farm.status(out)["digest"] == whole.ended.digest
    assert whole.ended.digest in text


@pytest.mark.slow
def test_one_of_several_runs_of_a_catalogue_is_handed_over(cluster, tmp_path):
    out, few = tmp_path / "run", small_config("stop.epochs=1")
    farm.submit(few, out, executor="serial")
    second = written(tmp_path, "stop.epochs=1", "evolution.seed=9")
    job = command(cluster, "submit", str(second), "--out", str(out), "--into", "--detach").stdout.strip()
    assert "digest" in command(cluster, "jobs", "logs", job, "--follow").stdout
    assert len(run_ids(out)) == 2
    # The second was begun later, and is the one that would be resumed without its name.
    words = ("resume", str(out), "--run", few.run_id[:6], "--set", "stop.epochs=2", "--detach")
    again = command(cluster, *words).stdout.strip()
    text = command(cluster, "jobs", "logs", again, "--follow").stdout
    whole = farm.submit(small_config("stop.epochs=2"), tmp_path / "whole", executor="serial")
    assert whole.ended.digest in text
    assert last_epoch(out, few.run_id) == 1


@pytest.mark.slow
def test_without_the_token_the_cluster_lets_nobody_in(cluster):
    environment, address = cluster
    stranger = {name: value for name, value in environment.items() if name != "RAY_AUTH_TOKEN"}
    for other in (stranger | {"RAY_AUTH_MODE": "disabled"}, stranger | {"RAY_AUTH_TOKEN": "x" * 40}):
        done = command((other, address), "jobs", "list", code=2)
        assert done.stderr.count("\n") == 1
        assert "the cluster wants its token" in done.stderr


@pytest.mark.slow
def test_an_unknown_job_is_refused_in_one_line(cluster):
    for verb in ("status", "logs", "stop"):
        done = command(cluster, "jobs", verb, "farm-nothing", code=2)
        assert done.stderr.count("\n") == 1
        assert "no job farm-nothing" in done.stderr


def refusal(capsys, *words):
    assert main([str(word) for word in words]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


def test_what_cannot_be_handed_over_is_refused_in_one_line(capsys, tmp_path, monkeypatch):
    config = written(tmp_path)
    place = ["--out", "/catalogues/run", "--detach"]
    nobody = f"http://127.0.0.1:{free_port()}"
    assert "no Ray dashboard answers" in refusal(capsys, "submit", config, *place, "--address", nobody)
    assert "http://HOST:8265" in refusal(capsys, "submit", config, *place, "--address", "127.0.0.1:6379")
    for strange in ("http://127.0.0.1:99999", "http://a b:8265", "https://"):
        assert "http://HOST:8265" in refusal(capsys, "jobs", "list", "--address", strange)
    assert "absolute" in refusal(capsys, "submit", config, "--out", "run", "--detach", "--address", nobody)
    assert "--executor serial" in refusal(capsys, "submit", config, *place, "--executor", "serial")
    workers = ["--set", "execution.workers=2"]
    assert "execution.workers 2" in refusal(capsys, "submit", config, *place, *workers, "--address", nobody)
    monkeypatch.setattr(extras, "_NEEDED", ("no_such_library",))
    assert "fractal-farm[cluster]" in refusal(capsys, "jobs", "list", "--address", nobody)
