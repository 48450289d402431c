"""The progress display: what it says of a run, from the run's events alone."""

from __future__ import annotations

import pytest

from fractal_farm.cli.output import byte_count, duration
from fractal_farm.cli.progress import RunView, progress_display
from fractal_farm.farm.events import (
    Draining,
    EpochCompleted,
    Fault,
    MeshFinished,
    PartCommitted,
    Progress,
    RunEnded,
    RunStarted,
)


def started(**stop: float | None) -> RunStarted:
    return RunStarted("0123456789abcdef", "test", "runs/test", "ray", 2, 4, Progress(), 0, 0, 0, dict(stop))


def epoch(number: int, elapsed_s: float) -> EpochCompleted:
    progress = Progress(
        epochs=number, evaluated=1000 * number, designs=40 * number, kept_qualified=10 * number, distinct=10 * number
    )
    return EpochCompleted(number - 1, progress, elapsed_s, 1234.5)


def test_time_left_follows_the_pace_of_this_session() -> None:
    view = RunView()
    view.take(started(epochs=10, hours=None), 0.0)
    assert view.left_s(1.0) is None
    view.take(epoch(1, 20.0), 20.0)
    assert view.left_s(20.0) is None
    view.take(epoch(3, 30.0), 30.0)
    assert view.left_s(30.0) == pytest.approx(35.0)


def test_the_nearest_limit_counts() -> None:
    view = RunView()
    view.take(started(epochs=100, evaluations=4000, hours=1.0), 0.0)
    view.take(epoch(2, 36.0), 36.0)
    assert view.fraction(36.0) == pytest.approx(0.5)
    assert view.fraction(36.0 + 3240.0) == pytest.approx(0.91)


def test_a_run_without_a_limit_has_no_time_left() -> None:
    view = RunView()
    view.take(started(epochs=None), 0.0)
    view.take(epoch(1, 1.0), 1.0)
    view.take(epoch(2, 2.0), 2.0)
    assert view.fraction(2.0) is None
    assert "left" not in view.line(2.0)


def test_the_line_has_rate_qualified_meshes_and_disk() -> None:
    view = RunView()
    view.take(started(epochs=10), 0.0)
    view.take(epoch(1, 1.0), 1.0)
    view.take(epoch(2, 2.0), 2.0)
    view.take(PartCommitted(0, 1, 80, 5, 4_200_000, 31, 4_200_000, 80, 2, 2.0), 2.0)
    view.take(MeshFinished("ab" * 16, 0.5, 3, 12), 2.0)
    line = view.line(62.0)
    for part in ("epoch 2", "2,000 evaluated (1,234/s)", "80 designs", "20 distinct", "3 of 12 meshes",
                 "4.2 MB in 31 files", "1:02", "left"):  # fmt: skip
        assert part in line, line


def test_at_the_limit_the_rest_is_meshing() -> None:
    view = RunView()
    view.take(started(epochs=2), 0.0)
    view.take(epoch(1, 1.0), 1.0)
    view.take(epoch(2, 2.0), 2.0)
    assert view.line(5.0).endswith(", meshing")


def test_what_needs_attention_gets_a_line_of_its_own() -> None:
    view = RunView()
    assert view.take(epoch(1, 1.0), 1.0) is None
    assert view.take(MeshFinished("ab" * 16, 0.5, 3, 12), 1.0) is None
    assert "no mesh of abab" in str(view.take(MeshFinished("ab" * 16, 0.5, 3, 12, "gap too wide"), 1.0))
    assert view.take(Fault("island 3", "worker died", "epoch 5 starts again"), 1.0) == (
        "island 3: worker died; epoch 5 starts again"
    )
    assert "ending: interrupted" in str(view.take(Draining("interrupted"), 1.0))


def test_plain_lines_go_to_stderr_and_are_few(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_display() as display:
        display.on_event(started(epochs=1000))
        for number in range(1, 1001):
            display.on_event(epoch(number, 0.001 * number))
        display.on_event(RunEnded("1000 epochs", False, Progress(epochs=1000), 1.0, "0" * 32, 0, 0))
    out, err = capsys.readouterr()
    assert out == ""
    lines = err.splitlines()
    assert lines[0].startswith("run test (0123456789abcdef): 4 islands on 2 workers (ray)")
    assert "epoch 1000" in lines[-1]
    assert 3 <= len(lines) <= 4


def test_a_terminal_shows_a_bar_and_the_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    with progress_display() as display:
        display.on_event(started(epochs=4))
        display.on_event(epoch(1, 1.0))
        display.on_event(Fault("island 3", "worker died", "epoch 5 starts again"))
    out, err = capsys.readouterr()
    assert out == ""
    for part in ("\N{BOX DRAWINGS HEAVY HORIZONTAL}", "epoch 1, 1,000 evaluated", "island 3: worker died"):
        assert part in err


@pytest.mark.parametrize(("seconds", "text"), [(0, "0:00"), (59.6, "1:00"), (125, "2:05"), (3723, "1:02:03")])
def test_durations_read_as_clocks(seconds: float, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.parametrize(("number", "text"), [(0, "0 B"), (999, "999 B"), (4_200_000, "4.2 MB"), (2.34e14, "234.0 TB")])
def test_bytes_have_a_fitting_unit(number: float, text: str) -> None:
    assert byte_count(number) == text
