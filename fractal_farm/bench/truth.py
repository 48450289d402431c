"""Fractals whose dimensions are known in closed form, and independent random points on them.

For maps x -> rho R x + b with probabilities p, without overlap: sum rho^D0 = 1 (Moran 1946), sum p^2 rho^-D2 = 1, and
LLE = sum p ln rho. Points are drawn by random addresses in numpy, not by the package's random iteration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from fractal_farm.ifs.genome import Genome, Phenotype

FloatArray = npt.NDArray[np.float64]

_LARGEST_DIMENSION = 50.0
_RESOLUTION = 1e-7  # of points, relative to the attractor


@dataclass(frozen=True, eq=False)
class Fractal:
    """N similarities x -> rho R x + b with probabilities.

    Attributes:
        name: what it is called.
        ratios: (N,) float64 rho.
        rotations: (N, 3, 3) float64 R.
        shifts: (N, 3) float64 b.
        probabilities: (N,) float64, sum 1.
    """

    name: str
    ratios: FloatArray
    rotations: FloatArray
    shifts: FloatArray
    probabilities: FloatArray

    @property
    def d0(self) -> float:
        """Capacity dimension, at most 3."""
        return min(3.0, float(brentq(lambda s: np.sum(self.ratios**s) - 1.0, 0.0, _LARGEST_DIMENSION)))

    @property
    def d2(self) -> float:
        """Correlation dimension, at most 3."""
        squares = self.probabilities**2
        return min(3.0, float(brentq(lambda t: np.sum(squares * self.ratios**-t) - 1.0, 0.0, _LARGEST_DIMENSION)))

    @property
    def lle(self) -> float:
        """Largest Lyapunov exponent, nats per iteration."""
        return float(np.sum(self.probabilities * np.log(self.ratios)))

    def genome(self) -> Genome:
        """The same as an affine genome with probabilities set by hand; of 8 maps at most."""
        rows = np.concatenate([self.ratios[:, None, None] * self.rotations, self.shifts[:, :, None]], axis=2)
        return Genome(rows.reshape(-1, 12), Phenotype(family="affine"), tuple(self.probabilities.tolist()))

    def points(self, seed: int, n: int = 5000) -> FloatArray:
        """(n, 3) float64 independent points, turned at random."""
        generator = np.random.default_rng(seed)
        depth = math.ceil(math.log(_RESOLUTION) / math.log(self.ratios.max()))
        linear = self.ratios[:, None, None] * self.rotations
        points = np.zeros((n, 3))
        for _ in range(depth):
            k = generator.choice(len(self.ratios), n, p=self.probabilities)
            points = np.einsum("nij,nj->ni", linear[k], points) + self.shifts[k]
        turn: FloatArray = Rotation.random(random_state=seed).as_matrix()
        return points @ turn.T


def _fractal(name: str, ratio: float, corners: npt.ArrayLike, rotations: FloatArray | None = None) -> Fractal:
    shifts = np.asarray(corners, dtype=np.float64)
    n = len(shifts)
    identity = np.repeat(np.eye(3)[None], n, axis=0)
    return Fractal(name, np.full(n, ratio), identity if rotations is None else rotations, shifts, np.full(n, 1.0 / n))


def _turn_z(*degrees: float) -> FloatArray:
    matrices: FloatArray = Rotation.from_euler("z", np.array(degrees)[:, None], degrees=True).as_matrix()
    return matrices


@cache
def classic() -> tuple[Fractal, ...]:
    """Eleven sets of the textbooks, with equal weights."""
    corners = np.array(list(product((0, 1), repeat=3)))
    tetrahedron = np.array(
        [(0, 0, 0), (1, 0, 0), (0.5, math.sqrt(3) / 2, 0), (0.5, math.sqrt(3) / 6, math.sqrt(2 / 3))]
    )
    sponge = np.array([c for c in product(range(3), repeat=3) if c.count(1) < 2])
    third = 1 / 3
    koch = [(0, 0, 0), (third, 0, 0), (0.5, math.sqrt(3) / 6, 0), (2 * third, 0, 0)]
    return (
        _fractal("Cantor set", third, [(0, 0, 0), (2 * third, 0, 0)]),
        _fractal("Cantor dust 1/3", third, corners * 2 * third),
        _fractal("Cantor dust 1/4", 0.25, corners * 0.75),
        _fractal("Sierpinski tetrahedron", 0.5, tetrahedron / 2),
        _fractal("Sierpinski gasket", 0.5, tetrahedron[:3] / 2),
        _fractal("Menger sponge", third, sponge / 3),
        _fractal("line", 0.5, [(0, 0, 0), (0.5, 0, 0)]),
        _fractal("square", 0.5, [(a / 2, b / 2, 0) for a, b in product((0, 1), repeat=2)]),
        _fractal("cube", 0.5, corners / 2),
        _fractal("Koch curve", third, koch, _turn_z(0, 60, -60, 0)),
        _fractal("twindragon", math.sqrt(0.5), [(0, 0, 0), (0.5, -0.5, 0)], _turn_z(45, 45)),
    )


def floored(ratios: FloatArray, influence: float = 4.0) -> FloatArray:
    """Probabilities (N,) of ratios (N,) by eqs 3.3 and 3.4."""
    p: FloatArray = ratios**3 / np.sum(ratios**3)
    largest = int(np.argmax(p))
    floor = 1.0 / (influence * len(p))
    for i in range(len(p)):
        if i != largest and p[i] < floor:
            p[largest] += p[i] - floor
            p[i] = floor
    return p


@cache
def separated(weights: str) -> tuple[Fractal, ...]:
    """Sixteen random systems of 2 or 3 similarities whose pieces lie in disjoint balls.

    Args:
        weights: "natural" (p = rho^D0, so that D2 = D0) or "floored" (eqs 3.3 and 3.4).
    """
    generator = np.random.default_rng(7)
    found: list[Fractal] = []
    while len(found) < 16:
        n = 2 + len(found) // 8
        system = _random_system(generator, n, 0.2, 0.7)
        if system.d0 > (0.7 if n == 2 else 1.0) and _in_disjoint_balls(system):
            natural = system.ratios**system.d0
            found.append(system if weights == "floored" else replace(system, probabilities=natural / natural.sum()))
    return tuple(found)


@cache
def overlapping() -> tuple[Fractal, ...]:
    """Thirty random systems whose pieces overlap: the closed forms hold for almost every one of them (Falconer)."""
    generator = np.random.default_rng(11)
    found: list[Fractal] = []
    while len(found) < 30:
        system = _random_system(generator, 2 if len(found) < 10 else 3, 0.3, 0.62)
        if system.d0 < 2.6 and not _in_disjoint_balls(system):
            found.append(system)
    return tuple(found)


def _random_system(generator: np.random.Generator, n: int, smallest: float, largest: float) -> Fractal:
    ratios = generator.uniform(smallest, largest, n)
    rotations = Rotation.random(n, random_state=generator).as_matrix()
    return Fractal(f"random of {n}", ratios, rotations, generator.uniform(-2, 2, (n, 3)), floored(ratios))


def _in_disjoint_balls(system: Fractal) -> bool:
    """Whether the images of one invariant ball are disjoint: then there is no overlap."""
    linear = system.ratios[:, None, None] * system.rotations
    fixed = np.linalg.solve(np.eye(3) - linear, system.shifts[..., None])[..., 0]
    centre = fixed.mean(axis=0)
    for _ in range(100):
        images = linear @ centre + system.shifts
        radii = np.linalg.norm(images - centre, axis=1) / (1 - system.ratios)
        centre = centre + 0.05 * (images[radii.argmax()] - centre)
    images = linear @ centre + system.shifts
    radius = np.max(np.linalg.norm(images - centre, axis=1) / (1 - system.ratios))
    return all(
        np.linalg.norm(images[i] - images[j]) > 1.0001 * radius * (system.ratios[i] + system.ratios[j])
        for i in range(len(images))
        for j in range(i)
    )
