"""The gallery in a real browser, on a real catalogue: what a person sees and does, and what the catalogue learns."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.studio.browsing import SHOWN, Browsed, browsed
from tests.studio.running import FARM, RunningStudio

pytestmark = pytest.mark.browser

PICTURE = f"""{SHOWN}.map((cell) => {{
  const canvas = cell.querySelector("canvas");
  const {{ data }} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let drawn = 0, sum = 0;
  for (let i = 0; i < data.length; i += 4) {{
    if (data[i + 3] > 40) {{ drawn++; sum = (sum * 31 + data[i] + 7 * data[i + 1] + 13 * data[i + 2] + i) >>> 0; }}
  }}
  return [drawn / (data.length / 4), sum];
}})"""


@pytest.fixture
def gallery(chromium: Any, studio: RunningStudio) -> Iterator[Browsed]:
    """The gallery, open, with every group unfolded: all designs are shown."""
    with browsed(chromium, f"{studio.address}#/?folded=0") as page:
        page.ready()
        yield page


def listed(directory: Path, *options: str) -> list[dict[str, Any]]:
    """What the command line says of the designs of a catalogue."""
    done = subprocess.run(
        [*FARM, "list", str(directory), "--json", *options], capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


def ids(page: Browsed) -> list[str]:
    return [page.read(f"farm.idOf({row})") for row in page.rows()]


def test_opens_with_a_picture_of_every_design(gallery: Browsed, studio: RunningStudio) -> None:
    pictures = gallery.read(PICTURE)
    assert len(pictures) >= 6
    assert min(share for share, _sum in pictures) > 0.002  # none is blank
    assert len({checksum for _share, checksum in pictures}) == len(pictures)  # all are different
    assert gallery.count() == len(listed(studio.directory, "--limit", "100000"))
    assert "token" not in gallery.page.url


def test_a_picture_shows_the_points_of_its_design(gallery: Browsed, studio: RunningStudio) -> None:
    """Drawn without JavaScript, from the same direction, the points of a design cover what its picture shows."""
    from fractal_farm.ifs.cover import attractor_cover

    row = gallery.rows()[0]
    rows = listed(studio.directory, "--limit", "1000")
    told = next(one for one in rows if one["design_id"] == gallery.read(f"farm.idOf({row})"))
    genes = np.reshape(told["genes"], (told["n_maps"], -1))
    box = np.ptp(attractor_cover(genes, 0.05), axis=0)
    drawn = gallery.page.evaluate(
        """async (row) => {
          const { evenPoints } = await import("./core/ifs.js");
          const maps = await farm.maps(row), n = maps.filter((_, i) => i % 13 === 12 && maps[i] > 0).length;
          const affine = new Float64Array(12 * n);
          for (let i = 0; i < n; i++) affine.set(maps.subarray(13 * i, 13 * i + 12), 12 * i);
          const points = evenPoints(affine, 4000);
          const box = [0, 1, 2].map((k) => {
            let low = Infinity, high = -Infinity;
            for (let i = k; i < points.length; i += 3) {
              low = Math.min(low, points[i]); high = Math.max(high, points[i]);
            }
            return high - low;
          });
          return box;
        }""",
        row,
    )
    if told.get("symmetry", "none") in (None, "none"):
        np.testing.assert_allclose(drawn, box, atol=0.1 * box.max())


@pytest.mark.parametrize(
    ("query", "where"),
    [
        ("fitness=0.9..", "fitness >= 0.9"),
        ("d0=1.2..1.6", "d0 >= 1.2 and d0 <= 1.6"),
        ("maps=2", "n_maps == 2"),
        ("maps=2,3&d2=..1.5", "d2 <= 1.5"),
        ("gap=0..0.05&lle=-1..-0.2", "gap <= 0.05 and lle <= -0.2"),
    ],
)
def test_a_filter_shows_what_the_command_line_lists(
    chromium: Any, studio: RunningStudio, query: str, where: str
) -> None:
    """Numbers of the pages are float32, so borders are drawn where no score lies."""
    expected = len(listed(studio.directory, "--where", where, "--limit", "100000"))
    with browsed(chromium, f"{studio.address}#/?folded=0&{query}") as page:
        page.until("document.querySelector('.count')?.dataset.count !== undefined")
        assert page.count() == expected


def test_a_brush_filters_and_back_undoes_it(gallery: Browsed) -> None:
    everything = gallery.count()
    box = gallery.page.locator(".score canvas").first.bounding_box()
    middle = box["y"] + box["height"] / 2
    gallery.page.mouse.move(box["x"] + 0.5 * box["width"], middle)
    gallery.page.mouse.down()
    gallery.page.mouse.move(box["x"] + 0.9 * box["width"], middle, steps=6)
    gallery.page.mouse.up()
    gallery.until("location.hash.includes('fitness=')")
    low, high = (float(end) for end in gallery.read("/fitness=([^&]*)/.exec(location.hash)[1].split('..')"))
    values = gallery.read("Array.from(farm.columns.fitness)")
    assert 0 < gallery.count() < everything
    assert gallery.count() == sum(low <= value <= high for value in values)
    assert all(low <= values[row] <= high for row in gallery.rows())
    gallery.page.go_back()
    gallery.until(f"document.querySelector('.count').dataset.count === '{everything}'")
    assert gallery.read("[...document.querySelectorAll('.score .clear')].every((button) => button.hidden)")


def test_number_fields_and_chips_filter(gallery: Browsed) -> None:
    field = gallery.page.get_by_label("D0, least")
    field.fill("1.3")
    field.press("Enter")
    values = gallery.read("Array.from(farm.columns.d0)")
    assert gallery.count() == sum(value >= 1.3 for value in values)
    gallery.page.get_by_role("button", name="Clear all").click()
    gallery.until(f"document.querySelector('.count').dataset.count !== '{sum(value >= 1.3 for value in values)}'")
    gallery.until("!location.hash.includes('d0=')")


@pytest.mark.parametrize("column", ["fitness", "d0", "d2", "lle", "gap"])
@pytest.mark.parametrize("greatest", [True, False])
def test_sorting(gallery: Browsed, column: str, greatest: bool) -> None:
    gallery.page.get_by_label("Sort by").select_option(column)
    if not greatest:
        gallery.page.get_by_label("Greatest first").click()
    shown = [gallery.read(f"farm.columns.{column}[{row}]") for row in gallery.rows()]
    every = np.array(gallery.read(f"Array.from(farm.columns.{column}, (value) => value ?? NaN)"), float)
    expected = np.sort(every[~np.isnan(every)])
    expected = expected[::-1] if greatest else expected
    assert shown == expected[: len(shown)].tolist()


def test_scrolling_to_the_end_shows_every_design(gallery: Browsed) -> None:
    seen = set(gallery.rows())
    for _ in range(1000):
        before = gallery.read("document.querySelector('.grid').scrollTop")
        gallery.page.mouse.move(800, 500)
        gallery.page.mouse.wheel(0, 500)
        time.sleep(0.05)
        seen |= set(gallery.rows())
        if gallery.read("document.querySelector('.grid').scrollTop") == before:
            break
    gallery.ready()
    assert seen == set(range(gallery.count()))
    elements = gallery.read("document.querySelectorAll('.cell').length")
    assert elements < 60
    assert gallery.read(PICTURE)


def test_a_favourite_and_stars_arrive_in_the_catalogue(gallery: Browsed, studio: RunningStudio) -> None:
    first, second, *_ = ids(gallery)
    gallery.page.locator(".cell:not([hidden]) .picture[tabindex='0']").focus()
    gallery.page.keyboard.press("f")
    gallery.page.keyboard.press("ArrowRight")
    gallery.page.keyboard.press("4")
    gallery.until("document.querySelectorAll('.cell .heart.on').length === 1")
    _eventually(lambda: {one["design_id"] for one in listed(studio.directory, "--where", "favourite")} == {first})
    _eventually(lambda: {one["design_id"] for one in listed(studio.directory, "--where", "stars >= 4")} == {second})
    gallery.page.get_by_role("button", name="♥ Favourites").click()
    assert ids(gallery) == [first]
    gallery.page.get_by_label("Take from favourites").click()
    _eventually(lambda: listed(studio.directory, "--where", "favourite") == [])


def test_stars_by_click_and_designs_chosen_to_breed(gallery: Browsed, studio: RunningStudio) -> None:
    design = ids(gallery)[4]
    cell = gallery.page.locator(f".cell:not([hidden]):has(a[href='#/design/{design}'])")
    cell.hover()
    cell.locator(".stars .star").nth(2).click()
    _eventually(lambda: {one["design_id"] for one in listed(studio.directory, "--where", "stars == 3")} == {design})
    cell.locator(".pick").click()
    other = ids(gallery)[5]
    gallery.page.locator(f"a[href='#/design/{other}']").click(modifiers=["Shift"])
    assert gallery.page.get_by_role("link", name="Breed").get_attribute("href") == f"#/breed?ids={design},{other}"
    assert gallery.page.get_by_role("link", name="Blend").get_attribute("href") == f"#/morph/{design}/{other}"


def test_search_by_code_and_by_id(gallery: Browsed, studio: RunningStudio) -> None:
    from fractal_farm.ifs.design_code import design_code

    wanted = listed(studio.directory, "--limit", "5")[3]["design_id"]
    for text in (design_code(wanted), design_code(wanted)[:9].lower(), wanted[:12], wanted):
        gallery.page.get_by_label("Search by design code or id").fill(text)
        gallery.until("document.querySelector('.count').dataset.count === '1'")
        assert ids(gallery) == [wanted]
    gallery.page.get_by_label("Search by design code or id").fill("no such code")
    gallery.until("document.querySelector('.count').dataset.count === '0'")
    assert gallery.page.get_by_text("No design is like that").is_visible()


def test_codes_are_those_of_the_command_line(gallery: Browsed) -> None:
    from fractal_farm.ifs.design_code import design_code

    for row in gallery.rows():
        assert gallery.read(f"farm.codeOf({row})") == design_code(gallery.read(f"farm.idOf({row})"))


def test_keyboard_only(chromium: Any, studio: RunningStudio) -> None:
    with browsed(chromium, f"{studio.address}#/?folded=0") as page:
        page.ready()
        for _ in range(80):
            page.page.keyboard.press("Tab")
            if page.read("document.activeElement.classList.contains('picture')"):
                break
        assert page.read("document.activeElement.ariaLabel.startsWith('Design FF-')")
        page.page.keyboard.press("End")
        page.until(f"+document.activeElement.parentElement.ariaPosInSet === {page.count()}")
        page.page.keyboard.press("Home")
        page.until("+document.activeElement.parentElement.ariaPosInSet === 1")
        page.page.keyboard.press("ArrowDown")
        page.page.keyboard.press("PageDown")
        design = page.read("document.activeElement.getAttribute('href')")
        page.page.keyboard.press("Enter")
        page.until(f"location.hash === {json.dumps(design)}")
        page.page.go_back()
        page.ready()
        assert page.read(f"document.querySelector('.cell:not([hidden]) a[href={json.dumps(design)}]') !== null")


def test_groups_fold_behind_their_representatives(chromium: Any, studio: RunningStudio) -> None:
    with browsed(chromium, studio.address) as page:
        page.ready()
        representative = np.array(page.read("Array.from(farm.columns.representative)"))
        assert page.count() == (representative == np.arange(len(representative))).sum()
        sizes = np.array(page.read("Array.from(farm.columns.group_size)"))
        assert (sizes == np.bincount(representative, minlength=len(representative))[representative]).all()
        if (sizes > 1).any():
            row = int(representative[np.argmax(sizes)])
            page.page.goto(f"{studio.url}#/?folded=0&like={row}")
            page.until(f"document.querySelector('.count')?.dataset.count === '{sizes.max()}'")


@pytest.mark.parametrize("theme", ["dark", "light"])
@pytest.mark.parametrize("width", [360, 1440])
def test_dark_light_and_narrow(chromium: Any, studio: RunningStudio, theme: str, width: int) -> None:
    brightness = (
        "(getComputedStyle(document.body).backgroundColor.match(/\\d+/g).slice(0, 3).reduce((a, b) => a + +b, 0) / 765)"
    )
    with browsed(chromium, studio.address, theme=theme, width=width) as page:
        page.ready()
        assert (page.read(brightness) > 0.8) == (theme == "light")
        assert page.read("document.documentElement.scrollWidth <= innerWidth")
        page.page.get_by_label("Light pages").click()
        assert (page.read(brightness) > 0.8) == (theme == "dark")
        page.page.reload()
        page.ready()
        assert (page.read(brightness) > 0.8) == (theme == "dark")  # it is remembered


def test_saved_views(gallery: Browsed, studio: RunningStudio) -> None:
    gallery.page.goto(f"{studio.url}#/?folded=0&maps=2&sort=-d0")
    gallery.until("document.querySelector('.count').dataset.count")
    count = gallery.count()
    gallery.page.get_by_role("button", name="Save view").click()
    gallery.page.get_by_label("Name of the view").fill("flat ones")
    gallery.page.keyboard.press("Enter")
    gallery.until("[...document.querySelectorAll('.views option')].some((one) => one.textContent === 'flat ones')")
    gallery.page.get_by_role("button", name="Clear all").click()
    gallery.until("location.hash === '#/'")
    gallery.page.get_by_label("Saved views").select_option("flat ones")
    gallery.until("location.hash.includes('maps=2')")
    gallery.until(f"document.querySelector('.count').dataset.count === '{count}'")


def _eventually(holds: Any, seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.2)


def test_what_is_kept_meanwhile_is_offered(gallery: Browsed, studio: RunningStudio, tmp_path: Path) -> None:
    """A design that the command line adds while the page is open."""
    before = gallery.count()
    genomes = tmp_path / "new.yaml"
    genomes.write_text("genomes:\n  new: [[0.3, 0.1, 1.2, 0.71, 1, 0, 0], [0.2, 2, 0.4, 0.61, 0, 1, 0.2]]\n")
    subprocess.run([*FARM, "keep", str(studio.directory), str(genomes)], capture_output=True, check=True)
    button = gallery.page.get_by_role("button", name="1 new design: show")
    button.wait_for(timeout=30_000)
    assert gallery.count() == before
    button.click()
    assert gallery.count() == before + 1
    gallery.page.get_by_role("button", name="By hand").click()
    assert gallery.count() == 1
    gallery.ready()
    assert gallery.read(PICTURE)[0][0] > 0.002
