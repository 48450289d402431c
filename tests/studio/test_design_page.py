"""The page of one design in a real browser: what it shows is the design, and what it makes can be taken home."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import trimesh

from tests.studio.browsing import Browsed, browsed
from tests.studio.running import RunningStudio
from tests.studio.shapes import SHAPE, best, go, picture, show

pytestmark = pytest.mark.browser

SOLID_SECONDS = 300.0
READ_BACK = "GPU stall due to ReadPixels"  # a driver's remark on this test reading the metal view


@pytest.fixture(scope="module")
def design_id(studio: RunningStudio) -> str:
    return best(studio)["design_id"]


@pytest.fixture
def page(chromium: Any, studio: RunningStudio, design_id: str) -> Iterator[Browsed]:
    with browsed(chromium, studio.address, allowed=READ_BACK) as opened:
        go(opened, f"#/design/{design_id}", SHAPE)
        yield opened


def test_its_shape_is_drawn_and_its_scores_are_those_of_the_command_line(
    page: Browsed, studio: RunningStudio, design_id: str
) -> None:
    share, _checksum = picture(page)
    assert share > 0.005
    told = show(studio.directory, design_id)
    shown = page.read("document.querySelector('[data-score=fitness] dd').textContent")
    assert float(shown) == pytest.approx(told["fitness"], abs=6e-4)
    assert page.read("document.querySelector('h1').textContent").startswith("FF-")


def test_the_density_view_and_the_view_as_it_prints_differ(page: Browsed) -> None:
    even = picture(page)
    page.page.click("[data-value=density]")
    density = picture(page)
    page.page.click("[data-value=even]")
    assert density != even
    assert picture(page) == even


def test_keys_turn_it_and_zero_turns_it_back(page: Browsed) -> None:
    before = picture(page)
    page.page.focus(SHAPE)
    page.page.keyboard.press("ArrowRight")
    assert picture(page) != before
    page.page.keyboard.press("0")
    assert picture(page) == before


def test_each_colouring_gives_other_pixels(page: Browsed) -> None:
    seen = set()
    for name in ("gradient", "amber", "silver", "sapphire"):
        page.page.click(f".swatches [data-value={name}]")
        seen.add(picture(page)[1])
    assert len(seen) == 4


def test_a_favourite_with_stars_is_one_on_the_command_line(
    page: Browsed, studio: RunningStudio, design_id: str
) -> None:
    page.page.click(".liking")
    page.page.click(".rating-star >> nth=3")
    page.until("document.querySelectorAll('.rating-star[aria-pressed=true]').length === 4")
    page.until(f"farm.columns.rating[farm.rowOf('{design_id}')] === 4")
    page.page.wait_for_timeout(500)
    judgement = show(studio.directory, design_id)
    assert (judgement["favourite"], judgement["stars"]) == (True, 4)


def test_its_relatives_are_links_with_pictures(page: Browsed) -> None:
    page.until("document.querySelectorAll('.strip li').length > 1")
    page.until("document.querySelector('.strip a[href^=\"#/design/\"] canvas')")
    target = page.read("document.querySelector('.strip a[href^=\"#/design/\"]').getAttribute('href')")
    page.page.evaluate("() => document.querySelector('.strip a[href^=\"#/design/\"]').click()")
    page.until(f"location.hash === {target!r} && document.querySelector({SHAPE!r})")
    assert picture(page)[0] > 0


def test_a_solid_made_on_the_page_is_watertight_and_shines_in_gold(page: Browsed, tmp_path: Path) -> None:
    page.page.select_option("#preset", "pendant-silver")
    page.page.click("#make-solid")
    page.until("document.querySelector('.progress').hidden === false")
    page.until("document.querySelector('.download[data-format=glb]')", SOLID_SECONDS)
    assert page.read("Boolean(document.querySelector('.certificate .verdict'))")
    assert page.read("document.querySelector('.certified').textContent").count("mm") >= 2
    assert "[object" not in page.read("document.querySelector('.panels').textContent")
    formats = page.read("[...document.querySelectorAll('.download')].map((one) => one.dataset.format)")
    assert set(formats) >= {"glb", "3mf", "stl"}
    with page.page.expect_download() as coming:
        page.page.click(".download[data-format=glb]")
    path = tmp_path / coming.value.suggested_filename
    coming.value.save_as(path)
    mesh = trimesh.load(path, force="mesh")
    mesh.merge_vertices()
    assert mesh.is_watertight
    assert mesh.volume > 0
    page.until("document.querySelector('canvas.metal')")
    silver = picture(page, "canvas.metal")
    assert silver[0] > 0.005
    page.page.click(".metals [data-value=gold]")
    assert picture(page, "canvas.metal") != silver


def test_cancelling_ends_a_solid_even_before_the_studio_has_answered(
    chromium: Any, studio: RunningStudio, design_id: str
) -> None:
    held: list[Any] = []
    with browsed(chromium, studio.address) as page:
        go(page, f"#/design/{design_id}", "#preset option")
        page.page.route("**/api/solid", lambda route: held.append(route))
        page.page.select_option("#preset", "desk-nylon")
        with page.page.expect_request("**/api/solid"):
            page.page.click("#make-solid")
        page.page.click(".progress button")
        with page.page.expect_request("**/api/jobs/*/cancel"):
            held[0].continue_()
        page.until("document.querySelector('.progress').hidden === true")
        assert page.read("document.querySelector('.made').textContent") == "cancelled"
        assert page.read("document.querySelector('.download')") is None
        assert not page.read("document.querySelector('#make-solid').disabled")


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_nothing_is_wider_than_a_telephone(chromium: Any, studio: RunningStudio, design_id: str, theme: str) -> None:
    with browsed(chromium, studio.address, width=390, height=844, theme=theme) as page:
        for address, there in (
            (f"#/design/{design_id}", SHAPE),
            (f"#/tune/{design_id}", ".gene"),
            (f"#/breed?ids={design_id}", ".child canvas"),
            (f"#/sweep/{design_id}", ".tiles canvas"),
        ):
            go(page, address, there)
            assert page.read("document.querySelector('.design-page').scrollWidth") <= 390, address


def test_every_control_has_a_name(page: Browsed, design_id: str) -> None:
    unnamed = """[...document.querySelectorAll('.design-page :is(button, input, select, a, [role=button])')].filter(
      (one) => !(one.getAttribute('aria-label') || one.textContent.trim() || one.labels?.length))
      .map((one) => one.outerHTML)"""
    for address, there in ((f"#/tune/{design_id}", ".gene"), (f"#/breed?ids={design_id}", ".child")):
        assert page.read(unnamed) == []
        go(page, address, there)
    assert page.read(unnamed) == []
