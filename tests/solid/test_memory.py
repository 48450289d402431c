"""Memory is predicted before it is taken: a process takes no more, and not much less."""

import json
import subprocess
import sys

import pytest

from tests.table1 import TABLE1

ASIDE = """
import json, sys
import psutil
from fractal_farm.ifs.genome import as_genome
from fractal_farm.solid import pipeline
from fractal_farm.solid.parameters import SolidParameters
from tests.table1 import TABLE1
name, resolution = sys.argv[1], int(sys.argv[2])
pipeline.make_solid(as_genome(TABLE1["06447"]), SolidParameters(resolution=120))  # compiled, and loaded
predicted = []
predict = pipeline.predict_memory
pipeline.predict_memory = lambda *given, **more: predicted.append(predict(*given, **more)) or predicted[0]
before = psutil.Process().memory_info().rss
pipeline.make_solid(as_genome(TABLE1[name]), SolidParameters(resolution=resolution))
peak = 1024 * int(open("/proc/self/status").read().split("VmHWM:")[1].split()[0])  # not what the parent had
print(json.dumps([predicted[0].total, before, peak]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("resolution", [200, 400])
@pytest.mark.parametrize("name", TABLE1)
def test_a_solid_takes_what_is_predicted_and_400_voxels_less_than_4_gb(name, resolution):
    done = subprocess.run(
        [sys.executable, "-c", ASIDE, name, str(resolution)], capture_output=True, text=True, check=True
    )
    predicted, before, peak = json.loads(done.stdout)
    assert peak <= before + predicted <= 2.2 * peak
    assert peak < 4e9
