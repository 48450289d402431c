"""One small real run, made once by `farm submit`, for all tests of commands that read a catalogue."""

from __future__ import annotations

from pathlib import Path

import pytest

from fractal_farm.cli import main

CONFIGS = Path(__file__).parents[2] / "configs"
SMALL = (
    "evolution.islands=2",
    "evolution.generations_per_epoch=1",
    "evolution.library.size=24",
    "evolution.offspring=24",
    "stop.epochs=2",
    "solids.max=1",
    "catalogue.durability=process",
)


def submit_arguments(out: Path, *more: str) -> list[str]:
    """Arguments of `farm submit` for a run of seconds, in this process."""
    overrides = [word for override in SMALL for word in ("--set", override)]
    return ["submit", str(CONFIGS / "quickstart.yaml"), "--out", str(out), "--executor", "serial", *overrides, *more]


@pytest.fixture(scope="session")
def run_directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The catalogue of the small run; read-only by agreement."""
    directory = tmp_path_factory.mktemp("runs") / "quickstart"
    assert main(submit_arguments(directory)) == 0
    return directory
