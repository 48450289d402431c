"""The same digest for any number of workers and any batch size (DESIGN section 4), each in a process of its own."""

import subprocess
import sys
from pathlib import Path

import pytest

from fractal_farm import farm
from tests.farm.runs import small_config

OVERRIDES = ("evolution.offspring=300", "evolution.library.size=40", "stop.epochs=3")

CHILD = """
import sys
from pathlib import Path
from fractal_farm import farm
from tests.farm.runs import small_config

if __name__ == "__main__":
    print(farm.submit(small_config(*sys.argv[2:]), Path(sys.argv[1]), executor="ray").ended.digest)
"""


@pytest.fixture(scope="module")
def digest(tmp_path_factory):
    path = tmp_path_factory.mktemp("serial") / "run"
    return farm.submit(small_config(*OVERRIDES), path, executor="serial").ended.digest


@pytest.mark.slow
@pytest.mark.ray
@pytest.mark.parametrize("batch_size", [16, 256])
@pytest.mark.parametrize("workers", [1, 2, 4])
def test_workers_and_batches_change_nothing(tmp_path, digest, workers, batch_size):
    words = [*OVERRIDES, f"execution.workers={workers}", f"execution.batch_size={batch_size}"]
    command = [sys.executable, "-c", CHILD, str(tmp_path / "run"), *words]
    root = Path(__file__).parents[2]
    done = subprocess.run(command, capture_output=True, text=True, cwd=root, check=False, timeout=600)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-1] == digest
