"""The promise of DESIGN section 4: the same configuration and seed give the same bits on every x86-64 machine."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from fractal_farm import farm
from tests.farm.runs import small_config

# What `small_config` has given since its estimators were fixed. If it changes, either something has come to depend on
# the machine or the order of work, which is a defect, or an estimator, an operator or a stream was changed on purpose,
# and catalogues of earlier versions cannot be made again: then say so in the commit that changes it.
GOLDEN = "f4d39667cb80dc20209a5528acd35308"

CHILD = """
import sys
from pathlib import Path
from fractal_farm import farm
from tests.farm.runs import small_config
print(farm.submit(small_config("evolution.islands=2"), Path(sys.argv[1]), executor="serial").ended.digest)
"""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the promise is for x86-64")
def test_the_golden_digest_stands(tmp_path):
    assert farm.submit(small_config(), tmp_path / "run", executor="serial").ended.digest == GOLDEN


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="the promise is for x86-64")
def test_code_for_avx2_and_for_this_machine_gives_the_same_digest(tmp_path):
    digests = set()
    for name, target in (("avx2", {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": ""}), ("native", {})):
        environment = os.environ | target | {"NUMBA_CACHE_DIR": str(tmp_path / f"cache-{name}")}
        command = [sys.executable, "-c", CHILD, str(tmp_path / name)]
        root = Path(__file__).parents[2]
        done = subprocess.run(command, env=environment, cwd=root, capture_output=True, text=True, check=True)
        digests.add(done.stdout.strip())
    assert len(digests) == 1
