"""Where compiled kernels are kept, and what happens where nothing can be written."""

import os
import subprocess
import sys

import pytest

SCRIPT = """
import tempfile
{prelude}
import numpy as np
from fractal_farm.ifs.kernel import cache_root, kernel
from fractal_farm.ifs.linear_algebra import determinant
compiled = kernel(determinant)
assert compiled(2.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 4.0) == 24.0
print(cache_root())
"""


def run(prelude="", **environment):
    command = [sys.executable, "-c", SCRIPT.format(prelude=prelude)]
    return subprocess.run(command, env=os.environ | environment, capture_output=True, text=True, check=True)


def test_kernels_are_kept_where_the_environment_says(tmp_path):
    place = tmp_path / "new" / "cache"
    done = run(NUMBA_CACHE_DIR=str(place))
    assert (done.stdout.strip(), done.stderr) == (str(place), "")
    assert list(place.rglob("*.nbi"))


def test_the_cache_of_the_user_is_the_default(tmp_path):
    environment = {"XDG_CACHE_HOME": str(tmp_path), "NUMBA_CACHE_DIR": ""}
    assert run(**environment).stdout.strip() == str(tmp_path / "fractal_farm" / "kernels")


@pytest.mark.parametrize("obstacle", ["a file", "a directory that takes no files"])
def test_a_cache_that_cannot_be_written_falls_back_with_one_line(tmp_path, obstacle):
    blocked = "/proc/self" if obstacle != "a file" else str(tmp_path / "file" / "cache")
    (tmp_path / "file").touch()
    done = run(NUMBA_CACHE_DIR=blocked, XDG_CACHE_HOME=str(tmp_path / "home"))
    assert done.stdout.strip() == str(tmp_path / "home" / "fractal_farm" / "kernels")
    assert done.stderr.count("\n") == 1
    assert blocked in done.stderr


def test_without_any_directory_kernels_are_compiled_in_the_process():
    done = run("tempfile.tempdir = '/proc/self'", NUMBA_CACHE_DIR="/proc/self", XDG_CACHE_HOME="/proc/self")
    assert done.stdout.strip() == "None"
    assert done.stderr.count("\n") == 1
    assert "anew" in done.stderr


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", ["empty", "truncated", "a flipped bit", "garbage"])
def test_a_damaged_cache_is_compiled_for_again_and_mended(tmp_path, suffix, damage):
    run(NUMBA_CACHE_DIR=str(tmp_path))
    (path,) = tmp_path.rglob(f"*determinant*.{suffix}")
    sound = path.read_bytes()
    flipped = bytearray(sound)
    flipped[len(sound) // 2] ^= 4
    path.write_bytes({"empty": b"", "truncated": sound[:50], "a flipped bit": flipped, "garbage": b"x" * 99}[damage])
    done = run(NUMBA_CACHE_DIR=str(tmp_path))
    assert (done.stdout.strip(), done.stderr) == (str(tmp_path), "")
    assert path.read_bytes() != bytes(flipped)
    assert len(path.read_bytes()) > 99


def test_a_full_disk_costs_one_line_and_the_cache(tmp_path):
    prelude = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (64, 64))"
    prelude += "; import signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN)"
    done = run(prelude, NUMBA_CACHE_DIR=str(tmp_path))
    assert done.stderr.count("\n") == 1
    assert "cannot be saved" in done.stderr


def test_a_directory_that_others_may_write_to_is_not_trusted(tmp_path):
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    done = run(NUMBA_CACHE_DIR=str(shared), XDG_CACHE_HOME=str(tmp_path / "home"))
    assert done.stdout.strip() == str(tmp_path / "home" / "fractal_farm" / "kernels")
    assert str(shared) in done.stderr
