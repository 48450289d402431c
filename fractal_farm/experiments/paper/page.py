"""`report.html`: the paper's results and ours side by side, and every difference in words; one file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from PIL import Image

from fractal_farm.catalogue.durable import put
from fractal_farm.experiments.paper.findings import EACH_EVALUATIONS, EACH_S, SECONDS
from fractal_farm.farm.report.charts import Series, line_chart
from fractal_farm.farm.report.document import document, picture
from fractal_farm.picture import encoded

Results = Mapping[str, Any]
_WIDEST = 1400


def side_by_side(results: Results) -> list[tuple[str, str, str]]:
    """Quantity, the paper, here."""
    rows = []
    if four := results.get("fig4"):
        each = f"{four['evaluations_each']:.2f}"
        rows += [
            ("lowest mean of accepted offspring in a generation", "above 0.8", f"{four['lowest']:.3f}"),
            ("generations above 0.8", "15 of 15", f"{four['above']} of {four['generations']}"),
            ("evaluations for an accepted offspring", f"{EACH_EVALUATIONS:.2f} (7.15 s / 4.41 s)", each),
        ]
    if five := results.get("fig5"):
        means = {
            key: " < ".join(f"{case[key][0]:.3f}" for case in five["cases"].values())
            for key in ("fitness", "excellent")
        }
        second = five["cases"]["case2"]["evaluation_s"]
        rows += [
            ("mean fitness of cases 1, 2, 3", "1 < 2 < 3", means["fitness"]),
            ("share of excellent of cases 1, 2, 3", "1 < 2 < 3", means["excellent"]),
            ("confidence in both orders", "not stated", f"{five['confidence']:.2%}"),
            ("seconds for an evaluation (case 2)", f"{SECONDS['case2'] / 100:.2f}", f"{second:.5f}"),
            ("seconds for an accepted offspring, evaluations alone", f"{EACH_S}", f"{five['each_s']:.5f}"),
        ]
    if found := results.get("sensitivity"):
        best = next(row for row in found["rows"] if row["name"] == found["best"])
        rows.append(("reading that fits best", "not legible", f"{best['name']}: {best['lowest']:.3f} or more"))
    return rows


def write_page(root: Path, results: Results) -> None:
    """Write report.html from what was found and the pictures in the directories of the figures."""
    templates = Environment(loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined)
    body = templates.get_template("report.html.jinja").render(
        results,
        side_by_side=side_by_side(results),
        curves=_curves(results),
        pictures={name: "".join(map(_picture, sorted((root / name).glob("fig*.png")))) for name in results},
        seconds=SECONDS,
        paper_each=EACH_EVALUATIONS,
    )
    put(root / "report.html", document("The paper, made again", body).encode())


def _curves(results: Results) -> str:
    """Fig 4 under our reading and the one that fits best."""
    drawn = {"ours": results["fig4"]} if "fig4" in results else {}
    if "sensitivity" in results:
        drawn["best fit"] = results["sensitivity"]["best_fig4"]
    lines = []
    for colour, (name, course) in enumerate(drawn.items(), 1):
        mean, sd = np.array(course["mean"]), np.array(course["sd"])
        lines.append(Series(name, np.arange(1.0, len(mean) + 1), mean, colour, np.stack([mean - sd, mean + sd])))
    marks = [(0.8, "the paper: above")]
    return line_chart(lines, "generation", "mean fitness", width=1040, low=0.6, high=1.0, marks=marks) if lines else ""


def _picture(path: Path) -> str:
    with Image.open(path) as drawn:
        drawn.thumbnail((_WIDEST, 2 * _WIDEST))
        return picture(path.stem, encoded(drawn.convert("RGB"), "JPEG", quality=85))
