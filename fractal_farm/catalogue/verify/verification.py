"""`verify`: one look at a whole catalogue, at one of three levels."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from fractal_farm.catalogue.documents import opened_document
from fractal_farm.catalogue.layout import CLOUDS, DESIGNS, RUNS
from fractal_farm.catalogue.reader import Catalogue
from fractal_farm.catalogue.shards import ROOT, is_root_document
from fractal_farm.catalogue.verify.bytes_of_files import byte_findings
from fractal_farm.catalogue.verify.contents import Contents, listed_contents
from fractal_farm.catalogue.verify.findings import Finding, Level, Report
from fractal_farm.catalogue.verify.structure import structure_findings
from fractal_farm.errors import InputError


def verify(root: Path, level: Level = "full", held: frozenset[str] = frozenset()) -> Report:
    """Look whether everything that was committed is there as it was written; nothing is changed.

    Args:
        root: directory of the catalogue; a farm may be writing to it.
        level: "quick" for names, sizes, manifest parts and small documents; "full" for every byte; "deep" also grows
            every cloud and computes every score again.
        held: runs whose locks the caller holds.

    Returns:
        What was found, in order of paths. Whatever garbage lies there is a finding.

    Raises:
        InputError: no catalogue at all, or one of a format that this version cannot read.
    """
    check_is_catalogue(root)
    contents = listed_contents(root, held)
    rows = sum(part.name.rows for part in contents.parts)
    findings = [*structure_findings(contents)]
    digest = None
    if level != "quick":
        findings += byte_findings(contents)
        if not any(finding.kind in ("part", "row") for finding in [*contents.findings, *findings]):
            digest = Catalogue(root).digest()
            findings += _digests(contents, digest)
    if level == "deep":
        from fractal_farm.catalogue.verify.content import content_findings

        findings += content_findings(contents)
    findings += contents.findings  # also of what was listed meanwhile
    ordered = tuple(sorted(findings, key=lambda finding: (finding.path, finding.kind, finding.problem)))
    return Report(str(root), level, False, ordered, (), len(contents.sizes), contents.bytes_checked, rows, digest)


def check_is_catalogue(root: Path) -> None:
    """Refuse what is no catalogue, however damaged.

    Raises:
        InputError: no directory, nothing of a catalogue in it, or of a newer format.
    """
    if not root.is_dir():
        raise InputError(f"{root}: {'is a file' if root.exists() else 'no such directory'}; give a catalogue")
    if not any((root / name).exists() for name in (RUNS, DESIGNS, f"{CLOUDS}/{ROOT}")):
        raise InputError(f"{root}: not a catalogue (it has neither runs nor a manifest); give the directory of a run")
    with contextlib.suppress(OSError):
        if is_root_document(ROOT, (root / ROOT).read_bytes()):
            Catalogue.open(root)


def _digests(contents: Contents, digest: str) -> Iterator[Finding]:
    """The content digest of each run, against the one that its last end recorded for the same epochs.

    Args:
        contents: the catalogue.
        digest: of the whole catalogue; that of its run if there is but one.
    """
    ends: dict[str, tuple[str, int, str]] = {}
    for key in sorted(contents.sizes):
        if key.startswith(f"{RUNS}/") and "/final~" in key:
            content = contents.read(key)
            facts = None if isinstance(content, str) else opened_document(content)
            progress = (facts or {}).get("progress")
            if facts and isinstance(progress, dict) and "digest" in facts:
                ends[key.split("/")[1]] = (key, progress.get("epochs", 0), facts["digest"])
    for run_id, (key, epochs, recorded) in ends.items():
        mine = (commit for part in contents.parts if part.run_id == run_id for commit in part.commits)
        reached = max((commit.epochs[1] + 1 for commit in mine), default=0)
        if reached == epochs and run_id not in contents.live:
            alone = all(part.run_id == run_id for part in contents.parts)
            found = digest if alone else Catalogue(contents.root).digest(run_id)
            if found != recorded:
                problem = f"the content digest is {found}; the run ended with {recorded}"
                yield Finding(key, "row", problem, "restore what is missing from a copy, or resume the run")
