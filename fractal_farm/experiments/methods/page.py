"""`report.html` of the comparison: one file that needs nothing else; and sheets of designs that nobody picked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fractal_farm.catalogue.durable import put
from fractal_farm.config import PhenotypeConfig
from fractal_farm.experiments.methods.remeasured import CRISP, SIZE_MM, WALL_MM
from fractal_farm.experiments.methods.trial import SAMPLE
from fractal_farm.experiments.methods.verdict import AIMS, DEFAULT, HEADLINE, SHARE, Spread, factors
from fractal_farm.farm.report.charts import Series, line_chart
from fractal_farm.farm.report.document import document, picture, section, table
from fractal_farm.ifs.genome import Genome
from fractal_farm.picture import design_sheet, encoded

_COLUMNS, _TILE = 10, 150
_QUALITY = 85
_WORDS = {
    "qualified": "qualified",
    "distinct": "distinct",
    "printable": "distinct, printable",
    "crisp": "distinct, printable, crisp",
    "three_maps": "of these N = 3",
}

Report = Mapping[str, Any]
Samples = Mapping[str, Sequence[Mapping[str, Any]]]


def write_page(root: Path, report: Report, samples: Samples) -> Path:
    """Draw the sheets and write the page; its path.

    Args:
        root: directory of the experiment.
        report: see `comparison.compare`.
        samples: for each method, distinct printable designs of its runs; those of them whose ids come first are drawn.
    """
    sheets = {name: _sheet(designs) for name, designs in samples.items() if designs}
    for name, content in sheets.items():
        put(root / "sheets" / f"{name}.jpg", content)
    path = root / "report.html"
    put(path, report_page(report, sheets).encode())
    return path


def report_page(report: Report, sheets: Mapping[str, bytes]) -> str:
    """The page, from the figures and the sheets (JPEG) of the methods."""
    methods = report["methods"]
    body = [
        f'<h1>Ways to search, compared</h1><p class="muted">{escape(", ".join(methods))}: '
        f"{report['seeds']} seeds each, {report['evaluations']:,} evaluations a run.</p>",
        section("What it says", _verdict(report)),
        section(f"After {report['evaluations']:,} evaluations", _found(report)),
        section("What one distinct, printable, crisp design costs", _costs(report)),
        section("Distinct, printable, crisp designs", _curves(methods, HEADLINE)),
        '<div class="pair">',
        section("The same, by processor time", _curves(methods, HEADLINE, over="cpu_s")),
        section("Share of three maps among them", _curves(methods, SHARE)),
        section("Distinct designs that print", _curves(methods, "printable")),
        section("All distinct designs", _curves(methods, "distinct")),
        "</div>",
        section("Where the difference comes from", _factors(report)),
        *(section(f"{name}: designs that nobody picked", _picture(name, sheets[name])) for name in sheets),
        section("How it was measured", _method()),
        section("What was compared", _configurations(report)),
    ]
    return document("Ways to search, compared", "".join(body))


def _verdict(report: Report) -> str:
    lines = [entry["text"] for entry in report["aims"]]
    if not lines:
        stated = " and ".join(f"{at:,}" for at in sorted({aim.at for aim in AIMS}))
        lines = [
            f"The aims are stated for {stated} evaluations, {DEFAULT}, paper and a library of the best: this "
            "experiment cannot say whether they are reached."
        ]
    last = {name: method["milestones"][-1][HEADLINE]["mean"] for name, method in report["methods"].items()}
    winner = max(last, key=lambda name: last[name])
    remark = "the default" if winner == DEFAULT else f"not the default, which is {DEFAULT}"
    lines.append(f"{winner} finds most designs of the kind ({last[winner]:,.0f}): {remark}.")
    if report["in_seconds"] is not None:
        lines.append(report["in_seconds"])
    return "".join(f"<p>{escape(line)}</p>" for line in lines)


def _found(report: Report) -> str:
    rows = []
    for name, method in report["methods"].items():
        last, ratios = method["milestones"][-1], report["ratios"][name]
        cells = [_percent(last[key]) if key == SHARE else _count(last[key]) for key in _WORDS]
        rows.append((name, *cells, *(_times(ratios.get(over)) for over in ("paper", "plain"))))
    plain = report["strongest_plain"]
    columns = ["method", *_WORDS.values(), "times paper", f"times {plain}" if plain else "times a plain GA"]
    note = "Mean and standard deviation over the seeds, in brackets the lowest and the highest"
    return table(columns, rows) + f'<p class="muted">{note}; ratios of means, in brackets seed against seed.</p>'


def _costs(report: Report) -> str:
    rows = []
    for name, method in report["methods"].items():
        last = method["milestones"][-1]
        rows.append(
            (
                name,
                _number(last["evaluations_each"], ".1f"),
                _number(last["cpu_s_each"], ".1f", 1000.0),
                _number(last["wall_s_each"], ".1f", 1000.0),
                _number(last["cpu_s"], ".1f"),
                _count(last["foreseen"]),
                _count(last["gap_searches"]),
            )
        )
    columns = ("method", "evaluations", "processor ms", "clock ms", "processor s of a run", "foreseen", "gap searches")
    return table(columns, rows) + (
        '<p class="muted">Of the search alone, with its own closed forms and searches for gaps; storage and the '
        "measuring afterwards are left out. The clock counts what else the machine did meanwhile.</p>"
    )


def _factors(report: Report) -> str:
    methods = report["methods"]
    if DEFAULT not in methods:
        return ""
    ours = methods[DEFAULT]["milestones"][-1]
    rows = []
    for name, method in methods.items():
        found = factors(ours, method["milestones"][-1]) if name != DEFAULT else None
        if found is not None:
            rows.append((f"{DEFAULT} over {name}", *(f"x {value:.2f}" for value in found.values())))
    columns = ("", "qualified", "shapes among them", "printable among these", "crisp among these")
    return table(columns, rows) + '<p class="muted">The product of a line is the ratio of the headline.</p>'


def _curves(methods: Mapping[str, Any], key: str, over: str = "evaluations") -> str:
    """Means over the seeds, from the lowest to the highest seed shaded; a colour a method."""
    lines = []
    for colour, (name, method) in enumerate(methods.items(), 1):
        taken = [entry for entry in method["milestones"] if entry[key]["mean"] is not None]
        if taken:
            x = [entry[over] if over == "evaluations" else entry[over]["mean"] for entry in taken]
            y, *band = np.array([[entry[key][what] for entry in taken] for what in ("mean", "low", "high")], np.float64)
            lines.append(Series(name, np.array(x, np.float64), y, colour, np.stack(band)))
    if not lines:
        return '<p class="muted">Nothing was found.</p>'
    share = key == SHARE
    x_name = "evaluations" if over == "evaluations" else "seconds of processor time"
    return (
        line_chart(
            lines,
            x_name,
            _WORDS[key],
            width=500 if key != HEADLINE or over != "evaluations" else 1040,
            percent=share,
            high=1.0 if share else None,
        )
        + "<figcaption>mean over the seeds; shaded from the lowest to the highest</figcaption>"
    )


def _sheet(designs: Sequence[Mapping[str, Any]]) -> bytes:
    chosen = sorted(designs, key=lambda design: str(design["design_id"]))[:SAMPLE]
    phenotype = PhenotypeConfig().phenotype()
    tiles = [
        (
            Genome(np.array(design["genes"]), phenotype),
            f"{design['design_id'][:8]}  s {design['similarity_dimension']:.2f}",
        )
        for design in chosen
    ]
    return encoded(design_sheet(tiles, _COLUMNS, _TILE), "JPEG", quality=_QUALITY)


def _picture(name: str, content: bytes) -> str:
    return picture(f"Designs of {name}", content) + (
        "<figcaption>distinct printable designs of all seeds whose ids come first: an id is a hash of the genome, so "
        "this is chance; s is the similarity dimension</figcaption>"
    )


def _method() -> str:
    return f"""<ul>
