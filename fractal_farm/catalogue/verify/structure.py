"""The quick look: is every file there that should be, with its size, and nothing that should not?"""

from __future__ import annotations

import re
from collections.abc import Iterator

import pyarrow.compute as pc

from fractal_farm.catalogue.documents import opened_document
from fractal_farm.catalogue.durable import PARTIAL, is_being_filled
from fractal_farm.catalogue.fence import FENCE
from fractal_farm.catalogue.fence import is_whole as is_whole_fence
from fractal_farm.catalogue.judging import missing_numbers
from fractal_farm.catalogue.layout import (
    CLOUDS,
    DESIGNS,
    HAND,
    IDENTITY,
    MENDINGS,
    RUNS,
    SNAPSHOTS,
    SOLIDS,
    crc32c,
    part_name,
)
from fractal_farm.catalogue.runs import LOCK, is_whole_lock
from fractal_farm.catalogue.shards import ROOT, is_root_document, root_documents
from fractal_farm.catalogue.solids import CHECKSUMS
from fractal_farm.catalogue.verify.contents import Contents, named_checksum
from fractal_farm.catalogue.verify.findings import Finding

SHEET = "catalogue.png"
REPORT = "report.html"
GROW = "`farm verify --repair` grows the clouds again from their genomes"
_RESUME = "`farm resume` removes it, `farm verify --repair` moves it aside"
_UNFINISHED = "a file that was never finished"
_RUN_ID = re.compile(r"[0-9a-z]{4,32}")
_SOLID = re.compile(rf"{SOLIDS}/[0-9a-f]{{32}}/[0-9A-Za-z_-]{{1,64}}")


def structure_findings(contents: Contents) -> Iterator[Finding]:
    """What names, sizes and small documents tell; fills in `contents.runs`."""
    yield from _roots(contents)
    yield from _runs(contents)
    yield from _judgements(contents)
    yield from _epochs(contents)
    yield from _clouds(contents)
    yield from _solids(contents)
    yield from _pictures(contents)
    yield from _unknown(contents)


def solid_directories(contents: Contents) -> list[str]:
    """Keys of the finished solids."""
    return sorted(key for key in contents.directories if _SOLID.fullmatch(key))


def solid_files(contents: Contents, solid: str) -> dict[str, tuple[int, int]] | None:
    """Plain name -> (bytes, CRC32C) of a solid's files; None if its list is missing or damaged."""
    content = contents.read(f"{solid}/{CHECKSUMS}")
    document = None if isinstance(content, str) else opened_document(content)
    if document is None:
        return None
    return {name: (facts["bytes"], facts["crc32c"]) for name, facts in document["files"].items()}


def _roots(contents: Contents) -> Iterator[Finding]:
    for key in root_documents():
        content = contents.read(key)
        if isinstance(content, str) or not is_root_document(key, content):
            problem = content if isinstance(content, str) else "damaged: its checksum does not match"
            yield Finding(key, "root", problem, "`farm verify --repair` writes it again")
    if IDENTITY in contents.sizes.keys() | contents.directories:
        content = contents.read(IDENTITY)
        if isinstance(content, str) or opened_document(content) is None:
            problem = content if isinstance(content, str) else "damaged: its checksum does not match"
            yield Finding(IDENTITY, "run", problem, "`farm verify --repair` mends it if it is one flipped bit")


