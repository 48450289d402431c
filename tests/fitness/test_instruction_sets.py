"""Scores, pair counts and descriptors are the same bits with AVX2 and with AVX-512 (DESIGN section 3)."""

import hashlib
import os
import platform
import subprocess
import sys

import numpy as np
import pytest

from fractal_farm.fitness import evaluate, pair_counts, shape_descriptor
from fractal_farm.fitness.pair_counting import count_pairs
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.maps import resolved_maps
from fractal_farm.ifs.random_iteration import attractor_points
from tests.table1 import TABLE1


def digest() -> str:
    """Of everything that this package computes, for the four published genomes and thirty random ones."""
    generator = np.random.default_rng(11)
    genomes = [np.array(genome) for genome in TABLE1.values()]
    for n in (2, 3, 8):
        for _ in range(10):
            angles, offsets = generator.uniform(-np.pi, np.pi, (n, 3)), generator.uniform(-2, 2, (n, 3))
            genomes.append(np.column_stack([angles, generator.uniform(0.05, 0.95, n), offsets]))
    affine = [Genome(resolved_maps(genome).reshape(-1, 12), Phenotype(family="affine")) for genome in genomes]
    evaluation = evaluate([*genomes, *affine])
    parts = [getattr(evaluation, name) for name in ("d0", "d2", "lle", "fitness", "d0_error", "d2_error")]
    for genome in genomes:
        points = attractor_points(genome, 5000)
        parts += [points, pair_counts(points), shape_descriptor(points)]
    return hashlib.blake2b(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()


def compiled_code() -> str:
    return "".join(count_pairs.inspect_asm().values())


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="compares two x86 instruction sets")
def test_avx2_and_this_machine_compute_the_same_bits(tmp_path):
    # Both variables are needed: with the name alone numba still passes on the features of this machine.
    environment = {
        **os.environ,
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CPU_FEATURES": "",
        "NUMBA_CACHE_DIR": str(tmp_path),
    }
    script = (
        "from tests.fitness.test_instruction_sets import compiled_code, digest\n"
        "print(digest(), 'ymm' in compiled_code(), 'zmm' in compiled_code())"
    )
    command = [sys.executable, "-c", script]
    output = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
    assert output.returncode == 0, output.stderr
    assert output.stdout.split() == [digest(), "True", "False"]
