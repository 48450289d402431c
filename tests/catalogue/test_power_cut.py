"""Power cuts: the order of system calls of a real run, and real cuts of a real ext4 where the machine allows it."""

from __future__ import annotations

import fcntl
import multiprocessing
import os
import random
import re
import shutil
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from fractal_farm.catalogue import Catalogue, committed_records, create_run
from fractal_farm.catalogue.layout import DESIGNS, part_name
from fractal_farm.catalogue.parts import read_commits
from fractal_farm.catalogue.verify import verify
from fractal_farm.errors import FarmError
from tests.catalogue import under_fire
from tests.catalogue.examples import RUN
from tests.cli.conftest import submit_arguments

pytestmark = pytest.mark.slow

CALLS = "openat,fsync,fdatasync,rename,renameat,renameat2,link,linkat,mkdir,mkdirat,write,close"
EXT4_IOC_SHUTDOWN = 0x8004587D
WITHOUT_FLUSHING_THE_JOURNAL = struct.pack("I", 2)
CUTS = 8


@dataclass(frozen=True)
class Call:
    """One system call that succeeded: its name, and the paths or texts in it."""

    name: str
    paths: tuple[str, ...]


def calls(trace: Path) -> Iterator[Call]:
    """The calls of a trace in the order in which they returned."""
    begun: dict[str, str] = {}
    for line in trace.read_text(errors="replace").splitlines():
        process, _, rest = line.partition(" ")
        rest = rest.strip()
        if rest.endswith("<unfinished ...>"):
            begun[process] = rest.removesuffix("<unfinished ...>")
            continue
        if resumed := re.match(r"<\.\.\. \w+ resumed>", rest):
            rest = begun.pop(process, "") + rest[resumed.end() :]
        if found := re.fullmatch(r"(\w+)\((.*)\)\s+= (\d+).*", rest):
            name, arguments, _ = found.groups()
            paths = re.findall(r'\d+<(/[^>]*)>|"((?:[^"\\]|\\.)*)"', arguments)
            yield Call(name, tuple(first or second for first, second in paths))


@pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not installed")
def test_every_name_of_a_run_is_durable_before_anything_relies_on_it(tmp_path):
    out, trace = tmp_path / "run", tmp_path / "trace"
    # A generation keeps few designs: lower the bar, so that there are clouds; several epochs a part, and solids.
    more = [
        "--set",
        "catalogue.durability=full",
        "--set",
        "catalogue.keep=accepted",
        "--set",
        "evolution.elimination=0.3",
    ]
    arguments = submit_arguments(out, *more)
    farm = [sys.executable, "-c", "import sys; from fractal_farm.cli import main; sys.exit(main())"]
    subprocess.run(
        ["strace", "-f", "-y", "-s", "300", "-e", f"trace={CALLS}", "-o", trace, *farm, *arguments], check=True
    )
    seen = list(calls(trace))
    synced = [(place, Path(call.paths[0])) for place, call in enumerate(seen) if call.name in ("fsync", "fdatasync")]

    def is_synced(path, after, before):
        return any(after < place < before and found == path for place, found in synced)

    renamed, acknowledged = {}, []
    for place, call in enumerate(seen):
        if call.name.startswith(("rename", "link")) and call.paths[1].startswith(str(out)):
            source, target = map(Path, call.paths[:2])
            renamed[target] = place
            assert is_synced(source, -1, place), f"{target} appears before its content is durable"
            for file in target.iterdir() if target.is_dir() else ():
                assert is_synced(source / file.name, -1, place), f"{target} appears before {file.name} is durable"
        if call.name == "write" and "PartCommitted" in call.paths[-1] and "/logs/" in call.paths[0]:
            acknowledged.append(place)
    for target, place in renamed.items():
        assert is_synced(target.parent, place, len(seen)), f"the name {target} is never durable"
    for place, call in enumerate(seen):
        if call.name.startswith("mkdir") and call.paths[-1].startswith(str(out)) and ".partial" not in call.paths[-1]:
            made = Path(call.paths[-1])
            relying = [later for target, later in renamed.items() if made in target.parents and later > place]
            if relying:
                assert is_synced(made.parent, place, min(relying)), f"{made} is relied on before it is durable"
    parts = [target for target in renamed if target.parent == out / DESIGNS]
    assert parts
    assert len(acknowledged) == len(parts)
    for part, told in zip(sorted(parts, key=lambda part: renamed[part]), acknowledged, strict=True):
        assert is_synced(part.parent, renamed[part], told), f"{part} is acknowledged before it is durable"
        (commit,) = read_commits(out, part_name(part.name))
        files = commit.files
        assert files
        for cloud in (out / key for key in files):
            assert is_synced(cloud.parent, renamed[cloud], renamed[part]), f"{part} refers to {cloud} too early"
    assert verify(out, "deep").findings == ()


@pytest.fixture
def disk(tmp_path) -> Iterator[Path]:
    """An ext4 of its own; yields its image. It is mounted on `<image>.mounted`."""
    image, mounted = tmp_path / "disk", tmp_path / "disk.mounted"
    mounted.mkdir()
    with image.open("wb") as file:
        file.truncate(256 << 20)
    tools = all(shutil.which(tool) for tool in ("mkfs.ext4", "mount", "umount"))
    if not tools or subprocess.run(["mkfs.ext4", "-q", image]).returncode or not mount(image, mounted):
        pytest.skip("no right to mount an ext4 image here")
    yield image
    subprocess.run(["umount", mounted], check=False)


def mount(image: Path, mounted: Path) -> bool:
    return subprocess.run(["mount", "-o", "loop", image, mounted], capture_output=True).returncode == 0


def cut_power(mounted: Path) -> None:
    """Stop the file system at once: what is not on the disk by now never will be."""
    descriptor = os.open(mounted, os.O_RDONLY)
    try:
        fcntl.ioctl(descriptor, EXT4_IOC_SHUTDOWN, WITHOUT_FLUSHING_THE_JOURNAL)
    finally:
        os.close(descriptor)


def commit_until_the_power_fails(root: Path, attempt: int, told: Path) -> None:
    try:
        under_fire.live(root, attempt, told)
    except (FarmError, OSError):
        os._exit(1)


def test_power_cuts_lose_nothing_that_was_acknowledged(disk, tmp_path):
    mounted, told, chance = tmp_path / "disk.mounted", tmp_path / "told", random.Random(CUTS)
    told.mkdir()
    root = Catalogue.create(mounted / "my.farm").path
    create_run(root, RUN, {"note": "under fire"})
    for attempt in range(CUTS):
        life = multiprocessing.get_context("fork").Process(
            target=commit_until_the_power_fails, args=(root, attempt, told)
        )
        life.start()
        time.sleep(chance.uniform(0.5, 2.0))
        cut_power(mounted)
        life.join(30)
        assert life.exitcode == 1
        subprocess.run(["umount", mounted], check=True)
        assert mount(disk, mounted)
        acknowledged = [int(line) for line in (told / "acknowledged").read_text().split()]
        committed = [epochs[0] for epochs, _ in committed_records(root, RUN)]
        assert committed == list(range(len(committed)))
        assert set(acknowledged) <= set(committed)
        assert verify(root, "full").exit_code == 0
    assert len(acknowledged) > 10 * CUTS
