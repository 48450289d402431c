"""Several Ray nodes on one machine: nodes join and die in mid-run, and the designs are those of one process."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue
from tests.farm.runs import small_config

ROOT = Path(__file__).parents[2]
CONFIG = ("stop.epochs=12", "evolution.islands=4", "evolution.phenotype.points=4000")

# The head has no processors: evaluations run on the other nodes alone. `join`, `die` and `hang` are epochs after which
# a node comes, and the first one is killed, or stands still; 0 for never.
CHILD = """
import contextlib, json, sys
from pathlib import Path
import psutil
from ray import cloudpickle
from ray.cluster_utils import Cluster
from fractal_farm import farm
from fractal_farm.farm.events import Callback, EpochCompleted, Fault
from fractal_farm.farm.on_ray.executor import RayExecutor
from tests.farm.runs import small_config

settings = json.loads(sys.argv[1])
carried = 0
hanging = []

def weighed(call):
    def calling(self, *arguments):
        global carried
        carried += len(cloudpickle.dumps(arguments))
        result = call(self, *arguments)
        carried += len(cloudpickle.dumps(result))
        return result
    return calling

# All that passes between the driver and the cluster.
for name in ("start_epoch", "commit", "mesh", "wait"):
    setattr(RayExecutor, name, weighed(getattr(RayExecutor, name)))

class Weather(Callback):
    faults = 0
    def on_event(self, event):
        self.faults += isinstance(event, Fault)
        if isinstance(event, EpochCompleted) and event.progress.epochs == settings["join"]:
            nodes.append(cluster.add_node(num_cpus=1))
        if isinstance(event, EpochCompleted) and event.progress.epochs == settings["die"]:
            cluster.remove_node(nodes[0], allow_graceful=False)
        if isinstance(event, EpochCompleted) and event.progress.epochs == settings["hang"]:
            raylet = psutil.Process(nodes[0].all_processes["raylet"][0].process.pid)
            hanging.extend([raylet, *raylet.children(recursive=True)])
            for process in hanging:
                process.suspend()

if __name__ == "__main__":
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
    nodes = [cluster.add_node(num_cpus=1) for _ in range(settings["nodes"])]
    weather = Weather()
    config = small_config(*settings["config"])
    try:
        summary = farm.submit(config, Path(settings["out"]), address=cluster.address, callbacks=[weather])
    finally:
        for process in hanging:
            with contextlib.suppress(psutil.Error):
                process.kill()
        cluster.shutdown()
    print(json.dumps({"digest": summary.ended.digest, "faults": weather.faults, "carried": carried}))
"""


def run_on_nodes(out, nodes, join=0, die=0, hang=0, config=CONFIG):
    settings = {"out": str(out), "nodes": nodes, "join": join, "die": die, "hang": hang, "config": config}
    command = [sys.executable, "-c", CHILD, json.dumps(settings)]
    # So that the head of the cluster finds out in seconds that a node hangs; it takes a minute by default.
    environment = os.environ | {"RAY_health_check_timeout_ms": "1000", "RAY_health_check_failure_threshold": "3"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=ROOT, timeout=300, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def digest(tmp_path_factory):
    out = tmp_path_factory.mktemp("serial") / "run"
    return farm.submit(small_config(*CONFIG), out, executor="serial").ended.digest


@pytest.mark.slow
@pytest.mark.parametrize("nodes", [1, 2])
def test_one_node_and_two_give_the_digest_of_one_process(tmp_path, digest, nodes):
    assert run_on_nodes(tmp_path / "run", nodes)["digest"] == digest


@pytest.mark.slow
def test_nodes_may_join_and_die_in_mid_run(tmp_path, digest):
    # After the blow only the node that joined can evaluate anything.
    result = run_on_nodes(tmp_path / "run", nodes=1, join=3, die=6)
    assert result["digest"] == digest
    assert Catalogue.open(tmp_path / "run").digest() == digest
    assert farm.status(tmp_path / "run")["state"] == "ended"


@pytest.mark.slow
def test_what_a_node_had_that_hangs_is_done_on_another(tmp_path, digest):
    result = run_on_nodes(tmp_path / "run", nodes=2, hang=3)
    assert result["digest"] == digest
    assert result["faults"] >= 1


@pytest.mark.slow
def test_clouds_never_pass_through_the_driver(tmp_path):
    config = ("stop.epochs=2", "evolution.phenotype.points=20000")
    carried = run_on_nodes(tmp_path / "run", 2, config=config)["carried"]
    clouds = sum(path.stat().st_size for path in (tmp_path / "run" / "clouds").rglob("*") if path.is_file())
    assert clouds > 5e6
    assert 0 < carried < clouds / 10