<li>A run is the farm's own: its islands, schedule, migration and evaluation, in one process, without storage.</li>
<li>An evaluation is a whole one: a cloud of points, D0, D2, LLE and fitness. Searches for a gap, to
the end or until it is known to be wide or narrow enough, are counted apart, as are genomes of which closed forms were
asked what they would come out as; the processor time has all of it.</li>
<li>Islands side by side are numbered as if they worked at the same time: by epoch, generation and island.</li>
<li>Every candidate that qualified counts, whether it found a place in a library or not.</li>
<li>All is measured again after the run. <b>Qualified</b>: fitness above the threshold on another cloud of the same
genome, which no run has seen, each genome once. <b>Distinct</b>: greedily from the fittest on, signatures of that
cloud at least 1 apart. <b>Printable</b>: only designs whose gap is at most {WALL_MM:g} mm at {SIZE_MM:g} mm.
<b>Crisp</b>: only those whose similarity dimension is at most {CRISP:g}.</li></ul>"""


def _configurations(report: Report) -> str:
    parts = []
    for name, method in report["methods"].items():
        text = yaml.safe_dump(method["config"], sort_keys=False, default_flow_style=None, width=100)
        about = f"{name}: {method['about']}"
        parts.append(f"<details><summary>{escape(about)}</summary><pre>{escape(text)}</pre></details>")
    made = ", ".join(f"{name} {value}" for name, value in report["made_with"].items())
    return "".join(parts) + f'<p class="muted">{escape(made)}</p>'


def _format(spread: Spread, show: Callable[[float], str]) -> str:
    if spread["mean"] is None:
        return "-"
    mean, sd, low, high = (show(spread[key]) for key in ("mean", "sd", "low", "high"))
    return f"{mean} \u00b1 {sd} ({low} to {high})"


def _count(spread: Spread) -> str:
    return _format(spread, lambda value: f"{value:,.0f}")


def _percent(spread: Spread) -> str:
    return _format(spread, lambda value: f"{100.0 * value:.1f}") + " %"


def _number(spread: Spread, form: str, unit: float = 1.0) -> str:
    return _format(spread, lambda value: format(unit * value, form))


def _times(found: Mapping[str, Any] | None) -> str:
    if found is None:
        return "-"
    high = "" if found["high"] is None else f" to {found['high']:.1f}"
    return f"{found['mean']:.2f} ({found['low']:.1f}{high})"
