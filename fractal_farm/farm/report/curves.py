"""The curves of the report: what to draw, from the course of a run.

Each function returns an SVG with a caption, or a sentence that says why there is nothing to draw.
"""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np
import pyarrow.compute as pc

from fractal_farm.farm.history import STATISTICS, RunHistory
from fractal_farm.farm.report.charts import Series, line_chart

_POINTS = 240
_GROUPS = 40
_GROUP_DESIGNS = 25
_NAMED_RESUMPTIONS = 2
_UNITS = ((3 * 3600.0, 3600.0, "hours"), (180.0, 60.0, "minutes"), (0.0, 1.0, "seconds"))


def fitness_chart(history: RunHistory, rows: Any) -> str:
    """Best, mean and worst by generation, as in figure 4 of Pang and Hui (2009); many generations share a point."""
    if not history.commits:
        return nothing("Nothing is committed yet.")
    table = np.concatenate([commit.statistics for commit in history.commits])
    generation = table[:, STATISTICS.index("generation")].astype(np.int64)
    width = -(-(int(generation.max()) + 1) // _POINTS)
    size = int(generation.max()) // width + 1
    x = np.arange(size) * float(width)
    born = rows.column("generation").to_numpy() // width
    inside = (born >= 0) & (born < size)
    born, fitness = born[inside], rows.column("fitness").to_numpy()[inside]
    highest, lowest = np.full(size, -np.inf), np.full(size, np.inf)
    np.maximum.at(highest, born, fitness)
    np.minimum.at(lowest, born, fitness)
    joined = np.bincount(born, minlength=size)
    mean = np.bincount(born, fitness, size) / np.maximum(joined, 1)
    curves = [("best", highest, joined > 0), ("mean", mean, joined > 0), ("worst", lowest, joined > 0)]
    note = "best, mean and worst of the designs that joined a library"
    if history.config is None or history.config.evolution.library.growth != "append":
        accepted, mean_accepted = (table[:, STATISTICS.index(name)] for name in ("accepted", "mean_accepted"))
        weight = np.bincount(generation // width, accepted, size)
        average = np.bincount(generation // width, accepted * mean_accepted, size) / np.maximum(weight, 1)
        curves.append(("accepted", average, weight > 0))
        note += "; accepted: mean of all offspring above the elimination threshold, most of which found no place"
    lines = [Series(name, x[known], y[known], k) for k, (name, y, known) in enumerate(curves, 1) if known.any()]
    if not lines:
        return nothing("No genome was accepted.")
    marks = [(history.config.evolution.qualified, "qualified")] if history.config else []
    low = min(0.9, np.floor(10.0 * min(float(line.y.min()) for line in lines)) / 10.0)
    together = f". A point stands for {width} generations" if width > 1 else ""
    return (
        line_chart(lines, "generation", "fitness by generation", width=1040, low=low, high=1.0, marks=marks)
        + f"<figcaption>{note}{together}</figcaption>"
    )


def qualified_chart(history: RunHistory) -> str:
    """Designs in the catalogue over the time that the run worked."""
    samples = [(commit.elapsed_s, commit.progress) for commit in history.commits]
    if not samples:
        return nothing("Nothing is committed yet.")
    unit, unit_name = _unit(samples[-1][0])
    x = np.array([0.0, *(seconds / unit for seconds, _ in samples)])
    qualified = np.array([0.0, *(progress.kept_qualified for _, progress in samples)])
    kept = np.array([0.0, *(progress.designs for _, progress in samples)])
    distinct = np.array([0.0, *(progress.distinct for _, progress in samples)])
    lines = [Series("qualified", x, qualified, 1)]
    if (kept != qualified).any():
        lines.append(Series("all kept", x, kept, 2))
    if (distinct != qualified).any():
        lines.append(Series("distinct", x, distinct, 3))
    keep = history.config.catalogue.keep if history.config else "kept"
    return (
        line_chart(lines, f"{unit_name} of work", "designs in the catalogue over time", events=_resumptions(history))
        + f"<figcaption>designs in the catalogue (keep: {escape(keep)})</figcaption>"
    )


def throughput_chart(history: RunHistory) -> str:
    """Evaluations a second over the time that the run worked."""
    samples = [(0.0, 0), *((seconds, progress["evaluated"]) for seconds, progress in history.samples())]
    seconds, evaluated = np.array(samples, np.float64).T
    if seconds[-1] <= 0:
        return nothing("Nothing is committed yet.")
    unit, unit_name = _unit(float(seconds[-1]))
    edges = np.linspace(0.0, seconds[-1], min(len(samples), _POINTS // 2))
    rate = np.diff(np.interp(edges, seconds, evaluated)) / np.diff(edges)
    x = np.repeat(edges / unit, 2)[1:-1]
    line = Series("evaluations a second", x, np.repeat(rate, 2))
    return (
        line_chart([line], f"{unit_name} of work", "evaluations a second over time", events=_resumptions(history))
        + "<figcaption>evaluations a second, storage and solids included</figcaption>"
    )


def _resumptions(history: RunHistory) -> list[tuple[float, str]]:
    """Where later sessions began, in the unit of the time axis."""
    if not history.commits:
        return []
    unit, _ = _unit(history.commits[-1].elapsed_s)
    starts = [entry["progress"]["epochs"] for entry in history.log if entry["event"] == "RunStarted"][1:]
    reached = {commit.progress.epochs: commit.elapsed_s for commit in history.commits[:-1]}
    places = [reached[epochs] / unit for epochs in dict.fromkeys(starts) if epochs in reached]
    names = ["resumed"] * len(places)
    if len(places) > _NAMED_RESUMPTIONS:
        names = [f"resumed {len(starts)} times", *[""] * (len(places) - 1)]
    return list(zip(places, names, strict=True))


def map_counts_chart(designs: Any) -> str:
    """Which numbers of maps the designs born at the same time have."""
    if not designs.num_rows:
        return nothing("No design is committed yet.")
    n_maps = designs.column("n_maps").to_numpy()
    groups = _groups(designs)
    x = np.array([epoch for epoch, _ in groups])
    lines = [
        Series(f"N = {count}", x, np.array([np.mean(n_maps[group] == count) for _, group in groups]), count - 1)
        for count in np.unique(n_maps).tolist()
    ]
    return (
        line_chart(lines, "epoch of birth", "share of designs by number of maps", high=1.0, percent=True)
        + "<figcaption>share of the designs born at that time, by their number of maps N</figcaption>"
    )


def spread_chart(designs: Any) -> str:
    """How far apart the shapes born at the same time lie."""
    known = designs.filter(pc.is_valid(designs.column("descriptor")))
    if known.num_rows < 2:
        return nothing("Fewer than two designs are committed.")
    flat = known.column("descriptor").combine_chunks().flatten().to_numpy().astype(np.float64)
    descriptors = flat.reshape(known.num_rows, -1)
    groups = [(epoch, group) for epoch, group in _groups(known) if len(group) > 1]
    y = np.array([np.sqrt(descriptors[group].var(axis=0, ddof=1).sum()) for _, group in groups])
    line = Series("spread", np.array([epoch for epoch, _ in groups]), y)
    return (
        line_chart([line], "epoch of birth", "spread of shape descriptors")
        + "<figcaption>root mean square distance of shape descriptors from their mean, among the designs born at that "
        "time: falls as a run narrows down to one kind of shape</figcaption>"
    )


def _groups(designs: Any) -> list[tuple[float, Any]]:
    """Designs of whole epochs of birth together, enough in each group: (mean epoch, indices)."""
    epoch = designs.column("epoch").to_numpy()
    order = np.argsort(epoch, kind="stable")
    least = max(_GROUP_DESIGNS, -(-len(order) // _GROUPS))
    begins = np.flatnonzero(np.diff(epoch[order], prepend=-1))
    cuts = [0]
    for begin in begins.tolist():
        if begin - cuts[-1] >= least and len(order) - begin >= least:
            cuts.append(begin)
    return [(float(epoch[group].mean()), group) for group in np.split(order, cuts[1:])]


def nothing(reason: str) -> str:
    """A sentence where a chart would have nothing to show."""
    return f'<p class="muted">{escape(reason)}</p>'


def _unit(seconds: float) -> tuple[float, str]:
    return next((unit, name) for least, unit, name in _UNITS if seconds >= least)
