"""Who may write to a run: tested with processes, since a lock within one process proves little."""

import multiprocessing
import os
import signal
import time

import pytest

from fractal_farm.catalogue import fence
from fractal_farm.catalogue.fence import take_over, writing
from fractal_farm.errors import FarmError

RUN = "abcd"


def _write_slowly(root, token, begun, seconds):
    with writing(root, RUN, token):
        begun.set()
        time.sleep(seconds)
        (root / "written").write_text("by the old writer")


def _old_writer(root, seconds):
    context = multiprocessing.get_context("spawn")
    begun = context.Event()
    process = context.Process(target=_write_slowly, args=(root, take_over(root, RUN), begun, seconds))
    process.start()
    assert begun.wait(60)
    return process


def test_a_writer_of_an_earlier_session_may_not_write(tmp_path):
    old = take_over(tmp_path, RUN)
    new = take_over(tmp_path, RUN)
    with pytest.raises(FarmError, match="another session"), writing(tmp_path, RUN, old):
        pytest.fail("it wrote")
    with writing(tmp_path, RUN, new):
        pass


def test_taking_over_waits_for_a_write_under_way(tmp_path):
    process = _old_writer(tmp_path, 1.0)
    take_over(tmp_path, RUN)
    assert (tmp_path / "written").exists()
    process.join()


def test_a_dead_writer_holds_nobody_up(tmp_path):
    process = _old_writer(tmp_path, 600.0)
    process.kill()
    process.join()
    take_over(tmp_path, RUN)
    assert not (tmp_path / "written").exists()


def test_a_writer_that_stands_still_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(fence, "_PATIENCE_SECONDS", 0.2)
    process = _old_writer(tmp_path, 600.0)
    os.kill(process.pid, signal.SIGSTOP)
    try:
        with pytest.raises(FarmError, match="does not finish"):
            take_over(tmp_path, RUN)
    finally:
        process.kill()
        process.join()
