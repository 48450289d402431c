"""A fault storm: `farm submit` and `farm resume` on the command line, under SIGKILLs at every kind of process.

Also a program: `python -m tests.farm.storm DIR [SEED [KILLS]]` prints each kill and what it found in the end.
"""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import psutil
import pyarrow.parquet
import yaml

from fractal_farm.catalogue import Catalogue, last_epoch, run_ids
from fractal_farm.catalogue.layout import crc32c, part_name
from fractal_farm.catalogue.parts import list_parts

# Kinds of processes, how many in a hundred kills they get at least, and the titles that they have.
KINDS = {
    "driver": (14, ()),
    "raylet": (9, ("raylet",)),
    "gcs_server": (9, ("gcs_server",)),
    "island": (18, ("ray::Island",)),
    "evaluation": (26, ("ray::evaluate_batch", "ray::IDLE")),
    "writer": (12, ("ray::Writer",)),
    "mesh worker": (12, ("ray::Mesher",)),
}
ALL_AT_ONCE = ("driver", "raylet", "gcs_server")
PATIENCE_S = 180.0
RESPITE_S = 60.0
CONFIG = {
    "name": "storm",
    "evolution": {
        "seed": 11,
        "islands": 4,
        "generations_per_epoch": 2,
        "offspring": 64,
        "library": {"size": 32},
        "migration": {"emigrants": 3},
        "phenotype": {"points": 2000},
        "qualified": 0.8,
    },
    "catalogue": {"keep": "accepted", "min_free_gb": 0.1},
    "solids": {"max": 400},
}


