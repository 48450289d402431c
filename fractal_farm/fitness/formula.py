"""The paper's fitness function, eq 3.7: a Gaussian of D0, D2 and LLE, clipped to [0, 1].

    fit = amplitude exp(-[(D0/3 - c0)^2 / (2 s0^2) + (D2/3 - c2)^2 / (2 s2^2) + (LLE - cl)^2 / (2 sl^2)]) + baseline

Every constant is a field. The centre of the D2 term and the sign in the LLE term are not legible in the paper; the
defaults are calibrated, as NOTES explains.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import astuple, dataclass
from typing import NamedTuple

from fractal_farm.errors import InputError
from fractal_farm.ifs.kernel import kernel

EVALUATOR_VERSION = "scores-1"
"""Changes whenever the scores of a genome do, whatever the constants."""


@dataclass(frozen=True)
class FitnessFormula:
    """The constants of eq 3.7.

    Attributes:
        amplitude: height of the Gaussian.
        baseline: added to it.
        d0: (centre, width) of D0 / 3.
        d2: (centre, width) of D2 / 3.
        lle: (centre, width) of LLE, nats per iteration.
    """

    amplitude: float = 1.493
    baseline: float = -0.5
    d0: tuple[float, float] = (0.334, 0.840)
    d2: tuple[float, float] = (0.5, 0.698)
    lle: tuple[float, float] = (-0.057, 1.092)

    def __post_init__(self) -> None:
        for name in ("d0", "d2", "lle"):
            pair = getattr(self, name)
            if len(pair) != 2 or not all(map(math.isfinite, pair)) or pair[1] <= 0.0:
                raise InputError(f"formula: {name} is {pair}; give (centre, width), finite, the width above 0")
        if not (math.isfinite(self.amplitude) and math.isfinite(self.baseline)):
            raise InputError(f"formula: amplitude {self.amplitude}, baseline {self.baseline}; give finite numbers")

    @property
    def identity(self) -> str:
        """What scores rest on besides genome and number of points: the evaluator's version, a hash of the constants."""
        constants = json.dumps(astuple(self)).encode()
        return f"{EVALUATOR_VERSION}-{hashlib.blake2b(constants, digest_size=4).hexdigest()}"


class FormulaNumbers(NamedTuple):
    """A `FitnessFormula` in the plain numbers that kernels take."""

    amplitude: float
    baseline: float
    d0: tuple[float, float]
    d2: tuple[float, float]
    lle: tuple[float, float]


def numbers_of(formula: FitnessFormula) -> FormulaNumbers:
    """The formula as plain float64."""
    return FormulaNumbers(
        float(formula.amplitude),
        float(formula.baseline),
        (float(formula.d0[0]), float(formula.d0[1])),
        (float(formula.d2[0]), float(formula.d2[1])),
        (float(formula.lle[0]), float(formula.lle[1])),
    )


@kernel
def fitness(d0, d2, lle, formula):
    """Eq 3.7 of one design; `formula` is a `FormulaNumbers`."""
    distance = _term(d0 / 3.0, formula.d0) + _term(d2 / 3.0, formula.d2) + _term(lle, formula.lle)
    return min(1.0, max(0.0, formula.amplitude * math.exp(-distance) + formula.baseline))


@kernel
def _term(value, centre_and_width):
    centre, width = centre_and_width
    return (value - centre) * (value - centre) / (2.0 * width * width)
