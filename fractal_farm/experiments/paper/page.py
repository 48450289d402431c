"""`report.html`: the paper's results and ours side by side, and every difference in words (`words.toml`); one file."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from fractal_farm.catalogue.durable import put
from fractal_farm.experiments.paper.findings import EACH_EVALUATIONS, EACH_S, SECONDS
from fractal_farm.farm.report.charts import Series, line_chart
from fractal_farm.farm.report.document import document, picture, section, table
from fractal_farm.picture import encoded

Results = Mapping[str, Any]
_WIDEST = 1400
_WORDS = tomllib.loads(Path(__file__).with_name("words.toml").read_text("utf-8"))


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
    scale = results["scale"]
    about = f"{scale['experiments']} experiments of each case, seed {scale['seed']}"
    body = [
        "<h1>The paper, made again</h1>"
        '<p class="muted">Pang and Hui, Interactive Evolutionary 3D Fractal Modeling with Modified IFS (2009), beside '
        f"what the farm finds: {about}.</p>",
        section("Side by side", table(("quantity", "paper", "here"), side_by_side(results))),
    ]
    for name, words in _WORDS.items():
        if name in results:
            content, values = _MAKERS[name](results, words)
            text = "".join(f"<p>{escape(line.format(**values))}</p>" for line in words["text"])
            walk = f"<pre>{escape(words['walk'].format(**values).strip())}</pre>" if "walk" in words else ""
            pictures = "".join(map(_picture, sorted((root / name).glob("fig*.png"))))
            body.append(section(words["title"], content + text + walk + pictures))
    body.append(section("Made with", f'<p class="muted">{escape(str(results["made_with"]))}</p>'))
    put(root / "report.html", document("The paper, made again", "".join(body)).encode())


def _fig4(results: Results, words: Results) -> tuple[str, Results]:
    four, best = results["fig4"], results.get("sensitivity", {})
    drawn = {"ours": four} | ({"best fit": best["best_fig4"]} if best else {})
    lines = []
    for colour, (name, course) in enumerate(drawn.items(), 1):
        mean, sd = np.array(course["mean"]), np.array(course["sd"])
        lines.append(Series(name, np.arange(1.0, len(mean) + 1), mean, colour, np.stack([mean - sd, mean + sd])))
    marks = [(0.8, "the paper: above")]
    chart = line_chart(lines, "generation", "mean fitness", width=1040, low=0.6, high=1.0, marks=marks)
    remark = words["reached" if four["above"] == four["generations"] else "missed"]
    return chart, four | {"remark": remark}


def _fig5(results: Results, words: Results) -> tuple[str, Results]:
    five, scale = results["fig5"], results["scale"]
    rows = []
    for name, case in five["cases"].items():
        told = [f"{case[key][0]:.3f} &#177; {case[key][1]:.3f}" for key in ("fitness", "excellent")]
        stored = f"{case['seconds'] / scale['experiments']:.1f} s"
        told += [_bar(case["fitness"], 1) + "<br>" + _bar(case["excellent"], 2), f"{SECONDS[name]:.0f} s", stored]
        told += [f"{case['evaluations']:.0f}", f"{1000 * case['evaluation_s']:.2f} ms"]
        rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in (words[name], *told)) + "</tr>")
    names = ("case", "mean fitness", "excellent", "", "paper", "here, stored", "evaluations", "an evaluation")
    head = "".join(f"<th>{name}</th>" for name in names)
    third, second = five["cases"]["case3"], five["cases"]["case2"]
    each = results["fig4"]["evaluations_each"]
    return f"<table><tr>{head}</tr>{''.join(rows)}</table>", five | {
        "verdict": words["ordered" if five["ordered"] else "disordered"],
        "fitness3": third["fitness"][0],
        "excellent3": third["excellent"][0],
        "paper_each": EACH_EVALUATIONS,
        "each": each,
        "ms": 1000 * third["evaluation_s"],
        "algorithm": EACH_EVALUATIONS / each,
        "machine": SECONDS["case2"] / 100 / second["evaluation_s"],
    }


def _sensitivity(results: Results, _words: Results) -> tuple[str, Results]:
    rows, best = results["sensitivity"]["rows"], results["sensitivity"]["best"]
    told = []
    for row in rows:
        means = [" ".join(f"{case[key][0]:.2f}" for case in row["cases"].values()) for key in ("fitness", "excellent")]
        line = [row["name"] + (" *" if row["name"] == best else ""), row["about"], f"{row['lowest']:.3f}"]
        line += [f"{row['above']} of {row['generations']}", f"{row['evaluations_each']:.2f}", *means]
        told.append((*line, "yes" if row["ordered"] else "no", f"{row['confidence']:.1%}", row["survive"]))
    head = ["reading", "what it is", "fig 4 lowest", "above 0.8", "evaluations each", "fitness 1 2 3"]
    head += ["excellent 1 2 3", "1 < 2 < 3", "confidence", "table 1 passes"]
    likes = {row["name"]: row["like_table1"] for row in rows if row["like_table1"]}
    chosen = next(row for row in rows if row["name"] == best)
    return table(head, told), {
        "whole": "; ".join(row["name"] for row in rows if row["above"] == row["generations"]) or "none",
        "best": f"{best} ({chosen['about']})",
        "agrees": chosen["agrees"],
        "each": chosen["evaluations_each"],
        "paper_each": EACH_EVALUATIONS,
        "alike": "; ".join(f"{name} {like['inside']:.1e} and {like['near']:.1e}" for name, like in likes.items()),
    }


def _table1(results: Results, words: Results) -> tuple[str, Results]:
    rows = [
        (
            row["name"],
            *(f"{row[key]:.3f}" for key in ("d0", "d2", "lle", "fitness")),
            f"about {words['notes'][row['name']]}",
            " x ".join(map(str, row["grid"])),
            f"{row['wall_used_mm']:.2f} mm" + (", thickened" if row["thickened"] else ""),
            f"{row['bodies']}, {'' if row['watertight'] else 'NOT '}watertight",
            f"{row['faces']:,}",
        )
        for row in results["table1"]["rows"]
    ]
    head = ("genome", "D0", "D2", "LLE", "fitness", "derived", "voxels", "wall", "bodies", "faces")
    return table(head, rows), {}


def _fig7(results: Results, _words: Results) -> tuple[str, Results]:
    things = results["fig7"]["things"]
    return "", {"things": "; ".join(f"{name}: {points:,} points, {copies} of it" for name, points, copies in things)}


def _fig8(results: Results, _words: Results) -> tuple[str, Results]:
    pieces = results["fig8"]["pieces"]
    rows, said = [], []
    for piece in pieces:
        grids = (" x ".join(map(str, piece[key])) for key in ("paper_grid", "grid"))
        verdicts = []
        for name, made in piece["certificates"].items():
            verdicts.append(f"{name}: {'passes' if made['passes'] else 'fails'}, {made['grams']:.1f} g")
            said += [f"{piece['jewel']}, {name}: {line}" for line in made["findings"]]
        rows.append((piece["jewel"], piece["design_id"][:8], *grids, f"{piece['fitness']:.3f}", "; ".join(verdicts)))
    head = ("piece", "design", "paper's grid", "our voxels", "fitness", "certificate")
    remarks = "".join(f"<li>{escape(line)}</li>" for line in said)
    first = {"place": results["fig8"]["catalogue"], "design": pieces[0]["design_id"][:8], "metal": pieces[0]["metal"]}
    return table(head, rows) + f"<ul>{remarks}</ul>", first


def _fig10(results: Results, _words: Results) -> tuple[str, Results]:
    return "", results["fig10"] | {"rows": "; ".join(results["fig10"]["rows"])}


_MAKERS = {maker.__name__[1:]: maker for maker in (_fig4, _fig5, _sensitivity, _table1, _fig7, _fig8, _fig10)}


def _bar(value: tuple[float, float], colour: int) -> str:
    mean, sd = (180.0 * number for number in value)
    return (
        '<svg class="chart" viewBox="0 0 190 12" style="width:190px;height:12px;display:inline">'
        f'<rect class="f{colour}" x="0" y="1" width="{mean:.1f}" height="10"/>'
        f'<line class="axis" x1="{mean - sd:.1f}" x2="{mean + sd:.1f}" y1="6" y2="6"/></svg>'
    )


def _picture(path: Path) -> str:
    with Image.open(path) as drawn:
        drawn.thumbnail((_WIDEST, 2 * _WIDEST))
        return picture(path.stem, encoded(drawn.convert("RGB"), "JPEG", quality=85))
