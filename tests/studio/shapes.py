"""What tests of the pages about one design ask of a page: pixels, numbers, and the command line's word."""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path
from typing import Any

from tests.studio.browsing import Browsed
from tests.studio.running import FARM, RunningStudio

SHAPE = ".stage canvas.shape"
_STEADY_SECONDS = 0.5

_PIXELS = """(() => {
  const source = document.querySelector(%s);
  const copy = new OffscreenCanvas(source.width, source.height);
  const context = copy.getContext("2d");
  context.drawImage(source, 0, 0);
  const { data } = context.getImageData(0, 0, copy.width, copy.height);
  let drawn = 0, sum = 0;
  for (let i = 0; i < data.length; i += 4) {
    if (data[i + 3] > 40) { drawn++; sum = (sum * 31 + data[i] + 7 * data[i + 1] + 13 * data[i + 2] + i) >>> 0; }
  }
  return [drawn / (data.length / 4), sum];
})()"""


def picture(page: Browsed, selector: str = SHAPE, seconds: float = 60.0) -> tuple[float, int]:
    """Share of a canvas that is drawn on, and a checksum of its pixels, once they no longer change."""
    expression = _PIXELS % json.dumps(selector)
    end = time.monotonic() + seconds
    before, since = None, time.monotonic()
    while time.monotonic() < end:
        now = page.read(expression)
        if now != before:
            before, since = now, time.monotonic()
        elif time.monotonic() - since > _STEADY_SECONDS and now[0] > 0:
            return now[0], now[1]
        time.sleep(0.05)
    raise AssertionError(f"{selector} is blank, or never came to rest: {before}")


def go(page: Browsed, address: str, there: str) -> None:
    """Open an address of the studio (#/...) and wait for an element of it."""
    page.page.evaluate(f"() => {{ location.hash = {json.dumps(address)}; }}")
    page.until(f"document.querySelector({json.dumps(there)})")


def farm_json(*arguments: str) -> Any:
    """What a command prints with --json."""
    done = subprocess.run([*FARM, *arguments, "--json"], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def best(studio: RunningStudio) -> dict[str, Any]:
    """The fittest design, as the command line lists it."""
    return farm_json("list", str(studio.directory), "--limit", "1")[0]


def show(directory: Path, design_id: str) -> dict[str, Any]:
    """`farm show --json` of a design."""
    return farm_json("show", str(directory), design_id)