class Storm:
    """One run under fire.

    Attributes:
        killed: kills by kind of process.
        sessions: times that the command was started.
        acknowledged: commits that were there before any of the kills: (writer, number).
        ends: (exit code, last line) of sessions that ended by themselves.
    """

    def __init__(self, directory: Path, seed: int, kills: int, say=lambda line: None) -> None:
        self.directory = directory
        self.catalogue = directory / "run"
        self.random = random.Random(seed)
        self.say = say
        self.killed: Counter[str] = Counter()
        self.sessions = 0
        self.acknowledged: set[tuple[str, int]] = set()
        self.ends: list[tuple[int, str]] = []
        self.plan = [kind for kind, (share, _) in KINDS.items() for _ in range(-(-kills * share // 100))]
        self.random.shuffle(self.plan)
        self.process: subprocess.Popen | None = None
        (directory / "storm.yaml").write_text(yaml.safe_dump(CONFIG))

    def command(self, *words: str) -> list[str]:
        return [sys.executable, "-c", "import sys; from fractal_farm.cli import main; sys.exit(main())", *words]

    def start(self) -> None:
        """Submit, or resume once there is something to resume, as a person would."""
        begun = (self.catalogue / "zarr.json").exists() and run_ids(self.catalogue)
        if begun:
            words = ["resume", str(self.catalogue)]
        else:
            words = ["submit", str(self.directory / "storm.yaml"), "--out", str(self.catalogue)]
        self.sessions += 1
        output = (self.directory / f"session-{self.sessions}.txt").open("w")
        self.process = subprocess.Popen(self.command(*words), stdout=output, stderr=output, start_new_session=True)

    def rage(self) -> None:
        """Kill until the plan is done, and start again whatever has ended."""
        self.start()
        moved, progress, waiting = time.monotonic(), self._progress(), 0
        struck, committed = time.monotonic(), 0
        while self.plan:
            time.sleep(self.random.uniform(0.1, 2.0))
            if (now := self._progress()) != progress:
                moved, progress = time.monotonic(), now
            if time.monotonic() - moved > PATIENCE_S:
                raise AssertionError(f"nothing has happened for {PATIENCE_S:.0f} s: {self._last_line()}")
            if self.process.poll() is not None:
                self.ends.append((self.process.returncode, self._last_line()))
                self.say(f"ended by itself: {self.ends[-1]}")
                self.start()
                continue
            kind = self.plan[-1]
            if kind in ALL_AT_ONCE and self._parts() == committed and time.monotonic() - struck < RESPITE_S:
                # Storms have pauses: something is committed between blows that end everything.
                self.plan.insert(self.random.randrange(len(self.plan)), self.plan.pop())
                continue
            victims = self._processes(kind)
            if not victims:
                waiting += 1
                if waiting % 5 == 0:  # nobody of that kind yet: another one first
                    self.plan.insert(0, self.plan.pop())
                continue
            self._note()
            victim = self.random.choice(victims)
            try:
                victim.send_signal(signal.SIGKILL)
            except psutil.Error:
                continue
            waiting = 0
            self.killed[self.plan.pop()] += 1
            self.say(f"{sum(self.killed.values())}: {kind} {victim.pid}")
            if kind in ALL_AT_ONCE:
                struck, committed = time.monotonic(), self._parts()
            if kind == "driver":
                self.process.wait()
                self.start()
        self._note()

    def calm_down(self) -> int:
        """Ctrl-C; the number of epochs committed then."""
        deadline = time.monotonic() + PATIENCE_S
        while self.process.poll() is None and time.monotonic() < deadline:
            time.sleep(2.0)
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(60.0)
            except subprocess.TimeoutExpired:
                continue
        assert self.process.poll() is not None, "Ctrl-C did not end the run"
        self._note()
        return last_epoch(self.catalogue, run_ids(self.catalogue)[0]) + 1

    def finish(self, epochs: int) -> str:
        """Resume without any kills up to an epoch; the digest."""
        words = ["resume", str(self.catalogue), "--set", f"stop.epochs={epochs}", "--set", "solids.max=0", "--json"]
        return self._run(words)["digest"]

    def undisturbed(self, epochs: int) -> str:
        """The digest of a run that nobody touched."""
        words = ["submit", str(self.directory / "storm.yaml"), "--out", str(self.directory / "calm"), "--json"]
        return self._run([*words, "--set", f"stop.epochs={epochs}", "--set", "solids.max=0"])["digest"]

    def _run(self, words: list[str]) -> dict:
        done = subprocess.run(self.command(*words), capture_output=True, text=True, check=False, timeout=900)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    def _processes(self, kind: str) -> list[psutil.Process]:
        if kind == "driver":
            return [psutil.Process(self.process.pid)]
        found = []
        try:
            children = psutil.Process(self.process.pid).children(recursive=True)
        except psutil.Error:
            return []
        for process in children:
            try:
                title = (process.cmdline() or [""])[0]
            except psutil.Error:
                continue
            if Path(title).name.startswith(KINDS[kind][1]) or title.startswith(KINDS[kind][1]):
                found.append(process)
        return found

    def _parts(self) -> int:
        return len(list_parts(self.catalogue)) if self.catalogue.exists() else 0

    def _progress(self) -> tuple[int, int]:
        parts = self._parts()
        log = sum(path.stat().st_size for path in self.catalogue.glob("logs/*.jsonl"))
        return parts, log

    def _note(self) -> None:
        """What is committed now must be there in the end."""
        if self.catalogue.exists():
            self.acknowledged |= commits(self.catalogue)

    def _last_line(self) -> str:
        lines = (self.directory / f"session-{self.sessions}.txt").read_text().splitlines()
        return lines[-1] if lines else ""


def commits(catalogue: Path) -> set[tuple[str, int]]:
    """Writers and numbers of all commits, in whichever parts they lie."""
    return {(part.writer, seq) for part in list_parts(catalogue) for seq in range(part.seq, part.last + 1)}


def torn_files(catalogue: Path) -> list[str]:
    """Files that are not whole: partial ones, parts whose bytes are not those of their names, lines of the log."""
    torn = [str(path) for path in catalogue.rglob("*.partial")]
    for path in (catalogue / "manifest/designs").iterdir():
        name = part_name(path.name)
        if name is None or crc32c(path.read_bytes()) != name.checksum:
            torn.append(str(path))
    for log in catalogue.glob("logs/*.jsonl"):
        for line in log.read_text().splitlines():
            try:
                json.loads(line)
            except ValueError:
                torn.append(f"{log}: {line}")
    return torn


def duplicates(catalogue: Path) -> list[str]:
    """Births that were committed twice, and design ids that readers see twice."""
    births: Counter[tuple] = Counter()
    for path in sorted((catalogue / "manifest/designs").glob("*.parquet")):
        table = pyarrow.parquet.read_table(path, columns=["design_id", "island", "epoch", "generation", "slot"])
        births.update(tuple(row.values()) for row in table.to_pylist())
    seen = Counter(Catalogue.open(catalogue).designs(["design_id"]).column("design_id").to_pylist())
    return [str(key) for counter in (births, seen) for key, count in counter.items() if count > 1]


def main(directory: str, seed: str = "1", kills: str = "50") -> None:
    """Run a storm and say what was found."""
    Path(directory).mkdir(parents=True)
    began = time.monotonic()
    storm = Storm(Path(directory), int(seed), int(kills), lambda line: print(line, flush=True))
    storm.rage()
    epochs = storm.calm_down() + 2
    print(f"{sum(storm.killed.values())} kills {dict(storm.killed)}, {storm.sessions} sessions, {epochs - 2} epochs")
    digest, calm = storm.finish(epochs), storm.undisturbed(epochs)
    lost = storm.acknowledged - commits(storm.catalogue)
    print(f"lost {len(lost)}, torn {torn_files(storm.catalogue)}, twice {duplicates(storm.catalogue)}")
    print(f"digest {digest}, undisturbed {calm}, {time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    main(*sys.argv[1:])
