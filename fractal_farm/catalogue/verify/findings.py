"""What a verification finds, one thing at a time, and the report that they add up to."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

Level = Literal["quick", "full", "deep"]
LEVELS: tuple[str, ...] = get_args(Level)

Kind = Literal[
    "root",
    "part",
    "epochs",
    "mending",
    "cloud",
    "run",
    "end",
    "judgement",
    "snapshot",
    "solid",
    "picture",
    "row",
    "leftover",
]
"""What is wrong with what: it decides how it is mended."""

SOUND, DAMAGED, LOST = 0, 1, 3


@dataclass(frozen=True)
class Finding:
    """One thing that is not as it should be.

    Attributes:
        path: the file or directory, relative to the catalogue.
        kind: what it belongs to.
        problem: what is wrong with it.
        remedy: what would mend it.
        designs: the ids of the designs concerned, as far as they are known.
        damage: False for what a killed process may leave behind and what is merely worth knowing.
        outcome: what a repair did about it; None before one.
        lost: whether something is missing for good after the repair.
    """

    path: str
    kind: Kind
    problem: str
    remedy: str
    designs: tuple[str, ...] = ()
    damage: bool = True
    outcome: str | None = None
    lost: bool = False


@dataclass(frozen=True)
class Report:
    """What a verification, or a repair, comes to.

    Attributes:
        path: the catalogue.
        level: how thoroughly it was looked at.
        repaired: whether a repair was asked for.
        findings: in order of their paths; of a repair, what it found first.
        remaining: of a repair, what it found afterwards; otherwise empty.
        files: files that were looked at.
        bytes: bytes whose checksums were compared.
        designs: rows of the sound manifest parts.
        digest: the content digest; None where it was not computed (quick), or could not be.
    """

    path: str
    level: str
    repaired: bool
    findings: tuple[Finding, ...]
    remaining: tuple[Finding, ...]
    files: int
    bytes: int
    designs: int
    digest: str | None

    @property
    def exit_code(self) -> int:
        """0 sound or wholly restored, 1 damage found, 3 damage that a repair could not undo."""
        if self.repaired:
            lost = any(finding.lost for finding in self.findings)
            return LOST if lost or any(finding.damage for finding in self.remaining) else SOUND
        return DAMAGED if any(finding.damage for finding in self.findings) else SOUND

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON: the fields, and "exit_code"."""
        return {**asdict(self), "exit_code": self.exit_code}
