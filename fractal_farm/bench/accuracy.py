"""Errors on fractals whose dimensions are known, and the noise of scores, against their bounds (DESIGN section 3).

Every fractal is sampled at 5,000 independent points, turned at random, with several seeds; peers' rules see the same
clouds, some of the seeds. Noise is that of the same genome with other random numbers and other orientations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from fractal_farm.bench import discriminants
from fractal_farm.bench.genomes import random_genomes
from fractal_farm.bench.peer_rules import D0_RULES, D2_RULES, d0_by_rules, d2_by_rules
from fractal_farm.bench.truth import Fractal, classic, overlapping, separated
from fractal_farm.fitness import FitnessFormula, lyapunov_exponent, shape_descriptor
from fractal_farm.fitness.dimensions import measured
from fractal_farm.fitness.evaluation import POINTS
from fractal_farm.fitness.formula import fitness, numbers_of
from fractal_farm.ifs.genome import MAX_MAPS
from fractal_farm.ifs.random_iteration import attractor_points

FloatArray = npt.NDArray[np.float64]

SEEDS = 12
PEER_SEEDS = 4
NOISE_GENOMES = 200
NOISE_SEEDS = 20

# Of groups: rmse of D2; rmse of D0 and mean standard deviation over seeds.
_GROUP_BOUNDS = {
    "classic": (0.055, 0.22, 0.055),
    "separated, natural weights": (0.005, 0.045, 0.018),
    "separated, floored weights": (0.020, 0.09, 0.020),
    "overlapping": (0.015, 0.06, 0.025),
}
_LOW, _NEAR_TWO = 1.6, 2.05  # D2 up to which, and from which on, other bounds hold
_LOW_BIAS, _LOW_RMSE, _NEAR_TWO_RMSE, _HIGH_RMSE = 0.02, 0.03, 0.09, 0.12
_LLE_ERROR = 1e-12
_NOISE = 0.005
_NOT_GROUPED, _MERGED = 0.02, 0.01
_DISTINCT_SAMPLE = (3000, 8)  # random genomes, and their seed


@dataclass(frozen=True)
class Bound:
    """A promise and what was measured."""

    name: str
    value: float
    bound: float

    @property
    def met(self) -> bool:
        """Whether it is kept."""
        return self.value <= self.bound


def measure_accuracy(say: Callable[[str], None]) -> dict[str, Any]:
    """All tables and bounds; `say` hears of the progress.

    Returns:
        tables: title, columns and rows of each, as text and numbers; bounds: name, value, bound, met.
    """
    groups = {
        "classic": classic(),
        "separated, natural weights": separated("natural"),
        "separated, floored weights": separated("floored"),
        "overlapping": overlapping(),
    }
    errors = {}
    peers = {}
    for name, fractals in groups.items():
        say(f"farm bench: {len(fractals)} fractals, {name}")
        errors[name] = np.array([_errors(fractal) for fractal in fractals])
        peers[name] = np.array([_peer_errors(fractal) for fractal in fractals])
    say(f"farm bench: noise of {NOISE_GENOMES} random genomes")
    noise = _noise()
    grouped, merged = discriminants.rates(*_DISTINCT_SAMPLE)
    bounds = [
        *_dimension_bounds(groups, errors),
        _lle_bound(groups),
        _noise_bound(noise),
        Bound("copies of a design that count as another", 1.0 - grouped, _NOT_GROUPED),
        Bound("unrelated designs that count as one", merged, _MERGED),
    ]
    tables = (_rules_table(2, errors, peers), _rules_table(0, errors, peers), _sets_table(groups, errors))
    return {
        "tables": [*tables, _noise_table(noise)],
        "bounds": [asdict(bound) | {"met": bound.met} for bound in bounds],
    }


def _errors(fractal: Fractal) -> FloatArray:
    """(seeds, 2) errors of D0 and D2."""
    truth = (fractal.d0, fractal.d2)
    return np.array([np.subtract(measured(fractal.points(seed, POINTS))[:2], truth) for seed in range(SEEDS)])


def _peer_errors(fractal: Fractal) -> FloatArray:
    """(seeds, rules) errors of the D0 rules, then of the D2 rules."""
    rows = []
    for seed in range(PEER_SEEDS):
        points = fractal.points(seed, POINTS)
        d0 = np.subtract(d0_by_rules(points), fractal.d0)
        rows.append([*d0, *np.subtract(d2_by_rules(points, seed), fractal.d2)])
    return np.array(rows)


def _rules_table(dimension: int, errors: dict[str, FloatArray], peers: dict[str, FloatArray]) -> dict[str, Any]:
    """Bias, rmse and deviation of our rule and the peers', a column for each group."""
    column = 0 if dimension == 0 else 1
    names = D0_RULES if dimension == 0 else D2_RULES
    first = 0 if dimension == 0 else len(D0_RULES)
    rows = [["fractal farm", *(_summary(errors[group][..., column]) for group in errors)]]
    for k, name in enumerate(names):
        rows.append([name, *(_summary(peers[group][..., first + k]) for group in peers)])
    title = f"D{dimension} at {POINTS:,} points: mean error / rmse / standard deviation over seeds"
    return {"title": title, "columns": ["rule", *errors], "rows": rows}


