"""A worker's process: `python -m fractal_farm.studio.worker` does one task after the other that its stdin asks for.

A frame is the length of some JSON, the length of some bytes, and both. Questions are {task, arguments}; answers
{stage, share} while a task goes on, then {done} with bytes, or {failed, input}. It ends with its stdin, in the middle
of a task too, so that no worker outlives its studio.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import queue
import struct
import sys
import threading
from pathlib import Path
from typing import IO, Any

from fractal_farm.errors import FarmError, InputError

HEAD = struct.Struct("<IQ")


def main() -> None:
    """Answer until nobody asks any more."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("500")  # where memory ends, the studio outlives its workers
    questions: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(sys.stdin.buffer, questions), daemon=True).start()
    from fractal_farm.studio.tasks import TASKS

    while True:
        question = questions.get()
        try:
            result, content = TASKS[question["task"]](
                question["arguments"], lambda stage, share: _write(answers, {"stage": stage, "share": share})
            )
            _write(answers, {"done": plain(result)}, content)
        except FarmError as error:
            _write(answers, {"failed": " ".join(str(error).split()), "input": isinstance(error, InputError)})
        except MemoryError:
            _write(answers, {"failed": "out of memory; give a lower resolution", "input": False})
        except Exception as error:
            words = " ".join(f"unexpected {type(error).__name__}: {error}".split())
            _write(answers, {"failed": words[:300], "input": False})


def plain(value: Any) -> Any:
    """A value as JSON has it; what is not finite is null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if value is None or isinstance(value, str | bool | int):
        return value
    return plain(value.tolist()) if hasattr(value, "tolist") else str(value)


def _listen(source: IO[bytes], questions: queue.SimpleQueue[dict[str, Any]]) -> None:
    while True:
        head = source.read(HEAD.size)
        if len(head) < HEAD.size:
            os._exit(0)
        length, more = HEAD.unpack(head)
        questions.put(json.loads(source.read(length)))
        source.read(more)


def _write(answers: IO[bytes], told: Any, content: bytes = b"") -> None:
    words = json.dumps(told, allow_nan=False).encode()
    answers.write(HEAD.pack(len(words), len(content)) + words)
    answers.write(content)
    answers.flush()


if __name__ == "__main__":
    main()
