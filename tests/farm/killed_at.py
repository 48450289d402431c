"""A run that is killed before each change that it makes to the disk: `python -m tests.farm.killed_at DIR FIRST LAST`.

Each life is a forked process that submits a small run in a directory of its own and ends itself with SIGKILL before
the n-th file or directory is opened for writing, made, renamed or removed. Then a person gives the same command
again, or `farm resume`. A line of JSON for each life: what was about to happen, whether the catalogue was sound then,
what `farm resume` said, and the digest in the end. It ends when a life is long enough to end by itself.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path

from fractal_farm import farm
from fractal_farm.catalogue import run_ids
from fractal_farm.catalogue.verify import verify
from fractal_farm.errors import InputError
from tests.farm.runs import small_config

CONFIG = small_config("stop.epochs=1", "evolution.islands=2", "catalogue.durability=process")
CHANGES = ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.truncate")


def kill_before(change: int, root: Path) -> None:
    """Die before the n-th change below a directory, and say on stdout which one it was."""
    seen = 0

    def hear(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal seen
        if event == "open":
            path, _, flags = arguments
            changing = isinstance(flags, int) and bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
        else:
            path, changing = arguments[0] if arguments else None, event in CHANGES
        if changing and isinstance(path, str | bytes | Path) and os.fsdecode(path).startswith(str(root)):
            seen += 1
            if seen == change:
                os.write(1, json.dumps({"at": change, "before": f"{event} {os.fsdecode(path)}"}).encode() + b"\n")
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hear)


def again(root: Path) -> dict[str, object]:
    """What a person finds and does where the directory is as the dead process left it."""
    sound = not root.exists() or not run_ids(root) or verify(root, "quick").exit_code == 0
    try:
        farm.resume(root)
    except InputError as error:
        summary = farm.submit(CONFIG, root, executor="serial")
        return {"resume": str(error), "sound": sound, "digest": summary.ended.digest}
    return {"resume": "went on", "sound": sound, "digest": farm.status(root)["digest"]}


def main(directory: str, first: str, last: str) -> None:
    """Live and die."""
    farm.submit(CONFIG, Path(directory) / "undisturbed", executor="serial")  # kernels are compiled once
    for change in range(int(first), int(last) + 1):
        root = Path(directory).resolve() / f"run-{change}"
        child = os.fork()
        if child == 0:
            kill_before(change, root)
            farm.submit(CONFIG, root, executor="serial")
            os._exit(0)
        _, status = os.waitpid(child, 0)
        if not os.WIFSIGNALED(status):
            break
        print(json.dumps({"at": change, **again(root)}), flush=True)
    print(json.dumps({"digest": farm.status(Path(directory) / "undisturbed")["digest"]}), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
