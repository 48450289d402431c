"""Tuning in a real browser: a drag changes the picture, scores follow, undo brings the same pixels back, keep keeps."""

from __future__ import annotations

import itertools
import json
import statistics
from collections.abc import Iterator
from typing import Any

import pytest

from tests.studio.browsing import Browsed, browsed
from tests.studio.running import RunningStudio
from tests.studio.shapes import SHAPE, best, go, picture, show

pytestmark = pytest.mark.browser

SETTLED = "document.querySelector('.scores').dataset.settled"
GENE = "[data-gene='{}']"


@pytest.fixture(scope="module")
def design_id(studio: RunningStudio) -> str:
    return best(studio)["design_id"]


@pytest.fixture
def page(chromium: Any, studio: RunningStudio, design_id: str) -> Iterator[Browsed]:
    with browsed(chromium, studio.address, height=1600) as opened:
        go(opened, f"#/tune/{design_id}", ".gene")
        opened.until(SETTLED)
        yield opened


def drag(page: Browsed, selector: str, x: float, y: float = 0.0, steps: int = 12) -> None:
    """Drag an element from its middle by so many pixels, as a hand does."""
    box = page.page.locator(selector).bounding_box()
    begin = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.page.mouse.move(*begin)
    page.page.mouse.down()
    page.page.mouse.move(begin[0] + x, begin[1] + y, steps=steps)
    page.page.mouse.up()


def drag_slider(page: Browsed, gene: str, x: float) -> None:
    """Drag the thumb of a slider by so many pixels, and wait for the scores of what came of it."""
    before = int(page.read(SETTLED))
    selector = GENE.format(gene)
    page.page.locator(selector).scroll_into_view_if_needed()
    place = page.read(
        f"((one) => (one.value - one.min) / (one.max - one.min))(document.querySelector({json.dumps(selector)}))"
    )
    box = page.page.locator(selector).bounding_box()
    thumb = 16.0
    begin = (box["x"] + thumb / 2 + place * (box["width"] - thumb), box["y"] + box["height"] / 2)
    page.page.mouse.move(*begin)
    page.page.mouse.down()
    page.page.mouse.move(begin[0] + x, begin[1], steps=10)
    page.page.mouse.up()
    page.until(f"+{SETTLED} > {before}")


def draft(page: Browsed, design_id: str) -> dict[str, Any]:
    return json.loads(page.read(f"sessionStorage.getItem('draft:{design_id}')"))


def genes(studio: RunningStudio, design_id: str) -> list[list[float]]:
    return show(studio.directory, design_id)["genes"]


def test_a_drag_changes_the_shape_and_its_scores_and_undo_takes_both_back(page: Browsed) -> None:
    text = "document.querySelector('[data-score=fitness] dd').firstChild.textContent"
    shape, fitness = picture(page), page.read(text)
    drag_slider(page, "0-pitch", -30)
    tuned = picture(page)
    assert tuned != shape
    assert page.read(text) != fitness
    page.page.click("#undo")  # one drag is one entry, however many moves it had
    assert page.read("document.querySelector('#undo').disabled")
    assert picture(page) == shape
    page.until(f"{text} === {fitness!r}")
    page.page.keyboard.press("Control+Shift+z")
    assert picture(page) == tuned


def test_before_shows_the_design_as_it_was_and_after_what_it_became(page: Browsed) -> None:
    shape = picture(page)
    drag_slider(page, "0-rho", 20)
    tuned = picture(page)
    page.page.keyboard.press("b")
    assert picture(page) == shape
    page.page.keyboard.press("b")
    assert picture(page) == tuned


def test_a_number_can_be_typed(page: Browsed, design_id: str) -> None:
    page.page.fill("[data-number='1-roll']", "45")
    page.page.keyboard.press("Tab")
    page.until(f"sessionStorage.getItem('draft:{design_id}')")
    assert draft(page, design_id)["genes"][1][2] == pytest.approx(0.7853981633974483)


