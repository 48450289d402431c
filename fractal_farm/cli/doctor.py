"""`farm doctor`: whether this machine can run the farm, and what to do about what is amiss."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import typer

from fractal_farm.cli.output import AsJson, byte_count, print_json, print_table

_PACKAGES = (
    "ray",
    "numpy",
    "numba",
    "scipy",
    "zarr",
    "pyarrow",
    "scikit-image",
    "manifold3d",
    "trimesh",
    "embreex",
)
_MEMORY_NEEDED = 2e9
_DISK_NEEDED = 2e9
_SHARED_MEMORY_NEEDED = 256e6
_D2_TOLERANCE = 0.05
_GAP_TOLERANCE = 0.01
_FEW_POINTS = 500
_FEW_PIXELS = 64
_ROD_MM = 20.0


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Attributes:
        name: what.
        ok: whether the farm can run with it.
        found: what is there.
        remedy: what to do if it is not ok.
    """

    name: str
    ok: bool
    found: str
    remedy: str = ""


def doctor(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Where catalogues will be written.")] = Path(),
    ray: Annotated[bool, typer.Option("--ray", help="Also start Ray and run a task on it (seconds).")] = False,
    as_json: AsJson = False,
) -> None:
    """Check that this machine can run the farm."""
    checks = [check for probe in _probes(directory, ray) for check in _safely(probe)]
    if as_json:
        print_json({"ok": all(check.ok for check in checks), "checks": [asdict(check) for check in checks]})
    else:
        rows = [["ok" if c.ok else "FAIL", c.name, c.found + (f"; {c.remedy}" if not c.ok else "")] for c in checks]
        print_table(["", "what", "found"], rows)
    if not all(check.ok for check in checks):
        raise typer.Exit(1)


def _probes(directory: Path, ray: bool) -> list[Callable[[], Iterator[Check]]]:
    probes = [_python, _packages, _processor_and_memory, lambda: _disk(directory), _shared_memory, _kernels]
    return [*probes, _ray] if ray else probes


def _safely(probe: Callable[[], Iterator[Check]]) -> Iterator[Check]:
    """A probe that breaks is a finding, not the end of the examination."""
    try:
        yield from probe()
    except Exception as error:
        name = getattr(probe, "__name__", "probe").strip("_<>").replace("_", " ")
        yield Check(name, False, f"{type(error).__name__}: {error}", "see farm doctor --debug")


def _python() -> Iterator[Check]:
    version = ".".join(map(str, sys.version_info[:3]))
    yield Check("python", sys.version_info >= (3, 11), version, "install Python 3.11 or later")


def _packages() -> Iterator[Check]:
    from importlib import metadata

    for name in _PACKAGES:
        try:
            yield Check(name, True, metadata.version(name))
        except metadata.PackageNotFoundError:
            yield Check(name, False, "not installed", "pip install -c constraints.txt .")


def _processor_and_memory() -> Iterator[Check]:
    import psutil

    cores = len(os.sched_getaffinity(0))
    yield Check("cores", cores >= 1, str(cores))
    free = psutil.virtual_memory().available
    yield Check("memory", free >= _MEMORY_NEEDED, f"{byte_count(free)} free", "free 2 GB, or give fewer workers")


def _disk(directory: Path) -> Iterator[Check]:
    place = directory.absolute()
    while not place.exists():
        place = place.parent
    free = shutil.disk_usage(place).free
    yield Check(
        "disk",
        free >= _DISK_NEEDED,
        f"{byte_count(free)} free at {place}",
        "free 2 GB, or choose another disk",
    )
    writable = os.access(place, os.W_OK | os.X_OK)
    yield Check("directory", writable, f"{place}", "choose a directory that you may write to")
    free = shutil.disk_usage(tempfile.gettempdir()).free
    yield Check("temporary files", free >= _DISK_NEEDED, f"{byte_count(free)} free", "set TMPDIR to a larger disk")


def _shared_memory() -> Iterator[Check]:
    free = shutil.disk_usage("/dev/shm").free
    remedy = "Ray would use the disk; in a container give --shm-size=1g"
    yield Check("/dev/shm", free >= _SHARED_MEMORY_NEEDED, f"{byte_count(free)} free", remedy)


def _kernels() -> Iterator[Check]:
    """Compile all kernels that a run calls, or load them from the cache, by making one design from end to end."""
    import numpy as np

    from fractal_farm import attractor_points, evaluate, solidify
    from fractal_farm.ifs.gap import gap
    from fractal_farm.ifs.genome import Genome
    from fractal_farm.ifs.kernel import cache_root
    from fractal_farm.ifs.quantised_cloud import quantised_attractors
    from fractal_farm.picture import cloud_picture

    cache = cache_root()
    remedy = "set NUMBA_CACHE_DIR to a directory that you may write to"
    yield Check("kernel cache", cache is not None, str(cache or "nowhere to write to"), remedy)
    start = time.perf_counter()
    rows = [[0.0, 0.0, 0.0, 0.5, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.5, -1.0, 0.0, 0.0]]
    segment = Genome(np.array(rows))
    dimension = float(evaluate([segment]).d2[0])
    seconds = time.perf_counter() - start
    found = f"ready in {seconds:.1f} s; a line segment has D2 {dimension:.3f}"
    remedy = "reinstall with pip install -c constraints.txt ."
    yield Check("scores", abs(dimension - 1.0) < _D2_TOLERANCE, found, remedy)
    start = time.perf_counter()
    in_one_piece = gap(segment) < _GAP_TOLERANCE
    quantised_attractors([segment], _FEW_POINTS)
    cloud_picture(attractor_points(segment, _FEW_POINTS), size=_FEW_PIXELS)
    mesh = solidify(segment, size_mm=_ROD_MM, wall_mm=1.0)
    seconds = time.perf_counter() - start
    found = f"ready in {seconds:.1f} s; a rod of {_ROD_MM:g} mm has {len(mesh.faces)} triangles"
    yield Check("solids and pictures", in_one_piece and mesh.is_watertight, found, remedy)


def _ray() -> Iterator[Check]:
    from fractal_farm.cli.output import results_only_on_stdout
    from fractal_farm.farm.on_ray.session import session

    start = time.perf_counter()
    with results_only_on_stdout(), session(None, 1):
        seconds = time.perf_counter() - start
    yield Check("Ray start", True, f"in {seconds:.1f} s")
