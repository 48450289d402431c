"""What somebody likes, learned from his judgements: a ridge regression of grades on the features of designs.

It re-ranks and decides nothing. How good it is, is measured where it has not looked: over repeated cross-validation,
the share of pairs of judged designs whose order it tells, beside that of fitness alone. The intervals are of the
jackknife over designs (Efron 1981), 1.4 times as wide: it does not see that other judgements would also have given
another model, and with people who toss coins the share varies 1.2 to 1.5 times as much as it says. Below 30 judgements
there is no model.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from fractal_farm.catalogue import Catalogue, judgements
from fractal_farm.errors import InputError
from fractal_farm.hand.features import COLUMNS, NAMED, features_of

FloatArray = npt.NDArray[np.float64]

LEAST_JUDGEMENTS = 30
_FOLDS = 5
_REPEATS = 20
_PENALTIES = tuple(10.0**k for k in np.arange(-1.0, 4.5, 0.5))
_NORMAL_95 = 1.959964
_WIDENED = 1.4


class Interval(NamedTuple):
    """An estimate with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Preference:
    """A fitted model.

    Attributes:
        judged: designs that it has learned from.
        accuracy: share of pairs of designs it has not learned from whose order it tells.
        fitness_accuracy: the same of fitness.
        advantage: the difference of the two.
        looks_at: (feature, correlation of what it predicts with it), the strongest first.
        centre: (17,) means of the features.
        weights: (17,) stars for a unit of each feature.
        level: mean grade.
    """

    judged: int
    accuracy: Interval
    fitness_accuracy: Interval
    advantage: Interval
    looks_at: tuple[tuple[str, float], ...]
    centre: FloatArray
    weights: FloatArray
    level: float

    @property
    def verdict(self) -> str:
        """What it is worth, in words."""
        if self.accuracy.low <= 0.5:
            return "no better than chance on designs that it has not seen; do not go by it"
        if self.advantage.low <= 0.0:
            return "better than chance, and no better than fitness alone"
        return "better than chance, and better than fitness alone"

    @property
    def useful(self) -> bool:
        """Whether it is better than chance and than fitness alone."""
        return self.accuracy.low > 0.5 and self.advantage.low > 0.0

    def predict(self, features: FloatArray) -> FloatArray:
        """Stars (n,) that designs with these features (n, 17) would get; nan where a feature is."""
        predicted: FloatArray = self.level + (features - self.centre) @ self.weights
        return predicted


def preference_of(root: Path) -> Preference:
    """The model of a catalogue's judgements.

    Raises:
        InputError: not a catalogue, fewer than 30 judged designs, or all are judged alike.
        FarmError: a part or a judgement is damaged.
    """
    designs = Catalogue.open(root).designs(COLUMNS)
    grades = {identity: judgement.grade for identity, judgement in judgements(root).items()}
    judged = [grades.get(identity) is not None for identity in designs.column("design_id").to_pylist()]
    designs = designs.filter(pa.array(judged, pa.bool_())).sort_by("design_id")
    features = features_of(designs)
    known = np.isfinite(features).all(axis=1)
    marks = np.array([grades[identity] for identity in designs.column("design_id").to_pylist()], np.float64)
    try:
        return fit_preference(features[known], marks[known], designs.column("fitness").to_numpy()[known])
    except InputError as error:
        raise InputError(f"{root}: {error}; judge with `farm rate {root} ID --stars N`") from None


def with_preference(designs: Any, model: Preference) -> Any:
    """A table of designs, which has `features.COLUMNS`, with the column `preference`: the stars that they would get."""
    return designs.append_column("preference", pa.array(model.predict(features_of(designs)), from_pandas=True))


