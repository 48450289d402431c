"""How fast the gallery is, by the browser's own clock: `python -m tests.studio.gallery_benchmark DIR [TIMES]`.

DIR is a catalogue, such as `python -m tests.catalogue.synthetic DIR 100000` writes. Prints one line of JSON:

- ready: from the request of the page to a picture in every cell that is seen, milliseconds, median and best of TIMES
- filter, sort: from the change to new cells in place, of some twenty brushes and six orders, median and greatest
- empty: the longest time for which a cell that was seen had no picture, while it was scrolled by wheel, by page, by
  far jumps of the scroll bar, and by such jumps in another order than that of the rows; seen by the page in every frame
- frame: the longest time between two frames meanwhile
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import sys
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from tests.studio.browsing import Browsed, browsed
from tests.studio.running import running_studio

WATCH = """() => {
  const watch = globalThis.watch = { empty: 0, frame: 0, cells: new Map(), last: performance.now(), frames: 0 };
  const look = () => {
    const now = performance.now();
    watch.frame = Math.max(watch.frame, now - watch.last);
    watch.last = now;
    watch.frames++;
    for (const cell of document.querySelectorAll(".cell")) {
      const key = cell.hidden || cell.dataset.drawn !== "no" ? null : cell.dataset.row;
      const before = watch.cells.get(cell);
      if (key === null) watch.cells.delete(cell);
      else if (before?.key === key) watch.empty = Math.max(watch.empty, now - before.since);
      else watch.cells.set(cell, { key, since: now });
    }
    requestAnimationFrame(look);
  };
  look();
}"""


def measure(root: Path, times: int = 3) -> dict[str, Any]:
    """The figures of a catalogue."""
    program = os.environ.get("CHROMIUM") or shutil.which("chromium")
    with running_studio(root) as studio, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        studio.facts()
        ready = []
        for _ in range(times):
            with browsed(browser, studio.address, width=1440, height=900) as page:
                page.until("performance.getEntriesByName('farm:ready').length > 0", 120)
                ready.append(page.read("performance.getEntriesByName('farm:ready')[0].startTime"))
        with browsed(browser, studio.address, width=1440, height=900) as page:
            page.ready()
            figures = {
                "designs": page.read("farm.catalogue.rows"),
                "ready_ms": _summary(ready),
                "filter_ms": _summary(_filters(page)),
                "sort_ms": _summary(_sorts(page)),
                "scroll": {way: _scrolled(page, way) for way in ("wheel", "pages", "jumps", "sorted")},
                "cells": page.read("document.querySelectorAll('.cell').length"),
            }
        browser.close()
    return figures


def _filters(page: Browsed) -> list[float]:
    page.read("(farm.clock.filter.length = 0)")
    box = page.page.locator(".score canvas").nth(1).bounding_box()
    middle = box["y"] + box["height"] / 2
    page.page.mouse.move(box["x"] + 0.2 * box["width"], middle)
    page.page.mouse.down()
    for step in range(20):
        page.page.mouse.move(box["x"] + (0.3 + 0.025 * step) * box["width"], middle)
        time.sleep(0.1)
    page.page.mouse.up()
    page.page.get_by_role("button", name="Clear all").click()
    page.ready()
    return list(page.read("farm.clock.filter"))


def _sorts(page: Browsed) -> list[float]:
    page.read("(farm.clock.sort.length = 0)")
    for column in ("d0", "gap", "lle", "d2", "similarity_dimension", "fitness"):
        page.page.get_by_label("Sort by").select_option(column)
        page.ready()
    return list(page.read("farm.clock.sort"))


def _scrolled(page: Browsed, way: str) -> dict[str, float]:
    if way == "sorted":
        page.page.get_by_label("Sort by").select_option("gap")
    page.page.locator(".grid").hover()
    if not page.read("globalThis.watch !== undefined"):
        page.page.evaluate(WATCH)
    page.read("Object.assign(watch, { empty: 0, frame: 0, last: performance.now(), frames: 0 })")
    for step in range(30):
        if way == "wheel":
            page.page.mouse.wheel(0, 240)
            time.sleep(0.05)
        elif way == "pages":
            page.page.mouse.wheel(0, 800)
            time.sleep(0.25)
        else:
            far = f"{0.03 * step} * (grid.scrollHeight - grid.clientHeight)"
            page.page.evaluate(f"() => {{ const grid = document.querySelector('.grid'); grid.scrollTop = {far}; }}")
            time.sleep(0.4)
    page.ready()
    return {name: round(page.read(f"watch.{name}"), 1) for name in ("empty", "frame", "frames")}


def _summary(values: list[float]) -> dict[str, float]:
    return {
        "median": round(statistics.median(values), 1),
        "least": round(min(values), 1),
        "most": round(max(values), 1),
        "of": len(values),
    }


if __name__ == "__main__":
    print(json.dumps(measure(Path(sys.argv[1]), *map(int, sys.argv[2:]))))