def _sets_table(groups: dict[str, tuple[Fractal, ...]], errors: dict[str, FloatArray]) -> dict[str, Any]:
    rows = [
        [fractal.name, f"{fractal.d0:.3f}", _summary(error[:, 0]), f"{fractal.d2:.3f}", _summary(error[:, 1])]
        for fractal, error in zip(groups["classic"], errors["classic"], strict=True)
    ]
    return {"title": "The classic sets", "columns": ["set", "D0", "error", "D2", "error"], "rows": rows}


def _summary(errors: FloatArray) -> str:
    deviation = errors.std(axis=-1).mean()
    return f"{errors.mean():+.3f} / {_rms(errors):.3f} / {deviation:.3f}"


def _rms(errors: FloatArray) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def _dimension_bounds(groups: dict[str, tuple[Fractal, ...]], errors: dict[str, FloatArray]) -> list[Bound]:
    bounds = []
    for name, (d2_rmse, d0_rmse, d0_deviation) in _GROUP_BOUNDS.items():
        d0, d2 = errors[name][..., 0], errors[name][..., 1]
        bounds += [Bound(f"D2 rmse, {name}", _rms(d2), d2_rmse), Bound(f"D0 rmse, {name}", _rms(d0), d0_rmse)]
        bounds.append(Bound(f"D0 deviation over seeds, {name}", float(d0.std(axis=1).mean()), d0_deviation))
    single = [name for name in groups if name != "overlapping"]  # whose closed form holds only almost everywhere
    truths = np.array([fractal.d2 for name in single for fractal in groups[name]])
    each = np.concatenate([errors[name][..., 1] for name in single])
    bias, rmse = np.abs(each.mean(axis=1)), np.sqrt((each**2).mean(axis=1))
    low, high = truths <= _LOW, truths > _NEAR_TWO
    return [
        *bounds,
        Bound(f"worst D2 bias of a set up to {_LOW}", float(bias[low].max()), _LOW_BIAS),
        Bound(f"worst D2 rmse of a set up to {_LOW}", float(rmse[low].max()), _LOW_RMSE),
        Bound("worst D2 rmse of a set near 2", float(rmse[~low & ~high].max()), _NEAR_TWO_RMSE),
        Bound("worst D2 rmse of a set above", float(rmse[high].max()), _HIGH_RMSE),
    ]


def _lle_bound(groups: dict[str, tuple[Fractal, ...]]) -> Bound:
    """By tangent growth, as for any affine maps, against the closed form of similarities."""
    fractals = [fractal for group in groups.values() for fractal in group if len(fractal.ratios) <= MAX_MAPS]
    worst = max(abs(lyapunov_exponent(fractal.genome()) - fractal.lle) for fractal in fractals)
    return Bound(f"worst LLE of {len(fractals)} sets, nats", worst, _LLE_ERROR)


def _noise() -> dict[str, FloatArray]:
    """Standard deviations for each random genome.

    Returns:
        seeds: of fitness over seeds, each turned at random; orientations: of one cloud over orientations;
        descriptor: root mean square distance of descriptors from their mean, over the seeds.
    """
    genes, n_maps = random_genomes(NOISE_GENOMES, seed=7)
    turns: FloatArray = Rotation.random(NOISE_SEEDS, random_state=7).as_matrix()
    formula = numbers_of(FitnessFormula())
    by_seed, by_orientation, descriptors = [], [], []
    for table, n in zip(genes, n_maps, strict=True):
        lle = lyapunov_exponent(table[:n])

        def score(points: FloatArray, lle: float = lle) -> float:
            d0, d2 = measured(points)[:2]
            return float(fitness(d0, d2, lle, formula))

        clouds = [attractor_points(table[:n], POINTS, "repeat", k) for k in range(NOISE_SEEDS)]
        by_seed.append(np.std([score(cloud @ turn) for cloud, turn in zip(clouds, turns, strict=True)]))
        by_orientation.append(np.std([score(clouds[0] @ turn) for turn in turns]))
        shapes = np.array([shape_descriptor(cloud) for cloud in clouds], np.float64)
        descriptors.append(np.sqrt(shapes.var(axis=0).sum()))
    return {
        "seeds": np.array(by_seed),
        "orientations": np.array(by_orientation),
        "descriptor": np.array(descriptors),
    }


def _noise_table(noise: dict[str, FloatArray]) -> dict[str, Any]:
    names = {
        "seeds": "fitness, over seeds and orientations",
        "orientations": "fitness, over orientations alone",
        "descriptor": "descriptor, distance from its mean over seeds",
    }
    rows = [[names[key], *(f"{value:.4f}" for value in _quantiles(values))] for key, values in noise.items()]
    title = f"Standard deviation of {NOISE_GENOMES} random genomes, {NOISE_SEEDS} clouds each"
    return {"title": title, "columns": ["of", "median", "90 %", "largest"], "rows": rows}


def _quantiles(values: FloatArray) -> Sequence[float]:
    return [float(q) for q in np.quantile(values, (0.5, 0.9, 1.0))]


def _noise_bound(noise: dict[str, FloatArray]) -> Bound:
    return Bound("fitness noise, median", _quantiles(noise["seeds"])[0], _NOISE)
