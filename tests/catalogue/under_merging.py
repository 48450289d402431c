"""A merge that is killed again and again: `python under_merging.py CATALOGUE KILLS`.

Each life is a forked process that merges parts two by two, then what came of that, and so on; it is killed with SIGKILL
after a random time. The last line printed is a JSON object.
"""

from __future__ import annotations

import json
import os
import random
import signal
import sys
import time
from pathlib import Path

from fractal_farm.catalogue import compaction, run_lock
from tests.catalogue.examples import BORN_IN_AN_EPOCH, RUN

EPOCHS = 64
LONGEST_LIFE_SECONDS = 0.4


def live(root: Path) -> None:
    """One life: merge in steps, each to twice as many rows, until killed."""
    with run_lock(root, RUN):
        rows = 2 * BORN_IN_AN_EPOCH
        while rows < EPOCHS * BORN_IN_AN_EPOCH:
            compaction.LARGE_ROWS = rows
            compaction.compact(root, RUN, "process", below=rows)
            rows *= 2
        time.sleep(60)


def main() -> None:
    """Start lives and end them."""
    root, kills = Path(sys.argv[1]), int(sys.argv[2])
    chance = random.Random(kills)
    for _ in range(kills):
        child = os.fork()
        if child == 0:
            live(root)
        time.sleep(chance.uniform(0.0, LONGEST_LIFE_SECONDS))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        if os.WTERMSIG(status) != signal.SIGKILL:
            sys.exit(f"a life ended by itself with status {status}")
    print(json.dumps({"kills": kills}))


if __name__ == "__main__":
    main()
