"""A run that is killed again and again: `python under_fire.py CATALOGUE KILLS`.

Each life is a forked process that takes the run's lock, removes orphans, reads the committed records, and commits the
epochs that follow, one after the other, writing each to `acknowledged` when the commit returns. It is killed with
SIGKILL after a random time. The last line printed is a JSON object: kills, and orphans that the lives found.
"""

from __future__ import annotations

import json
import os
import random
import signal
import sys
import time
from pathlib import Path

import numpy as np
import zarr  # noqa: F401  (imported once, not in each life)

from fractal_farm.catalogue import RunWriter, committed_records, remove_orphans, run_lock
from fractal_farm.ifs.quantised_cloud import QuantisedClouds
from tests.catalogue.examples import RUN, designs

N_POINTS = 300
LONGEST_LIFE_SECONDS = 0.5


def epoch_content(epoch: int) -> tuple[list[int], QuantisedClouds, bytes]:
    """Numbers of the designs of an epoch (some seen before), their clouds, and the islands' records."""
    rng = np.random.default_rng(epoch)
    numbers = [epoch * 6 + i for i in range(epoch % 7)] + ([epoch * 3] if epoch % 4 == 3 else [])
    numbers = sorted(set(numbers))
    points = rng.integers(0, 65536, (len(numbers), N_POINTS, 3), dtype=np.uint16)
    transform = np.ones((len(numbers), 4), np.float32)
    return numbers, QuantisedClouds(points, transform[:, :3], transform[:, 3]), rng.bytes(4000)


def commit(writer: RunWriter, epoch: int) -> None:
    """Commit one epoch."""
    numbers, clouds, records = epoch_content(epoch)
    table, _ = designs(numbers, epoch=[epoch] * len(numbers))
    writer.commit(table, clouds, records, (epoch, epoch))


def live(root: Path, attempt: int, told: Path) -> None:
    """One life: resume, and commit until killed; what was acknowledged is written into the directory `told`."""
    with run_lock(root, RUN), (told / "lives").open("a") as lives:
        orphans = remove_orphans(root, RUN)
        following = max((epochs[1] for epochs, _ in committed_records(root, RUN)), default=-1) + 1
        lives.write(f"{orphans}\n")
        lives.flush()
        writer = RunWriter(root, RUN, "node", attempt, N_POINTS)
        acknowledged = os.open(told / "acknowledged", os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        for epoch in range(following, 100_000):
            commit(writer, epoch)
            os.write(acknowledged, f"{epoch}\n".encode())


def main() -> None:
    """Start lives and end them."""
    root, kills = Path(sys.argv[1]), int(sys.argv[2])
    (root / "logs").mkdir()
    (root / "logs" / "lives").touch()
    designs([0, 1])
    chance = random.Random(kills)
    for attempt in range(kills):
        begun = (root / "logs" / "lives").read_text().count("\n")
        child = os.fork()
        if child == 0:
            live(root, attempt, root / "logs")
        while attempt % 3 and (root / "logs" / "lives").read_text().count("\n") <= begun:
            if os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT):
                break
            time.sleep(0.01)  # two of three lives come to work, the others die at any instant
        time.sleep(chance.uniform(0.0, LONGEST_LIFE_SECONDS))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        if os.WTERMSIG(status) != signal.SIGKILL:
            sys.exit(f"life {attempt} ended by itself with status {status}")
    lives = (root / "logs" / "lives").read_text().split()
    print(json.dumps({"kills": kills, "orphans": sum(map(int, lives))}))


if __name__ == "__main__":
    main()
