"""What a process evaluates at the moment, for the next session: a process that dies of a genome cannot tell of it.

Without workers the run itself dies of such a genome, again and again. It leaves the place behind, and the next session
evaluates what stands there in processes of its own (`farm.trials`). The file may be lost: then it takes one death more.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

Place = tuple[int, int, int]
"""Island, epoch, and number of the block of genomes within it."""


class Journal:
    """The place where the run is, and the places where it died before.

    Attributes:
        suspects: places that earlier sessions did not survive.
    """

    def __init__(self, root: Path, run_id: str) -> None:
        """Read what a dead session left; the caller holds the run's lock."""
        self._path = root / "logs" / f"{run_id}.evaluating"
        self._path.parent.mkdir(exist_ok=True)
        self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        self.suspects = {place for line in os.pread(self._file, 1 << 16, 0).splitlines() for place in _places(line)}

    def enter(self, place: Place) -> None:
        """Say what is evaluated from now on."""
        lines = "".join(f"{' '.join(map(str, known))}\n" for known in [place, *sorted(self.suspects)])
        with contextlib.suppress(OSError):  # a full disk, which the run will notice by itself
            os.ftruncate(self._file, os.pwrite(self._file, lines.encode(), 0))

    def clear(self, place: Place) -> None:
        """Nobody dies there."""
        self.suspects.discard(place)

    def close(self) -> None:
        """The session ends alive."""
        os.close(self._file)
        self._path.unlink(missing_ok=True)


def _places(line: bytes) -> list[Place]:
    """The place in a line; none in one that is torn."""
    try:
        island, epoch, block = map(int, line.split())
    except ValueError:
        return []
    return [(island, epoch, block)]