def _runs(contents: Contents) -> Iterator[Finding]:
    wanted = {part.run_id for part in contents.parts}
    there = {key.split("/")[1] for key in contents.directories if key.startswith(f"{RUNS}/")}
    for run_id in sorted(wanted | there):
        key = f"{RUNS}/{run_id}/run.json"
        contents.runs[run_id] = None
        if not _RUN_ID.fullmatch(run_id):
            yield Finding(f"{RUNS}/{run_id}", "leftover", "is not a run's name", "move it away", damage=False)
            continue
        content = contents.read(key)
        if isinstance(content, str):
            if (run_id in wanted and run_id != HAND) or content != "missing":
                remedy = "restore it from a copy; without it the run cannot be resumed"
                yield Finding(key, "run", content, remedy)
            continue
        contents.runs[run_id] = opened_document(content)
        if contents.runs[run_id] is None:
            problem = "damaged: its checksum does not match"
            yield Finding(key, "run", problem, "`farm verify --repair` mends it if it is one flipped bit")
    for key in sorted(contents.sizes.keys() | contents.directories):
        if re.fullmatch(rf"{RUNS}/[^/]*/[a-z]+~\d+~[0-9a-f]{{8}}\.json", key):
            content = contents.read(key)
            if content == "missing":
                continue  # a wish that the run has taken up meanwhile
            if isinstance(content, str) or crc32c(content) != named_checksum(key) or opened_document(content) is None:
                remedy = "`farm verify --repair` mends it if it is one flipped bit"
                yield Finding(key, "end", "damaged: its checksum does not match", remedy)
        elif found := re.fullmatch(rf"{RUNS}/([^/]*)/({LOCK}|{FENCE})", key):
            content = contents.read(key)
            whole = is_whole_lock if found[2] == LOCK else is_whole_fence
            if found[1] not in contents.live and (isinstance(content, str) or not whole(content)):
                problem = content if isinstance(content, str) else "damaged: its checksum does not match"
                yield Finding(key, "leftover", problem, "`farm resume` or `farm verify --repair` writes it again")


def _judgements(contents: Contents) -> Iterator[Finding]:
    """Judgements are numbered without gaps."""
    folder = f"{RUNS}/{HAND}/"
    for number in missing_numbers([key.removeprefix(folder) for key in contents.sizes if key.startswith(folder)]):
        remedy = "restore it from a copy; `farm verify --repair` closes the gap"
        yield Finding(f"{folder}judgement~{number:08d}", "judgement", "missing", remedy)


def _epochs(contents: Contents) -> Iterator[Finding]:
    """Epochs of a run that no sound part holds; what is committed last may also be missed by the end of the run."""
    spans: dict[str, list[tuple[int, int]]] = {}
    for part in contents.parts:
        spans.setdefault(part.run_id, []).extend(commit.epochs for commit in part.commits)
    for run_id, description in contents.runs.items():
        reached = 0
        gaps = []
        for first, last in sorted(spans.get(run_id, [])):
            if first > reached:
                gaps.append((reached, first - 1))
            reached = max(reached, last + 1)
        # A live run may have committed, and ended, after its parts were listed.
        settled = description is not None and run_id not in contents.live
        ended = ended_after(contents, run_id) if settled else 0
        if ended > reached:
            gaps.append((reached, ended - 1))
        for first, last in gaps:
            yield Finding(
                f"{RUNS}/{run_id}",
                "epochs",
                f"no manifest part holds epochs {first} to {last}",
                "restore the part from a copy, or `farm resume` grows these epochs again, bit for bit",
            )


def ended_after(contents: Contents, run_id: str) -> int:
    """The most epochs that an end of this run tells of; 0 if there is none."""
    most = 0
    for key in contents.sizes:
        if key.startswith(f"{RUNS}/{run_id}/final~"):
            content = contents.read(key)
            document = None if isinstance(content, str) else opened_document(content)
            progress = (document or {}).get("progress")
            epochs = progress.get("epochs") if isinstance(progress, dict) else None
            most = max(most, epochs if isinstance(epochs, int) else 0)
    return most


def _clouds(contents: Contents) -> Iterator[Finding]:
    for key, accepted in sorted(contents.accepted.items()):
        size = contents.sizes.get(key)
        if size is None:
            problem = "a directory stands in its place" if key in contents.directories else "missing"
            yield Finding(key, "cloud", problem, GROW, clouds_in(contents, key))
        elif size not in {length for length, _ in accepted}:
            problem = f"has {size} bytes; its part says {min(accepted)[0]}"
            yield Finding(key, "cloud", problem, GROW, clouds_in(contents, key))
        elif lost := contents.lost.get(key):
            remedy = "restore it from a copy, or verify on a machine like the one that grew them"
            yield Finding(key, "cloud", "an earlier repair could not restore all clouds", remedy, tuple(lost))


