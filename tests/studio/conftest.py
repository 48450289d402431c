"""A small real catalogue, a studio on a copy of it, and the Chromium of the system."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fractal_farm.cli import main
from tests.cli.conftest import submit_arguments
from tests.studio.running import RunningStudio, running_studio

MORE = ("--set", "evolution.library.size=32", "--set", "evolution.offspring=64", "--set", "stop.epochs=3")


@pytest.fixture(scope="session")
def small_catalogue(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The catalogue of a run of seconds; read-only by agreement."""
    directory = tmp_path_factory.mktemp("runs") / "small"
    assert main(submit_arguments(directory, *MORE)) == 0
    return directory


@pytest.fixture(scope="module")
def studio(small_catalogue: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningStudio]:
    """`farm studio` on a copy of it, which the tests of a module share and may write to."""
    directory = tmp_path_factory.mktemp("studio") / "small"
    shutil.copytree(small_catalogue, directory)
    with running_studio(directory) as running:
        yield running


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """A playwright browser: the Chromium at $CHROMIUM, or the system's.

    Without one, tests are skipped; where CI is set they fail.
    """
    program = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        missing = "no Chromium; install it, or name its program in CHROMIUM"
        (pytest.fail if os.environ.get("CI") else pytest.skip)(missing)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield browser
        browser.close()
