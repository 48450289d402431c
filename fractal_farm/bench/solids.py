"""What solids cost: seconds of each stage and peak memory, for the paper's printed genomes (`farm bench --solids`).

Each solid is made in a process of its own, after a small one that compiles the code, so that the peak of memory is its
own. Certificate and files are stages too: everything from a genome to bytes on disk is counted.
"""

from __future__ import annotations

import itertools
import multiprocessing
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fractal_farm.bench.genomes import TABLE1
from fractal_farm.errors import FarmError
from fractal_farm.ifs.genome import as_genome

RESOLUTIONS = (200, 400)
STAGES = (
    "gap",
    "cover",
    "distance field",
    "one body",
    "marching cubes",
    "simplify",
    "certificate",
    "files",
)
_SMALL = 120  # voxels, of the solid that compiles and loads everything
_PATIENCE_SECONDS = 600.0


@dataclass(frozen=True)
class SolidCost:
    """One solid, 30 mm with a wall of 0.8 mm.

    Attributes:
        name: of the genome in table 1.
        resolution: voxels along its longest side.
        seconds: of each stage, by wall clock.
        total: all of them.
        peak_bytes: the most memory that its process ever had.
        predicted_bytes: what was predicted, with what the process had before.
        faces: triangles of the finished mesh.
        cover: the method that covered the attractor.
    """

    name: str
    resolution: int
    seconds: dict[str, float]
    total: float
    peak_bytes: int
    predicted_bytes: int
    faces: int
    cover: str


def measure_solids(
    say: Callable[[str], None], names: tuple[str, ...] = tuple(TABLE1), resolutions: tuple[int, ...] = RESOLUTIONS
) -> tuple[SolidCost, ...]:
    """Measure all genomes at all resolutions, one after the other; `say` hears of each."""
    costs = []
    for resolution in resolutions:
        for name in names:
            say(f"farm bench: {name} at {resolution} voxels")
            costs.append(_apart(name, resolution))
    return tuple(costs)


def _apart(name: str, resolution: int) -> SolidCost:
    """`_measure` in a process of its own."""
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_measure, args=(name, resolution, sender))
    process.start()
    sender.close()
    try:
        if not receiver.poll(_PATIENCE_SECONDS):
            raise FarmError(f"the solid of {name} at {resolution} voxels took over {_PATIENCE_SECONDS:.0f} seconds")
        cost: SolidCost = receiver.recv()
    except EOFError:
        raise FarmError(f"the process of {name} at {resolution} voxels died; is there memory left?") from None
    finally:
        process.kill()
        process.join()
    return cost


def _measure(name: str, resolution: int, sender: Any) -> None:
    import psutil

    from fractal_farm.solid.certificate import certificate
    from fractal_farm.solid.files import mesh_files
    from fractal_farm.solid.parameters import SolidParameters
    from fractal_farm.solid.pipeline import make_solid

    mesh_files(make_solid(as_genome(TABLE1["06447"]), SolidParameters(resolution=_SMALL)))
    before = psutil.Process().memory_info().rss
    begun: list[tuple[str, float]] = []

    def begin(stage: str, _: float = 0.0) -> None:
        begun.append((stage, time.perf_counter()))

    mesh = make_solid(as_genome(TABLE1[name]), SolidParameters(resolution=resolution), begin)
    begin("certificate")
    certificate(mesh)
    begin("again")  # as `mesh_files` does, with what trimesh remembers of a mesh
    certificate(mesh)
    begin("files")
    mesh_files(mesh)
    begin("end")
    lasted = {stage: end - start for (stage, start), (_, end) in itertools.pairwise(begun)}
    lasted["files"] = max(lasted["files"] - lasted["again"], 0.0)
    seconds = {stage: lasted[stage] for stage in STAGES}
    sender.send(
        SolidCost(
            name,
            resolution,
            seconds,
            sum(seconds.values()),
            _peak_bytes(),
            before + int(mesh.metadata["memory_predicted"]),
            len(mesh.faces),
            mesh.metadata["cover"],
        )
    )


def _peak_bytes() -> int:
    """The most that this process has taken so far; `getrusage` would count what its parent had, too."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024