def clouds_in(contents: Contents, key: str) -> tuple[str, ...]:
    """The designs whose clouds a cloud file holds; all of its writer's if it is metadata."""
    chunk = key.rpartition("/")[2].split(".")
    rows = contents.rows(contents.part_of[key], ["design_id", "cloud_row"], int(chunk[1]) if chunk[0] == "c" else None)
    return tuple(rows.filter(pc.is_valid(rows.column("cloud_row"))).column("design_id").to_pylist())


def _solids(contents: Contents) -> Iterator[Finding]:
    remake = "`farm verify --repair` makes the solid again"
    for solid in solid_directories(contents):
        listed = solid_files(contents, solid)
        concerned = (solid.split("/")[1],)
        if listed is None:
            yield Finding(solid, "solid", f"{CHECKSUMS} is missing or damaged", remake, concerned)
            continue
        for name, (size, _) in listed.items():
            found = contents.sizes.get(f"{solid}/{name}")
            if found != size:
                problem = f"{name} is missing" if found is None else f"{name} has {found} bytes instead of {size}"
                yield Finding(solid, "solid", problem, remake, concerned)


def _pictures(contents: Contents) -> Iterator[Finding]:
    """What each end of a run with designs leaves; a report came with a later version and may be missing."""
    again = "`farm verify --repair` makes it again"
    ended = any(key.startswith(f"{RUNS}/") and "/final~" in key for key in contents.sizes)
    for key in (SHEET, REPORT):
        if key in contents.directories:
            yield Finding(key, "picture", "a directory stands in its place", again)
        elif key == SHEET and ended and key not in contents.sizes and any(part.name.rows for part in contents.parts):
            yield Finding(key, "picture", "missing", again)


def _unknown(contents: Contents) -> Iterator[Finding]:
    """What no rule of the layout explains: leftovers of killed processes, and strangers among our files."""
    for key in sorted(contents.sizes):
        folder, _, name = key.rpartition("/")
        top = key.split("/")[0]
        if name.startswith(".") and name.endswith(PARTIAL):
            run_id = re.split("[-~]", name[1:])[0]
            owner = key.split("/")[1].partition("-")[0] if top == CLOUDS else run_id
            if top == RUNS:
                owner = key.split("/")[1]
            if not folder and not contents.live:
                yield Finding(key, "leftover", _UNFINISHED, "`farm verify --repair` moves it aside", damage=False)
            elif folder and owner not in contents.live:
                yield Finding(key, "leftover", _UNFINISHED, _RESUME, damage=False)
        elif top == CLOUDS and key != f"{CLOUDS}/{ROOT}" and key not in contents.accepted:
            owner = key.split("/")[1].partition("-")[0]
            if owner not in contents.live:
                problem = "no manifest part refers to it"
                yield Finding(key, "leftover", problem, _RESUME, damage=owner not in contents.runs)
        elif key in contents.replaced:
            if name.partition("-")[0] not in contents.live:
                yield Finding(key, "leftover", "was merged into a larger part", _RESUME, damage=False)
        elif (
            (folder == DESIGNS and part_name(name) is None)
            or (folder == SNAPSHOTS and named_checksum(key) is None)
            or (top == "manifest" and folder not in (DESIGNS, MENDINGS))
        ):
            yield Finding(key, "leftover", "not a name that the farm gives", "`farm verify --repair` moves it aside")
    for key in sorted(contents.directories):
        if key.startswith(f"{SOLIDS}/") and key.endswith(PARTIAL) and not is_being_filled(contents.root / key):
            yield Finding(key, "leftover", "a solid that was never finished", _RESUME, damage=False)
        if key.startswith(f"{SNAPSHOTS}/"):
            yield Finding(key, "leftover", "a directory among the snapshots", "`farm verify --repair` moves it aside")