def test_a_handle_moves_the_offset_and_the_ring_turns_the_map(
    page: Browsed, studio: RunningStudio, design_id: str
) -> None:
    before = genes(studio, design_id)
    drag(page, "[data-knob='0']", 40, -25)
    moved = draft(page, design_id)["genes"]
    assert moved[0][:4] == before[0][:4]
    assert moved[0][4:] != before[0][4:]
    assert moved[1] == before[1]
    page.page.click("#undo")
    drag(page, "[data-turn='0'] circle >> nth=1", 25, 20)
    turned = draft(page, design_id)["genes"]
    assert turned[0][3] == before[0][3]  # a turn does not change the size
    assert turned[0][:3] != before[0][:3]
    assert turned[1] == before[1]


def test_a_handle_follows_the_mouse(page: Browsed) -> None:
    place = "document.querySelector('[data-knob=\"0\"]').getAttribute('transform')"
    where = f"{place}.match(/-?[\\d.]+/g).map(Number)"
    x, y = page.read(where)
    box = page.page.locator("[data-knob='0'] circle").bounding_box()
    page.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + box["width"] / 2 + 30, box["y"] + box["height"] / 2 + 10, steps=6)
    page.until(f"Math.abs({where}[0] - {x + 30}) < 1.5 && Math.abs({where}[1] - {y + 10}) < 1.5")
    page.page.mouse.up()


def test_the_other_maps_follow_unless_they_are_locked(page: Browsed, studio: RunningStudio, design_id: str) -> None:
    before = genes(studio, design_id)
    page.page.select_option("[aria-label='When one map is changed, the others']", "same")
    page.page.click("[aria-label='Lock Map 2 d1']")
    for gene in ("0-d1", "0-d2"):
        drag_slider(page, gene, 15)
    after = draft(page, design_id)["genes"]
    assert after[1][4] == before[1][4]
    assert after[1][5] - before[1][5] == pytest.approx(after[0][5] - before[0][5])
    assert after[0][4] != before[0][4]


def test_a_symmetry_can_be_chosen_and_taken_back(page: Browsed) -> None:
    shape = picture(page)
    page.page.select_option("[aria-label='Symmetry']", "rotation:5")
    assert picture(page) != shape
    page.page.select_option("[aria-label='Symmetry']", "none")
    assert picture(page) == shape


def test_what_is_kept_is_a_child_on_the_command_line(page: Browsed, studio: RunningStudio, design_id: str) -> None:
    drag_slider(page, "1-yaw", 12)
    kept = draft(page, design_id)
    page.page.click("#keep")
    page.until(f"location.hash.startsWith('#/design/') && !location.hash.includes('{design_id}')")
    page.until(f"document.querySelector({SHAPE!r})")
    child = page.read("location.hash").split("/")[-1]
    told = show(studio.directory, child)
    assert told["genes"] == kept["genes"]
    assert [parent["design_id"] if isinstance(parent, dict) else parent for parent in told["parents"]] == [design_id]
    assert page.read(f"sessionStorage.getItem('draft:{design_id}')") is None


def test_scores_follow_and_pictures_flow(page: Browsed, capsys: pytest.CaptureFixture[str]) -> None:
    waits = []
    for x in (6, -9, 12, -8, 5, 7):
        drag_slider(page, "0-roll", x)
        waits.append(float(page.read("document.querySelector('.scores').dataset.milliseconds")))
    page.page.click("[data-value=density]")
    page.page.evaluate(
        """() => { window.frames_ = []; const look = (now) => { frames_.push(now); requestAnimationFrame(look); };
        requestAnimationFrame(look); }"""
    )
    box = page.page.locator(GENE.format("0-roll")).bounding_box()
    page.page.mouse.move(box["x"] + 10, box["y"] + 8)
    page.page.mouse.down()
    page.page.evaluate("() => { window.frames_.length = 0; }")
    page.page.mouse.move(box["x"] + box["width"] - 10, box["y"] + 8, steps=120)
    times = page.read("window.frames_")
    live = page.read("document.querySelector('.readout').textContent")
    page.page.mouse.up()
    between = [b - a for a, b in itertools.pairwise(times)]
    with capsys.disabled():
        print(f"\nscores after letting go: median {statistics.median(waits):.0f} ms, longest {max(waits):.0f} ms")
        print(f"while dragging: {1000 / statistics.median(between):.0f} pictures/s (median); {live}")
    assert len(between) > 5
