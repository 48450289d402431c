"""What the figures say: fig 4, fig 5 with its tests, and which reading fits the paper best."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

from fractal_farm.bench.genomes import TABLE1
from fractal_farm.experiments.paper.cases import CASES, Reading, Scale
from fractal_farm.fitness import FitnessFormula, evaluate
from fractal_farm.ifs.genome import Genome

Figures = Mapping[str, Any]

ABOVE = 0.8
SECONDS = {"case1": 332.48, "case2": 441.42, "case3": 1072.35}
"""The paper's running times for 100, 100 and 150 fractals."""
EACH_S = 7.15
EACH_EVALUATIONS = EACH_S / (SECONDS["case2"] / 100)
"""Evaluations for an accepted offspring: the paper's seconds for it over those for a random fractal."""


def fig4(found: Figures) -> dict[str, Any]:
    """Mean fitness of accepted offspring: for each generation the mean and standard deviation of the experiments."""
    mean = np.array(found["mean"])
    course = mean.mean(axis=0)
    return {
        "mean": course.tolist(),
        "sd": _sd(mean).tolist(),
        "lowest": float(course.min()),
        "above": int((course > ABOVE).sum()),
        "generations": len(course),
        "evaluations_each": float(np.sum(found["evaluated"]) / np.sum(found["accepted"])),
    }


def fig5(found: Mapping[str, Figures]) -> dict[str, Any]:
    """Of each case mean fitness and share of excellent; and whether each is above that of the case before.

    The confidence is that of the weakest of the four steps: 1 - p, p being the larger of a one-sided Welch test and of
    a one-sided Mann-Whitney test of the experiments, times four (Bonferroni).
    """
    measures = {case: _measures(found[case]) for case in CASES}
    steps = [
        (measures[before][name], measures[after][name])
        for before, after in itertools.pairwise(CASES)
        for name in ("fitness", "excellent")
    ]
    return {
        "cases": {
            case: {name: [float(np.mean(values)), float(_sd(values))] for name, values in measures[case].items()}
            | {name: found[case][name] for name in ("seconds", "evaluation_s")}
            | {"evaluations": float(np.sum(found[case]["evaluated"], axis=1).mean())}
            for case in CASES
        },
        **{f"cut_{name}": float(np.mean(values)) for name, values in _measures(found["case3"]["founders"]).items()},
        "each_s": found["case3"]["evaluation_s"] * fig4(found["case3"])["evaluations_each"],
        "ordered": all(np.mean(before) < np.mean(after) for before, after in steps),
        "confidence": max(0.0, 1.0 - len(steps) * max(_p_value(*step) for step in steps)),
    }


def _measures(found: Figures) -> dict[str, npt.NDArray[np.float64]]:
    """Of each experiment: mean fitness, and the share above the threshold of excellent fractals."""
    accepted = np.array(found["accepted"])
    total = np.maximum(accepted.sum(axis=1), 1)
    return {
        "fitness": (np.array(found["mean"]) * accepted).sum(axis=1) / total,
        "excellent": np.sum(found["qualified"], axis=1) / total,
    }


def _p_value(low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]) -> float:
    """Of the hypothesis that `high` is not above `low`."""
    if len(low) < 2 or np.ptp(low) + np.ptp(high) == 0.0:
        return 1.0
    welch = stats.ttest_ind(low, high, equal_var=False, alternative="less").pvalue
    ranks = stats.mannwhitneyu(low, high, alternative="less").pvalue
    return float(max(welch, ranks))


def _sd(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.asarray(np.std(values, axis=0, ddof=1 if len(values) > 1 else 0))


def table1_scores(reading: Reading, scale: Scale) -> list[dict[str, float]]:
    """D0, D2, LLE and fitness of the paper's four genomes."""
    evolution = reading.config("case3", scale).evolution
    genomes = [Genome(np.array(rows), evolution.phenotype.phenotype()) for rows in TABLE1.values()]
    scores = evaluate(genomes, evolution.phenotype.points, FitnessFormula(**evolution.fitness.model_dump()))
    names = ("d0", "d2", "lle", "fitness")
    return [{name: float(getattr(scores, name)[k]) for name in names} for k in range(len(genomes))]


def compared(reading: Reading, found: Mapping[str, Figures], scale: Scale) -> dict[str, Any]:
    """How a reading agrees with what the paper reports."""
    four, five = fig4(found["case3"]), fig5(found)
    scores = [score["fitness"] for score in table1_scores(reading, scale)]
    survive = sum(score >= reading.config("case3", scale).evolution.elimination for score in scores)
    agrees = [four["above"] == four["generations"], five["ordered"], survive == len(scores)]
    return {
        "name": reading.name,
        "about": reading.about,
        **{name: four[name] for name in ("lowest", "above", "generations", "evaluations_each")},
        "course": float(np.mean(four["mean"])),
        **{name: five[name] for name in ("cases", "ordered", "confidence", "cut_fitness", "cut_excellent")},
        "table1": scores,
        "survive": survive,
        "agrees": sum(agrees),
        "like_table1": found["case3"].get("like_table1"),
    }


def best_fit(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The reading that agrees in most, and of these the one whose cost of an offspring is nearest to the paper's."""
    return min(rows, key=lambda row: (-row["agrees"], abs(math.log(row["evaluations_each"] / EACH_EVALUATIONS))))
