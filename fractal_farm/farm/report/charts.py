"""Line charts as inline SVG, for the report: no scripts, no fonts or styles from elsewhere.

Colours come from CSS classes (`s1` .. `s8`, in a fixed order that stays apart for colour-blind eyes, light and dark),
so that the page decides them. Each line is named at its end; pointing at a chart shows the values there.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
import numpy.typing as npt

Numbers = npt.NDArray[np.float64]

_HEIGHT = 240
_LEFT, _RIGHT, _NAMES, _TOP, _BOTTOM = 54, 14, 92, 14, 42
_LABEL_GAP = 15.0
_TARGETS = 120

STYLE = """
svg.chart { width: 100%; height: auto; display: block; font: 12px system-ui, sans-serif; }
svg.wide { min-width: 640px; }
.chart text { fill: var(--muted); }
.chart text.name { fill: var(--ink); }
.chart .grid { stroke: var(--line); stroke-width: 1; }
.chart .axis { stroke: var(--muted); stroke-width: 1; }
.chart .mark { stroke: var(--muted); stroke-width: 1; stroke-dasharray: 3 4; }
.chart .curve { fill: none; stroke-width: 2; stroke-linejoin: round; stroke-linecap: round; }
.chart .hit { fill: transparent; }
.chart .hit:hover { fill: var(--line); fill-opacity: 0.6; }
.chart .band { fill-opacity: 0.18; }
""" + "\n".join(f".chart .s{k} {{ stroke: var(--s{k}); }} .chart .f{k} {{ fill: var(--s{k}); }}" for k in range(1, 9))


@dataclass(frozen=True)
class Series:
    """One line of a chart.

    Attributes:
        name: at the end of the line and in the values that are shown.
        x: (n,) increasing.
        y: (n,) finite.
        colour: 1 to 8.
        band: (2, n) lower and upper end of what is shaded around the line, or None.
    """

    name: str
    x: Numbers
    y: Numbers
    colour: int = 1
    band: Numbers | None = None


def line_chart(
    series: Sequence[Series],
    x_name: str,
    y_name: str,
    *,
    width: int = 500,
    low: float = 0.0,
    high: float | None = None,
    percent: bool = False,
    marks: Sequence[tuple[float, str]] = (),
    events: Sequence[tuple[float, str]] = (),
) -> str:
    """A chart with one vertical axis.

    Args:
        series: lines with at least one point each; one of them needs no name.
        x_name: what the horizontal axis shows.
        y_name: what the vertical axis shows; for people who hear the page.
        width: of the drawing, in units of which a text is 12 high.
        low: lower end of the vertical axis.
        high: upper end; None for a round number above the largest value.
        percent: write y as percentages.
        marks: levels to draw as dashed lines, with a name.
        events: places on the horizontal axis to draw as dashed lines, with a name.

    Returns:
        An SVG element.
    """
    x_low, x_high = min(float(line.x[0]) for line in series), max(float(line.x[-1]) for line in series)
    if x_high <= x_low:
        x_low, x_high = x_low - 0.5, x_high + 0.5
    highest = max(float((line.y if line.band is None else line.band).max()) for line in series)
    y_ticks = ticks(low, highest if high is None else high)
    top = y_ticks[-1] if high is None else high

    right, bottom = width - (_NAMES if len(series) > 1 else _RIGHT), _HEIGHT - _BOTTOM

    def across(x: float) -> float:
        return _LEFT + (x - x_low) / (x_high - x_low) * (right - _LEFT)

    def down(y: float) -> float:
        return bottom - (y - low) / (top - low) * (bottom - _TOP)

    kind = "chart wide" if width > 600 else "chart"
    parts = [f'<svg class="{kind}" viewBox="0 0 {width} {_HEIGHT}" role="img" aria-label="{escape(y_name)}">']
    for y in y_ticks:
        if y <= top:
            parts.append(_line("grid", _LEFT, down(y), right, down(y)))
            parts.append(_text(_LEFT - 8, down(y) + 4, _number(y, percent), "end"))
    for x in ticks(x_low, x_high):
        if x_low <= x <= x_high:
            parts.append(_text(across(x), bottom + 18, _number(x), "middle"))
    parts.append(_line("axis", _LEFT, bottom, right, bottom))
    parts.append(_text((_LEFT + right) / 2, _HEIGHT - 6, x_name, "middle"))
    for y, name in marks:
        parts.append(_line("mark", _LEFT, down(y), right, down(y)))
        parts.append(_text(right - 4, down(y) + 14, name, "end"))
    for x, name in events:
        parts.append(_line("mark", across(x), _TOP, across(x), bottom))
        parts.append(_text(across(x) + 4, bottom - 6, name, "start"))

    def path(x: Numbers, y: Numbers) -> str:
        return " ".join(f"{across(a):.1f},{down(min(max(b, low), top)):.1f}" for a, b in zip(x, y, strict=True))

    for line in series:
        if line.band is not None:
            around = path(np.append(line.x, line.x[::-1]), np.append(line.band[0], line.band[1, ::-1]))
            parts.append(f'<polygon class="band f{line.colour}" points="{around}"/>')
        parts.append(f'<polyline class="curve s{line.colour}" points="{path(line.x, line.y)}"/>')
        if len(line.x) == 1:
            x, y = across(float(line.x[0])), down(float(line.y[0]))
            parts.append(f'<circle class="curve s{line.colour}" cx="{x:.1f}" cy="{y:.1f}" r="3"/>')
    if len(series) > 1:
        parts += _names(series, [down(float(np.clip(line.y[-1], low, top))) for line in series], right)
    parts += _targets(series, x_name, percent, across, right, bottom)
    return "".join(parts) + "</svg>"


def ticks(low: float, high: float, count: int = 5) -> list[float]:
    """Round numbers from at or above `low` to at or above `high`, about `count` of them."""
    span = max(high - low, 1e-12)
    unit = 10.0 ** math.floor(math.log10(span / count))
    step = next(unit * factor for factor in (1, 2, 5, 10) if span / (unit * factor) <= count)
    first, last = math.ceil(low / step - 1e-9), math.ceil(high / step - 1e-9)
    return [step * k for k in range(first, last + 1)]


def _names(series: Sequence[Series], heights: list[float], right: float) -> list[str]:
    """The name of each line at its end, moved apart where they would meet."""
    order = np.argsort(heights, kind="stable")
    placed = np.array(heights)
    for above, below in itertools.pairwise(order):
        placed[below] = max(placed[below], placed[above] + _LABEL_GAP)
    placed -= max(0.0, placed.max() - (_HEIGHT - _BOTTOM))
    parts = []
    for line, y in zip(series, placed, strict=True):
        parts.append(
            f'<line class="curve s{line.colour}" x1="{right + 8}" y1="{y:.1f}" x2="{right + 20}" y2="{y:.1f}"/>'
        )
        parts.append(_text(right + 26, y + 4, line.name, "start", "name"))
    return parts


def _targets(
    series: Sequence[Series], x_name: str, percent: bool, across: Callable[[float], float], right: float, bottom: float
) -> list[str]:
    """Invisible bars that show the values below the pointer."""
    x = max((line.x for line in series), key=len)
    x = x[:: math.ceil(len(x) / _TARGETS)]
    middles = [_LEFT, *((across(a) + across(b)) / 2 for a, b in itertools.pairwise(x)), right]
    parts = []
    for value, start, end in zip(x, middles, middles[1:], strict=False):
        lines = [f"{x_name} {_number(float(value))}"]
        for line in series:
            nearest = int(np.abs(line.x - value).argmin())
            lines.append(f"{line.name}: {_number(float(line.y[nearest]), percent, exact=True)}")
        parts.append(
            f'<rect class="hit" x="{start:.1f}" y="{_TOP}" width="{max(end - start, 1):.1f}" '
            f'height="{bottom - _TOP}"><title>{escape(chr(10).join(lines))}</title></rect>'
        )
    return parts


def _line(kind: str, x1: float, y1: float, x2: float, y2: float) -> str:
    return f'<line class="{kind}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'


def _text(x: float, y: float, text: str, anchor: str, kind: str = "") -> str:
    return f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'


def _number(value: float, percent: bool = False, exact: bool = False) -> str:
    if percent:
        return f"{100 * value:.1f} %" if exact else f"{100 * value:.0f} %"
    if abs(value) >= 1e6:
        return f"{value / 1e6:g} M" if not exact else f"{value:,.0f}"
    if exact:
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    return f"{value:,.10g}"
