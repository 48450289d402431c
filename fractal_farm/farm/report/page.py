"""`report.html`: the course of a run in one file that needs nothing else, neither network nor scripts.

Everything in it comes from the run's committed parts, the records of its ends and its event log: fitness by generation
as in the paper's figure 4, qualified designs and throughput over time, diversity, faults, configuration, the best.
"""

from __future__ import annotations

import time
from collections import Counter
from html import escape
from pathlib import Path
from typing import Any

import yaml

from fractal_farm.catalogue import Catalogue, run_is_live
from fractal_farm.catalogue.documents import sealed_page
from fractal_farm.catalogue.durable import put
from fractal_farm.config import RunConfig
from fractal_farm.farm.history import STATISTICS, RunHistory, standing_designs
from fractal_farm.farm.report.curves import (
    fitness_chart,
    map_counts_chart,
    nothing,
    qualified_chart,
    spread_chart,
    throughput_chart,
)
from fractal_farm.farm.report.document import document, picture, section, table
from fractal_farm.farm.run_status import failures, printable
from fractal_farm.farm.stopping import chosen_run

_COLUMNS = ("design_id", "kind", "fitness", "n_maps", "gap", "epoch", "generation", "descriptor")


def write_report(root: Path, config: RunConfig) -> Path:
    """Write the report of a run into its catalogue; returns its path."""
    path = root / "report.html"
    put(path, sealed_page(report_page(root, config.run_id)), config.catalogue.durability)
    return path


def report_page(root: Path, run: str | None = None) -> str:
    """The report of a run as one HTML page.

    Args:
        root: the catalogue.
        run: id of the run, or its first digits; the latest begun if None.

    Raises:
        InputError: not a catalogue, or no such run in it.
    """
    history = RunHistory(root, chosen_run(root, run), _COLUMNS)
    rows = history.rows()
    designs = standing_designs(rows)
    name = history.config.name if history.config else history.run_id
    body = [
        _header(history, name),
        _damage(history),
        _tiles(history, designs),
        section("Fitness by generation", fitness_chart(history, rows)),
        '<div class="pair">',
        section("Designs over time", qualified_chart(history)),
        section("Throughput", throughput_chart(history)),
        section("Maps of the designs", map_counts_chart(designs)),
        section("Spread of shapes", spread_chart(designs)),
        "</div>",
        section("Faults", _faults(history)),
        section("Islands and migration", _islands(history)),
        section("The best designs", _sheet(root)),
        section("Configuration", _configuration(history)),
    ]
    return document(f"{name}: report of a run", "".join(body))


def _header(history: RunHistory, name: str) -> str:
    end = history.end()
    if end is not None:
        state = f"{'interrupted' if end['interrupted'] else 'ended'}: {end['reason']}"
    else:
        state = "running" if run_is_live(history.root, history.run_id) else "interrupted"
    when = f", {_moment(history.log[0]['at'])} to {_moment(history.log[-1]['at'])}" if history.log else ""
    digest = f" Content digest <code>{escape(end['digest'])}</code>." if end else ""
    return (
        f'<h1>{escape(name)}</h1><p class="muted">Run <code>{escape(history.run_id)}</code>, {escape(state)}{when}.'
        f"{digest}</p>"
    )


def _damage(history: RunHistory) -> str:
    if not history.damage:
        return ""
    lines = "".join(f"<li>{escape(line)}</li>" for line in history.damage)
    return f"<section><h2>Could not be read, and is missing below</h2><ul>{lines}</ul></section>"


def _tiles(history: RunHistory, designs: Any) -> str:
    if not history.commits:
        return ""
    last = history.commits[-1]
    progress, seconds = last.progress, last.elapsed_s
    tiles = [
        (f"{progress.evaluated:,}", "evaluated"),
        (f"{progress.epochs:,}", "epochs"),
        (f"{designs.num_rows:,}", "designs kept"),
        (f"{progress.kept_qualified:,}", "of them qualified"),
        (f"{progress.distinct:,}", "distinct shapes"),
    ]
    if history.config is not None:
        asked = history.config.solids.parameters
        wall = asked.wall_mm / asked.size_mm
        tiles.append((f"{printable(designs, wall):,}", f"in one piece at a wall of {asked.wall_mm:g} mm"))
    tiles += [
        (f"{progress.best_fitness:.4f}", "best fitness"),
        (f"{len(Catalogue.open(history.root).solids()):,}", "solids"),
        (f"{progress.evaluated / seconds:,.0f}/s" if seconds > 0 else "-", "evaluations"),
        (_clock(seconds), "hours of work" if seconds >= 3600 else "minutes of work"),
    ]
    return (
        '<div class="tiles">'
        + "".join(f'<div class="tile"><b>{value}</b><span class="muted">{name}</span></div>' for value, name in tiles)
        + "</div>"
    )


def _faults(history: RunHistory) -> str:
    found = failures(history.log)
    refused = int(sum(commit.statistics[:, STATISTICS.index("refused")].sum() for commit in history.commits))
    note = f'<p class="muted">{refused:,} genomes got no score (points at one place, or not finite).</p>'
    rows = [
        (failure["count"], failure["where"], failure["cause"], failure["remedy"], _moment(failure["last"]))
        for failure in found
    ]
    faults = table(("number", "where", "cause", "what was done", "last"), rows) if rows else nothing("None.")
    return faults + (note if refused else "")


def _islands(history: RunHistory) -> str:
    received: dict[int, Counter[int]] = {}
    settled: Counter[int] = Counter()
    for commit in history.commits:
        for island, _, arrivals, found_place in commit.exchanges:
            received.setdefault(island, Counter()).update(dict(arrivals))
            settled[island] += found_place
    if not received:
        return nothing("Nothing is committed yet.")
    latest = {int(row[0]): row for row in history.commits[-1].statistics}
    rows = [
        (
            island,
            f"{latest[island][STATISTICS.index('best')]:.4f}" if island in latest else "-",
            f"{latest[island][STATISTICS.index('mean_accepted')]:.4f}" if island in latest else "-",
            ", ".join(f"{number:,} from {source}" for source, number in sorted(arrivals.items())) or "none",
            f"{settled[island]:,}",
        )
        for island, arrivals in sorted(received.items())
    ]
    return table(("island", "best", "mean of accepted", "received", "settled"), rows)


def _sheet(root: Path) -> str:
    try:
        content = (root / "catalogue.png").read_bytes()
    except FileNotFoundError:
        return nothing("There is no picture of them yet.")
    return picture("The best designs", content)


def _configuration(history: RunHistory) -> str:
    if history.config is None:
        return nothing("run.json cannot be read.")
    tree = history.config.to_dict()
    seeds = tree["evolution"]["library"]["seeds"]
    if seeds:
        tree["evolution"]["library"]["seeds"] = f"({len(seeds)} genomes)"
    text = yaml.safe_dump(tree, sort_keys=False, default_flow_style=None, width=100)
    versions = ", ".join(f"{name} {version}" for name, version in history.versions.items())
    return (
        f"<details><summary>as of its last session</summary><pre>{escape(text)}</pre></details>"
        f'<p class="muted">{escape(versions)}</p>'
    )


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def _moment(at: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(at))
