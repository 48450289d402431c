"""The mutation grid, sweeps and morphs in a real browser."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from tests.studio.browsing import Browsed, browsed
from tests.studio.running import RunningStudio
from tests.studio.shapes import best, farm_json, go, picture, show

pytestmark = pytest.mark.browser

COUNT = 16
GROW_SECONDS = 240.0
DRAWN = "[...document.querySelectorAll('.child canvas')].filter((one) => one.dataset.drawn).length"
SUMS = """[...document.querySelectorAll('.child canvas')].map((canvas) => {
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let sum = 0, drawn = 0;
  for (let i = 0; i < data.length; i += 4) {
    if (data[i + 3] > 40) { drawn++; sum = (sum * 31 + data[i] + 7 * data[i + 1] + 13 * data[i + 2] + i) >>> 0; }
  }
  return [drawn, sum];
})"""


@pytest.fixture(scope="module")
def design_id(studio: RunningStudio) -> str:
    return best(studio)["design_id"]


@pytest.fixture
def page(chromium: Any, studio: RunningStudio, design_id: str) -> Iterator[Browsed]:
    with browsed(chromium, studio.address, width=1400, height=1000) as opened:
        go(opened, f"#/breed?ids={design_id}", ".child")
        yield opened


def children(page: Browsed) -> list[int]:
    """Checksums of the pictures of all children, once they are drawn."""
    page.until(f"{DRAWN} === {COUNT}", 60)
    assert page.read("Math.min(...[...document.querySelectorAll('.child')].map((one) => one.clientHeight))") > 100
    pictures = page.read(SUMS)
    assert all(drawn > 20 for drawn, _sum in pictures)
    return [checksum for _drawn, checksum in pictures]


def test_sixteen_children_differ_and_the_next_generation_is_another(page: Browsed) -> None:
    first = children(page)
    assert len(set(first)) == COUNT
    page.page.click("[data-child='2'] .select-child")
    page.page.click("[data-child='7'] .select-child")
    page.page.click("#breed-next")
    page.until("document.querySelectorAll('.child[data-chosen=true]').length === 0")
    second = children(page)
    assert len(set(second)) == COUNT
    assert not set(first) & set(second)
    page.page.click("#back")
    assert children(page) == first  # with the same two chosen
    assert page.read("document.querySelectorAll('.child[data-chosen=true]').length") == 2


def test_a_kept_child_is_in_the_catalogue(page: Browsed, studio: RunningStudio, design_id: str) -> None:
    children(page)
    page.page.click("[aria-label='Keep child 4']")
    child = page.until("document.querySelector('[data-child=\"3\"] a')?.getAttribute('href')").split("/")[-1]
    told = show(studio.directory, child)
    assert told["operator"] == "hand"
    assert [parent["design_id"] if isinstance(parent, dict) else parent for parent in told["parents"]] == [design_id]


def test_a_child_can_be_tuned(page: Browsed, design_id: str) -> None:
    children(page)
    page.page.click("[aria-label='Tune child 1']")
    page.until("document.querySelector('.gene')")
    assert not page.read("document.querySelector('#undo').disabled")  # the design as it was is one undo away
    assert json.loads(page.read(f"sessionStorage.getItem('draft:{design_id}')"))["genes"]


def test_locks_hold_and_the_same_seed_gives_the_same_children(page: Browsed) -> None:
    told = page.page.evaluate(
        """async () => {
          const { childrenOf } = await import(new URL("breed/mutate.js", document.baseURI).href);
          const parent = { genes: [[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7], [1.1, 1.2, 1.3, 0.8, 1.5, 1.6, 1.7]] };
          const ask = (locks, maps, strength = 0.3) =>
            childrenOf([parent], { seed: 5, strength, locks: new Set(locks), maps: new Set(maps) })
              .map((one) => one.genome.genes);
          const [free, again] = [ask([], []), ask([], [])];
          return { parent: parent.genes, free, again, locked: ask([3], [1]), wild: ask([], [], 5) };
        }"""
    )
    assert told["free"] == told["again"]
    assert any(child[1] != told["parent"][1] for child in told["free"])
    for child, free in zip(told["locked"], told["free"], strict=True):
        assert child[1] == told["parent"][1]
        assert child[0][3] == told["parent"][0][3]
        assert child[0][4:] == free[0][4:]  # a lock changes nothing else
    for child in told["wild"]:
        assert all(abs(angle) <= 3.1415927 for row in child for angle in row[:3])
        assert all(0 < row[3] < 1 for row in child)


def test_a_run_grows_from_the_chosen(page: Browsed, studio: RunningStudio) -> None:
    before = len(farm_json("list", str(studio.directory), "--limit", "100000"))
    children(page)
    page.page.click("[data-child='0'] .select-child")
    page.page.click("#grow")
    page.until("document.querySelector('[data-grown]')", GROW_SECONDS)
    ended, said = page.read(
        "(({ dataset, textContent }) => [dataset.grown, textContent])(document.querySelector('[data-grown]'))"
    )
    assert ended == "done", said
    assert page.read("document.querySelector('.made code').textContent").startswith("farm breed")
    assert len(farm_json("list", str(studio.directory), "--limit", "100000")) > before + 1


def test_a_sweep_is_rows_of_pictures_and_a_png(page: Browsed, design_id: str, tmp_path: Path) -> None:
    go(page, f"#/sweep/{design_id}", ".tiles canvas")
    page.page.click("[data-value='6']")
    page.until("document.querySelectorAll('.tiles canvas[data-drawn]').length === 63", 60)
    with page.page.expect_download() as coming:
        page.page.click("#save-png")
    path = tmp_path / coming.value.suggested_filename
    coming.value.save_as(path)
    sheet = Image.open(path)
    assert sheet.width > 9 * 300
    assert sheet.height > 7 * 300
    row = [sheet.crop((120 + k * 308, 8, 420 + k * 308, 308)).tobytes() for k in range(9)]
    assert len(set(row)) == 9


def test_a_morph_begins_with_one_design_and_ends_with_the_other(
    page: Browsed, studio: RunningStudio, design_id: str
) -> None:
    same = show(studio.directory, design_id)["n_maps"]
    listed = farm_json("list", str(studio.directory), "--limit", "200")
    other = next(one["design_id"] for one in listed if one["n_maps"] == same and one["design_id"] != design_id)
    go(page, f"#/morph/{design_id}/{other}", "#morph")
    slide = """(value) => { const one = document.querySelector('#morph'); one.value = value;
      one.dispatchEvent(new Event('input')); one.dispatchEvent(new Event('change')); }"""
    seen = []
    for share in (0.0, 0.5, 1.0):
        page.page.evaluate(slide, share)
        seen.append(picture(page))
    assert len({checksum for _share, checksum in seen}) == 3
    ends = page.page.evaluate(
        """async ([first, second]) => {
          const at = (name) => import(new URL(name, document.baseURI).href);
          const [{ morphOf }, { resolve }] = [await at("sweep/steps.js"), await at("core/ifs.js")];
          const of = async (id) => (await farm.api.get(`design/${id}`)).genome;
          const [a, b] = [await of(first), await of(second)];
          const rows = (genome) => {
            const { maps } = resolve(genome);
            return genome.genes.map((_, i) => [...maps.slice(12 * i, 12 * i + 12)]);
          };
          return { from: rows(a), begin: rows(morphOf(a, b)(0)), to: rows(b), end: rows(morphOf(a, b)(1)) };
        }""",
        [design_id, other],
    )
    assert ends["begin"] == ends["from"]
    for matrix in ends["to"]:  # in the order of the first's maps
        assert min(max(abs(p - q) for p, q in zip(matrix, one, strict=True)) for one in ends["end"]) < 1e-9
