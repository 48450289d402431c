"""From the results of all trials to what they say: spreads over the seeds, ratios of methods, aims met or missed."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fractal_farm.experiments.methods.presets import PRESETS

FIGURES = ("qualified", "distinct", "printable", "crisp", "three_maps")
COSTS = ("foreseen", "gap_searches", "cpu_s", "wall_s")
EACH = {"evaluations_each": "evaluations", "cpu_s_each": "cpu_s", "wall_s_each": "wall_s"}
HEADLINE, SHARE = "crisp", "three_maps"
DEFAULT, PAPER = "niches", "paper"

Spread = dict[str, Any]
Summary = list[dict[str, Any]]


@dataclass(frozen=True)
class Aim:
    """What the default method shall reach.

    Attributes:
        at: evaluations at which it counts.
        least: ratio of the headline to that of another method; or share of designs with three maps.
        over: "paper", "plain" for the strongest library of the best, or None for the share.
    """

    at: int
    least: float
    over: str | None


AIMS = (
    Aim(20_000, 20.0, "paper"),
    Aim(20_000, 8.0, "plain"),
    Aim(20_000, 0.35, None),
    Aim(1_000_000, 5.0, "paper"),
    Aim(1_000_000, 5.0, "plain"),
)


def spread(values: Sequence[float | None]) -> Spread:
    """Mean, standard deviation over seeds (0 of one), lowest, highest, and the values in the order of the seeds.

    A value that there is not (a share of nothing) is left out of the others, which are None if there is none at all.
    """
    known = [value for value in values if value is not None]
    if not known:
        return {"mean": None, "sd": None, "low": None, "high": None, "values": list(values)}
    deviation = statistics.stdev(known) if len(known) > 1 else 0.0
    return {
        "mean": statistics.fmean(known),
        "sd": deviation,
        "low": min(known),
        "high": max(known),
        "values": list(values),
    }


def summary(results: Sequence[Mapping[str, Any]]) -> Summary:
    """The results of one method with several seeds as spreads.

    Returns:
        For each milestone its `evaluations`, and the spread of each of `FIGURES` and `COSTS`, and of `EACH`: what a
        design of the headline costs.
    """
    taken = []
    for at in zip(*(result["milestones"] for result in results), strict=True):
        entry: dict[str, Any] = {"evaluations": at[0]["evaluations"]}
        entry |= {name: spread([one[name] for one in at]) for name in (*FIGURES, *COSTS)}
        for name, cost in EACH.items():
            entry[name] = spread([one[cost] / one[HEADLINE] if one[HEADLINE] else None for one in at])
        taken.append(entry)
    return taken


def ratio(ours: Spread, theirs: Spread) -> dict[str, float | None] | None:
    """The ratio of two means, and its bounds: our lowest over their highest, our highest over their lowest.

    None if theirs is nothing; `high` is None if their lowest is.
    """
    if not theirs["mean"]:
        return None
    high = ours["high"] / theirs["low"] if theirs["low"] else None
    return {"mean": ours["mean"] / theirs["mean"], "low": ours["low"] / theirs["high"], "high": high}


def strongest_plain(summaries: Mapping[str, Summary], milestone: int = -1) -> str | None:
    """The library of the best that finds most at a milestone; None if there is none among the methods."""
    plain = [name for name in summaries if PRESETS[name].evolution["method"] == "best"]
    return max(plain, key=lambda name: summaries[name][milestone][HEADLINE]["mean"], default=None)


def ratios(summaries: Mapping[str, Summary]) -> dict[str, dict[str, Any]]:
    """For each method, at the last milestone, the ratio of its headline to `paper` and to the strongest `plain`."""
    others = {"paper": PAPER if PAPER in summaries else None, "plain": strongest_plain(summaries)}
    return {
        name: {
            over: ratio(own[-1][HEADLINE], summaries[other][-1][HEADLINE])
            for over, other in others.items()
            if other is not None
        }
        for name, own in summaries.items()
    }


def factors(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> dict[str, float] | None:
    """Where the ratio of two headlines comes from: that of each figure as a share of the one before, of the means.

    Their product is the ratio itself; None if theirs has a figure of 0.
    """
    chain = FIGURES[: FIGURES.index(HEADLINE) + 1]
    if not all(theirs[name]["mean"] for name in chain):
        return None
    quotients = [ours[name]["mean"] / theirs[name]["mean"] for name in chain]
    return {
        name: after / before if before else 0.0
        for name, before, after in zip(chain, [1.0, *quotients], quotients, strict=False)
    }


def held_against(aims: Sequence[Aim], summaries: Mapping[str, Summary]) -> list[dict[str, Any]]:
    """Those aims that these methods and evaluations can tell something about.

    Returns:
        For each `at`, `over`, `least`, `found`, `reached`, and `text`, a sentence.
    """
    if DEFAULT not in summaries:
        return []
    places = {entry["evaluations"]: place for place, entry in enumerate(summaries[DEFAULT])}
    verdicts = []
    for aim in aims:
        if (place := places.get(aim.at)) is None:
            continue
        ours = summaries[DEFAULT][place]
        if aim.over is None:
            verdicts.append(_share(aim, ours[SHARE]))
            continue
        other = strongest_plain(summaries, place) if aim.over == "plain" else PAPER
        if other is None or other not in summaries:
            continue
        if (found := ratio(ours[HEADLINE], summaries[other][place][HEADLINE])) is not None:
            verdicts.append(_ratio(aim, other, found, ours[HEADLINE]["mean"]))
    return verdicts


def in_seconds(summaries: Mapping[str, Summary]) -> str | None:
    """What a design of the headline costs in processor time, the default first; None without the default."""
    costs = {name: own[-1]["cpu_s_each"]["mean"] for name, own in summaries.items()}
    if (ours := costs.pop(DEFAULT, None)) is None:
        return None
    others = [f"{name} {1000.0 * cost:.1f} ms, {cost / ours:.1f} times as much" for name, cost in costs.items() if cost]
    return (
        f"In processor time one costs {DEFAULT} {1000.0 * ours:.1f} ms"
        + "".join(f"; {other}" for other in others)
        + "."
    )


def _ratio(aim: Aim, other: str, found: Mapping[str, Any], mean: float) -> dict[str, Any]:
    reached = found["mean"] >= aim.least
    if not reached:
        end = f"missed by a factor of {aim.least / found['mean']:.2f}"
    elif found["low"] >= aim.least:
        end = "reached, by every seed against every seed"
    else:
        end = "reached on the mean, not by every seed against every seed"
    high = "" if found["high"] is None else f" to {found['high']:.1f}"
    text = (
        f"At {aim.at:,} evaluations {DEFAULT} finds {mean:,.0f} distinct, printable, crisp designs, "
        f"{found['mean']:.1f} times as many as {other} (seed against seed {found['low']:.1f}{high}). The aim, at least "
        f"{aim.least:g} times, is {end}."
    )
    return {"at": aim.at, "over": other, "least": aim.least, "found": found["mean"], "reached": reached, "text": text}


def _share(aim: Aim, found: Spread) -> dict[str, Any]:
    share = found["mean"] or 0.0
    reached = share > aim.least
    end = "reached" if reached else f"missed by {100 * (aim.least - share):.1f} points"
    text = (
        f"At {aim.at:,} evaluations {100 * share:.1f} % of these designs have three maps. The aim, above "
        f"{100 * aim.least:g} %, is {end}."
    )
    return {"at": aim.at, "over": None, "least": aim.least, "found": share, "reached": reached, "text": text}
