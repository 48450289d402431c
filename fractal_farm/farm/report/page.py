"""`report.html`: the course of a run in one file that needs nothing else, neither network nor scripts.

Everything in it comes from the run's committed parts, the records of its ends and its event log: fitness by generation
as in the paper's figure 4, qualified designs and throughput over time, diversity, faults, configuration, the best.
"""

from __future__ import annotations

import base64
import time
from collections import Counter
from collections.abc import Iterable
from html import escape
from pathlib import Path
from typing import Any

import yaml

from fractal_farm.catalogue import Catalogue, run_is_live
from fractal_farm.catalogue.documents import sealed_page
from fractal_farm.catalogue.durable import put
from fractal_farm.config import RunConfig
from fractal_farm.farm.history import STATISTICS, RunHistory, standing_designs
from fractal_farm.farm.report.charts import STYLE
from fractal_farm.farm.report.curves import (
    fitness_chart,
    map_counts_chart,
    nothing,
    qualified_chart,
    spread_chart,
    throughput_chart,
)
from fractal_farm.farm.run_status import failures, printable
from fractal_farm.farm.stopping import chosen_run

_COLUMNS = ("design_id", "kind", "fitness", "n_maps", "gap", "epoch", "generation", "descriptor")

_PAGE_STYLE = """
:root { color-scheme: light dark; --page: #f9f9f7; --card: #fcfcfb; --ink: #0b0b0b; --muted: #6b6a64; --line: #e4e3de;
  --s1: #2a78d6; --s2: #1baf7a; --s3: #eda100; --s4: #008300;
  --s5: #4a3aa7; --s6: #e34948; --s7: #e87ba4; --s8: #eb6834; }
@media (prefers-color-scheme: dark) {
  :root { --page: #0d0d0d; --card: #1a1a19; --ink: #f4f4f1; --muted: #a5a49b; --line: #33332f;
    --s1: #3987e5; --s2: #199e70; --s3: #c98500; --s4: #008300;
    --s5: #9085e9; --s6: #e66767; --s7: #d55181; --s8: #d95926; }
}
body { margin: 0; background: var(--page); color: var(--ink); font: 15px/1.5 system-ui, sans-serif; }
main { max-width: 1100px; margin: 0 auto; padding: 24px 20px 48px; }
h1 { font-size: 26px; margin: 0; } h2 { font-size: 16px; margin: 0 0 2px; }
p { margin: 4px 0 10px; } .muted, figcaption { color: var(--muted); font-size: 13px; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(100px, 1fr)); gap: 12px; margin: 18px 0; }
.tile, section { background: var(--card); border: 1px solid var(--line); border-radius: 8px; padding: 12px 14px; }
.tile b { display: block; font-size: 19px; font-weight: 600; }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(480px, 100%), 1fr)); gap: 16px; }
.pair, section { margin-top: 16px; } .pair section { margin-top: 0; min-width: 0; }
section { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: 14px; }
th { text-align: left; color: var(--muted); font-weight: 500; }
td, th { padding: 4px 12px 4px 0; border-bottom: 1px solid var(--line); vertical-align: top; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
.scroll { overflow-x: auto; } pre { overflow-x: auto; font-size: 13px; margin: 8px 0 0; }
img { max-width: 100%; border-radius: 6px; display: block; } code { overflow-wrap: anywhere; }
"""


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
        _section("Fitness by generation", fitness_chart(history, rows), "section"),
        '<div class="pair">',
        _section("Designs over time", qualified_chart(history)),
        _section("Throughput", throughput_chart(history)),
        _section("Maps of the designs", map_counts_chart(designs)),
        _section("Spread of shapes", spread_chart(designs)),
        "</div>",
        _section("Faults", _faults(history)),
        _section("Islands and migration", _islands(history)),
        _section("The best designs", _sheet(root)),
        _section("Configuration", _configuration(history)),
    ]
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; "
        'img-src data:">'
        f"<title>{escape(name)}: report of a run</title><style>{_PAGE_STYLE}{STYLE}</style></head>"
        f"<body><main>{''.join(body)}</main></body></html>\n"
    )


def _section(title: str, content: str, kind: str = "section") -> str:
    return f"<{kind}><h2>{escape(title)}</h2>{content}</{kind}>"


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
        wall = history.config.solids.wall_mm / history.config.solids.size_mm
        tiles.append(
            (f"{printable(designs, wall):,}", f"in one piece at a wall of {history.config.solids.wall_mm:g} mm")
        )
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
    faults = _table(("number", "where", "cause", "what was done", "last"), rows) if rows else nothing("None.")
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
    return _table(("island", "best", "mean of accepted", "received", "settled"), rows)


def _sheet(root: Path) -> str:
    try:
        content = (root / "catalogue.png").read_bytes()
    except FileNotFoundError:
        return nothing("There is no picture of them yet.")
    return f'<img alt="The best designs" src="data:image/png;base64,{base64.b64encode(content).decode()}">'


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


def _table(columns: Iterable[str], rows: Iterable[tuple[Any, ...]]) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    body = "".join("<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><tr>{head}</tr>{body}</table></div>'


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def _moment(at: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(at))
