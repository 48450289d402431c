import os
import pty
import select
import sys

import pytest

from fractal_farm.cli.stage_line import stage_line


def tell():
    with stage_line("3d1622b5") as line:
        line.stage("cover", 0.02)
        line.memory(310_000_000)
        line.stage("simplify", 0.65)


def test_nothing_is_said_to_a_pipe(capfd):
    tell()
    assert capfd.readouterr() == ("", "")


def test_a_terminal_sees_the_stages_and_the_memory(monkeypatch):
    ours, theirs = pty.openpty()
    monkeypatch.setenv("TERM", "xterm")
    with os.fdopen(theirs, "w") as terminal:
        monkeypatch.setattr(sys, "stderr", terminal)
        tell()
        seen = ""
        while select.select([ours], [], [], 0.5)[0]:
            seen += os.read(ours, 10_000).decode()
    os.close(ours)
    assert "3d1622b5: cover, 2%, at most 310.0 MB of memory" in seen
    assert "3d1622b5: simplify, 65%, at most 310.0 MB of memory" in seen


@pytest.mark.parametrize("stage", ["gap", "made"])
def test_a_line_keeps_what_it_says(stage):
    with stage_line("a") as line:
        line.stage(stage, 0.5)
    assert line.text == f"a: {stage}, 50%"
