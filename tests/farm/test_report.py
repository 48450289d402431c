"""The report of a run: one page that needs nothing else, and whose curves are the run's own numbers."""

import html
import json
import re
import shutil
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import numpy as np
import pytest

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue
from fractal_farm.farm.report import report_page
from fractal_farm.farm.report.charts import Series, line_chart, ticks
from fractal_farm.farm.run_status import time_left
from tests.farm.runs import small_config


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "run"
    return path, farm.submit(small_config(), path, executor="serial")


class Page(HTMLParser):
    """Collects the tags of a page, and checks that they close."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.open = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def titles(page, title):
    """What the chart below a heading shows to somebody who points at it: a dictionary for each place."""
    section = page[page.index(f"<h2>{title}</h2>") :]
    chart = section[section.index("<svg") : section.index("</svg>")]
    shown = [html.unescape(text).splitlines() for text in re.findall(r"<title>(.*?)</title>", chart, re.DOTALL)]
    return [dict(line.rsplit(": ", 1) for line in lines[1:]) | {"at": lines[0]} for lines in shown]


def test_a_run_ends_with_a_report_that_needs_nothing_else(run):
    path, summary = run
    page = (path / "report.html").read_text()
    parsed = Page(page)
    assert parsed.open == []
    assert not {"script", "link", "iframe", "object"} & {tag for tag, _ in parsed.tags}
    sources = [attributes["src"] for _, attributes in parsed.tags if "src" in attributes]
    assert sources
    assert all(source.startswith("data:") for source in sources)
    assert not re.search(r"https?://|@import|url\(", page)
    assert summary.ended.digest in page
    assert f"{summary.ended.progress.evaluated:,}" in page


def test_every_chart_is_sound_and_says_what_it_shows(run):
    charts = re.findall(r"<svg.*?</svg>", report_page(run[0]), re.DOTALL)
    assert len(charts) == 5
    for chart in charts:
        root = ET.fromstring(chart)
        _, _, width, height = map(float, root.get("viewBox").split())
        for line in root.iter("polyline"):
            points = np.array([pair.split(",") for pair in line.get("points").split()], float)
            assert len(points) >= 1
            assert (points >= 0).all()
            assert (points <= (width, height)).all()
        assert all(0 <= float(text.get("x")) <= width for text in root.iter("text"))


def test_the_fitness_curves_are_those_of_the_designs_that_joined(run):
    path, _ = run
    rows = Catalogue.open(path).designs(["generation", "fitness"], ancestors=True)
    generation, fitness = rows.column("generation").to_numpy(), rows.column("fitness").to_numpy()
    shown = {int(entry["at"].split()[-1]): entry for entry in titles(report_page(path), "Fitness by generation")}
    assert set(np.unique(generation)) <= set(shown)
    for number in np.unique(generation):
        here = fitness[generation == number]
        assert float(shown[number]["best"]) == pytest.approx(here.max(), abs=1e-4)
        assert float(shown[number]["worst"]) == pytest.approx(here.min(), abs=1e-4)


def test_the_shares_of_map_counts_add_up(run):
    for entry in titles(report_page(run[0]), "Maps of the designs"):
        shares = [float(share.removesuffix(" %")) for name, share in entry.items() if name.startswith("N = ")]
        assert sum(shares) == pytest.approx(100, abs=0.2)


def test_what_others_wrote_cannot_become_markup(run, tmp_path):
    path = tmp_path / "run"
    shutil.copytree(run[0], path)
    (log,) = (path / "logs").glob("*.jsonl")
    fault = {"at": 1.0, "event": "Fault", "where": "writer", "cause": "<script>alert(1)</script>", "remedy": "&"}
    with log.open("a") as file:
        file.write(json.dumps(fault) + "\n")
    page = report_page(path)
    assert "<script>" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page


def test_a_damaged_part_is_named_and_the_rest_is_shown(run, tmp_path):
    path = tmp_path / "run"
    shutil.copytree(run[0], path)
    part = max((path / "manifest" / "designs").glob("*.parquet"))
    part.write_bytes(part.read_bytes()[:-3])
    page = report_page(path)
    assert part.name in page
    assert Page(page).open == []


def test_a_chart_puts_values_where_its_axes_say():
    x, y = np.array([0.0, 5.0, 10.0]), np.array([0.0, 50.0, 100.0])
    root = ET.fromstring(line_chart([Series("a", x, y)], "x", "y"))
    (line,) = root.iter("polyline")
    points = np.array([pair.split(",") for pair in line.get("points").split()], float)
    labels = {text.text: float(text.get("x")) for text in root.iter("text") if text.get("text-anchor") == "middle"}
    assert points[0, 0] == labels["0"]
    assert points[2, 0] == labels["10"]
    np.testing.assert_allclose(points[1], points[[0, 2]].mean(axis=0))
    assert points[0, 1] > points[2, 1]


@pytest.mark.parametrize(("low", "high"), [(0, 1), (0, 7), (0.5, 1), (0, 12345), (3, 3.0001), (0, 1e9)])
def test_ticks_are_round_and_reach_the_top(low, high):
    found = ticks(low, high)
    assert found[-1] >= high * (1 - 1e-9)
    assert 2 <= len(found) <= 7
    steps = np.diff(found)
    np.testing.assert_allclose(steps, steps[0])
    assert f"{steps[0]:e}"[0] in "125"


def test_time_left_follows_the_limit_that_comes_first():
    samples = [
        (float(second), {"epochs": second, "evaluated": 100 * second, "kept_qualified": 0}) for second in range(11)
    ]
    assert time_left(samples, {"epochs": 30, "evaluations": 5000}, 0.0) == (pytest.approx(20.0), "30 epochs")
    assert time_left(samples, {"epochs": 30, "evaluations": 1500}, 2.0) == (pytest.approx(3.0), "1,500 evaluations")
    assert time_left(samples, {"epochs": 30, "hours": 15 / 3600}, 1.0)[0] == pytest.approx(4.0)
    assert time_left(samples, {"qualified": 5}, 0.0) is None
    assert time_left([], {"epochs": 30}, 0.0) is None
