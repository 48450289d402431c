"""Prometheus' view of a real run: scraped while it goes on, from loopback, and equal to the run's own totals."""

import json
import os
import re
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import psutil
import pytest

from fractal_farm import farm
from fractal_farm.config import RunConfig
from fractal_farm.errors import InputError
from fractal_farm.farm.on_ray import extras
from fractal_farm.farm.on_ray.metrics import exported_names
from tests.farm.runs import small_config

ROOT = Path(__file__).parents[2]

# The run stays up after its last commit until it is told to go, so that the last figures can be read.
CHILD = """
import sys
from pathlib import Path
from fractal_farm import farm
from fractal_farm.farm.events import Callback, RunEnded
from tests.farm.runs import small_config

class Wait(Callback):
    def on_event(self, event):
        if isinstance(event, RunEnded):
            print(event.progress.evaluated, event.progress.designs, event.progress.epochs, event.meshes, flush=True)
            sys.stdin.readline()

if __name__ == "__main__":
    config = small_config(*sys.argv[2:])
    farm.submit(config, Path(sys.argv[1]), executor="ray", callbacks=[Wait()])
"""


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def scrape(port):
    """Names and values; labels as a string."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5) as answer:
        lines = answer.read().decode().splitlines()
    found = re.compile(r"(ray_farm_\w+)\{(.*)\} (\S+)")
    return [(m[1], m[2], float(m[3])) for m in map(found.fullmatch, lines) if m]


def listening(process):
    """Addresses at which a process and its descendants accept connections."""
    family = [process, *process.children(recursive=True)]
    return {c.laddr.ip for member in family for c in member.net_connections() if c.status == psutil.CONN_LISTEN}


@pytest.fixture(scope="module")
def observed(tmp_path_factory):
    """A run with figures: the port's last answer, what the run said itself, and the addresses it listened at."""
    port = free_port()
    overrides = [f"execution.metrics={port}", "execution.workers=2", "solids.max=1", "evolution.qualified=0.8"]
    out = tmp_path_factory.mktemp("metrics") / "run"
    run = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(out), *overrides],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "RAY_metrics_report_interval_ms": "500"},
    )
    try:
        totals = [int(word) for word in run.stdout.readline().split()]
        addresses = listening(psutil.Process(run.pid))
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            figures = scrape(port)
            if totals[0] in [value for name, _, value in figures if name == "ray_farm_evaluated_total"]:
                break
            time.sleep(0.5)
        yield figures, totals, addresses
    finally:
        run.communicate("\n", timeout=60)


@pytest.mark.slow
def test_the_figures_are_the_totals_of_the_run(observed):
    figures, (evaluated, designs, epochs, solids), _ = observed
    values = {name: value for name, _, value in figures}
    assert values["ray_farm_evaluated_total"] == evaluated
    assert values["ray_farm_designs"] == designs
    assert values["ray_farm_epochs_total"] == values["ray_farm_committed_epochs"] == epochs
    assert values["ray_farm_solids_total"] == values["ray_farm_solid_seconds_count"] == solids == 1
    assert values["ray_farm_uncommitted_designs"] == 0
    migrants = [(labels, value) for name, labels, value in figures if name == "ray_farm_migrants_total"]
    # Three islands in a ring of degree 2: six ways, two designs in each of seven epochs.
    assert [value for _, value in migrants] == [14.0] * 6


@pytest.mark.slow
def test_only_known_names_are_exported_and_every_figure_carries_its_run(observed):
    figures, _, _ = observed
    assert {name for name, _, _ in figures} <= exported_names()
    assert all(f'run="{small_config("evolution.qualified=0.8").run_id}"' in labels for _, labels, _ in figures)


@pytest.mark.slow
def test_a_run_on_this_machine_listens_on_loopback_alone(observed):
    _, _, addresses = observed
    assert addresses
    assert addresses <= {"127.0.0.1", "::ffff:127.0.0.1", "::1"}


def test_the_dashboard_draws_only_what_is_exported():
    dashboard = json.loads((ROOT / "deploy" / "grafana.json").read_text())
    expressions = [target["expr"] for panel in dashboard["panels"] for target in panel.get("targets", ())]
    assert len(expressions) >= 8
    used = {name for expression in expressions for name in re.findall(r"\bray_farm_\w+", expression)}
    assert used
    assert used <= exported_names()


def test_a_port_that_is_taken_is_refused_before_anything_is_written(tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=rf"execution\.metrics {port}: .*choose another port"):
            farm.submit(small_config(f"execution.metrics={port}"), tmp_path / "run", executor="ray")
    assert list(tmp_path.iterdir()) == []


def test_without_the_extra_metrics_are_refused_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(extras, "_NEEDED", ("no_such_library",))
    with pytest.raises(InputError, match=r"execution\.metrics 9464: .*fractal-farm\[cluster\]"):
        farm.submit(small_config("execution.metrics=9464"), tmp_path / "run", executor="ray")
    assert list(tmp_path.iterdir()) == []


def test_figures_need_ray():
    with pytest.raises(InputError, match="metrics 9464 needs executor ray"):
        RunConfig.from_dict({"execution": {"executor": "serial", "metrics": 9464}})