def fit_preference(features: FloatArray, grades: FloatArray, fitness: FloatArray) -> Preference:
    """Learn, and measure how much was learned.

    Args:
        features: (n, 17) float64, finite, in any fixed order of designs.
        grades: (n,) 0 to 5.
        fitness: (n,) of the same designs.

    Raises:
        InputError: n below 30, or equal grades only.
    """
    n = len(grades)
    if n < LEAST_JUDGEMENTS:
        raise InputError(
            f"{n} judged designs, {LEAST_JUDGEMENTS - n} short of the {LEAST_JUDGEMENTS} that a preference needs"
        )
    if np.ptp(grades) == 0.0:
        raise InputError(f"all {n} judged designs have {grades[0]:g} stars; a preference needs better and worse ones")
    compared, told, told_by_fitness = _held_out(features, grades, fitness)
    centre, weights, level = _ridge(features, grades)
    predicted = level + (features - centre) @ weights
    seen = [(name, _correlation(predicted, features[:, k])) for k, name in enumerate(NAMED)]
    return Preference(
        n,
        _share(told, compared, within=(0.0, 1.0)),
        _share(told_by_fitness, compared, within=(0.0, 1.0)),
        _share(told - told_by_fitness, compared, within=(-1.0, 1.0)),
        tuple(sorted(seen, key=lambda entry: (-abs(entry[1]), entry[0]))),
        centre,
        weights,
        level,
    )


def _held_out(
    features: FloatArray, grades: FloatArray, fitness: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """For each pair of designs, summed over the repetitions: whether they were compared, and how often told rightly.

    Two designs are compared when both are in the part that was held out, and their grades differ.

    Returns:
        Three symmetric (n, n) matrices: comparisons, right ones of the model, right ones of fitness.
    """
    n = len(grades)
    differs = np.sign(grades[:, None] - grades[None])
    by_fitness = _agreement(differs, fitness)
    compared, told = np.zeros((n, n)), np.zeros((n, n))
    for repeat in range(_REPEATS):
        fold = np.random.default_rng(repeat).permutation(n) % _FOLDS
        for held in range(_FOLDS):
            out = fold == held
            centre, weights, level = _ridge(features[~out], grades[~out])
            predicted = level + (features[out] - centre) @ weights
            pairs = np.ix_(out, out)
            compared[pairs] += differs[pairs] != 0.0
            told[pairs] += _agreement(differs[pairs], predicted)
    return compared, told, compared * by_fitness


def _agreement(differs: FloatArray, values: FloatArray) -> FloatArray:
    """Of pairs that differ: 1 where values have the same order, 0 where the opposite, 1/2 where they are equal."""
    agreement: FloatArray = np.abs(differs) * (1.0 + differs * np.sign(values[:, None] - values[None])) / 2.0
    return agreement


def _share(told: FloatArray, compared: FloatArray, within: tuple[float, float]) -> Interval:
    """Right comparisons over all, with the jackknife's interval: each design is left out in turn, with its pairs."""
    share = told.sum() / max(compared.sum(), 1.0)
    rest = np.maximum(compared.sum() - 2.0 * compared.sum(axis=0), 1.0)
    without = (told.sum() - 2.0 * told.sum(axis=0)) / rest
    n = len(without)
    error = np.sqrt((n - 1.0) / n * ((without - without.mean()) ** 2).sum())
    reach = _WIDENED * _NORMAL_95 * error
    low, high = np.clip([share - reach, share + reach], *within)
    return Interval(float(share), float(low), float(high))


def _ridge(features: FloatArray, grades: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Centre, weights and level; the penalty is the one with the least leave-one-out error, of the data given."""
    centre, level = features.mean(axis=0), float(grades.mean())
    spread = features.std(axis=0)
    scale = np.where(spread > 0.0, spread, np.inf)
    left, singular, right = np.linalg.svd((features - centre) / scale, full_matrices=False)
    projected = left.T @ (grades - level)
    best, weights = np.inf, np.zeros(features.shape[1])
    for penalty in _PENALTIES:
        shrunk = singular**2 / (singular**2 + penalty)
        leverage = (left**2) @ shrunk + 1.0 / len(grades)
        residuals = (grades - level - left @ (shrunk * projected)) / (1.0 - leverage)
        if (error := float((residuals**2).sum())) < best:
            best = error
            weights = right.T @ (singular / (singular**2 + penalty) * projected) / scale
    return centre, weights, level


def _correlation(first: FloatArray, second: FloatArray) -> float:
    if np.ptp(first) == 0.0 or np.ptp(second) == 0.0:
        return 0.0
    return float(np.corrcoef(first, second)[0, 1])
