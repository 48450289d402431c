"""Designs by description: how like a star, a ribbon or a conch a shape is, from what can be measured of it.

Each word stands for a few features of the shape's even points, or of its maps, each with a soft limit; the score of a
word is their geometric mean, 0 to 1, so that a design must have all of them. `Likeness` tells each feature's value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError
from fractal_farm.ifs.even_points import even_points
from fractal_farm.ifs.genome import Genome, as_genome
from fractal_farm.ifs.maps import resolved_maps

FloatArray = npt.NDArray[np.float64]

N_POINTS = 1_000
_FOLDS = range(3, 13)
_TRIED = 4  # numbers of rays whose symmetry is measured
_SECTORS = 72
_CLOSE = 0.10  # mean distance of a shape from itself, turned, over its radius, that is half as good as none


@dataclass(frozen=True)
class Features:
    """What is measured of a shape.

    Attributes:
        elongation: 1 - s2 / s1, of the principal standard deviations s1 >= s2 >= s3.
        flatness: 1 - s3 / s2.
        thickness: s3 / s1.
        fold: the number n from 3 to 12 for which turning by 360/n degrees about a principal axis changes it least.
        symmetry: how little, 0 to 1.
        rays: how much farther the shape reaches in n directions about that axis than between them, 0 to 1.
        disc: how flat it is along that axis, 1 - s_axis / s_across.
        spiral_turns: turns of the largest map until it has shrunk tenfold.
        spiral_share: share of the largest map in the sum of contraction ratios.
        spiral_step: degrees by which the largest map turns, 0 to 180.
    """

    elongation: float
    flatness: float
    thickness: float
    fold: int
    symmetry: float
    rays: float
    disc: float
    spiral_turns: float
    spiral_share: float
    spiral_step: float


@dataclass(frozen=True)
class Likeness:
    """How well a description fits.

    Attributes:
        score: 0 to 1.
        parts: each feature that counts, in words, and its share of the score, 0 to 1.
    """

    score: float
    parts: Mapping[str, float]

    def explained(self) -> str:
        """The parts in one line, the weakest first."""
        return ", ".join(f"{name} {value:.2f}" for name, value in sorted(self.parts.items(), key=lambda part: part[1]))


def _star(f: Features) -> dict[str, float]:
    return {
        f"{f.fold}-fold symmetry": f.symmetry,
        "rays": f.rays,
        "four rays or more": 1.0 if f.fold > 3 else 0.5,
        "not drawn out along its axis": _above(f.disc, -0.2, 0.3),
    }


def _snowflake(f: Features) -> dict[str, float]:
    six = 1.0 if f.fold == 6 else 0.1 if f.fold in (3, 12) else 0.02
    return {"six rays": six, f"{f.fold}-fold symmetry": f.symmetry, "rays": f.rays, "flat": _above(f.disc, 0.2, 0.8)}


def _ribbon(f: Features) -> dict[str, float]:
    return {
        "long": _above(f.elongation, 0.3, 0.75),
        "thin": _below(f.thickness, 0.05, 0.3),
        "flat": _above(f.flatness, 0, 0.5),
    }


def _conch(f: Features) -> dict[str, float]:
    return {
        "winding": _above(f.spiral_turns, 0.4, 1.0) * _below(f.spiral_turns, 3.0, 8.0),
        "steps that follow each other": _below(f.spiral_step, 40.0, 90.0),
        "one spiral": _above(f.spiral_share, 0.5, 0.75),
        "a body": _below(f.elongation, 0.4, 0.9),
    }


def _ball(f: Features) -> dict[str, float]:
    return {"round": _above(f.thickness, 0.5, 0.95), "as wide as long": _below(f.elongation, 0.02, 0.4)}


def _disc(f: Features) -> dict[str, float]:
    return {"flat": _above(f.flatness, 0.3, 0.85), "as wide as long": _below(f.elongation, 0.05, 0.5)}


def _needle(f: Features) -> dict[str, float]:
    return {"long": _above(f.elongation, 0.5, 0.9), "round": _below(f.flatness, 0.1, 0.6)}


DESCRIPTIONS: dict[str, Callable[[Features], dict[str, float]]] = {
    "star": _star,
    "snowflake": _snowflake,
    "ribbon": _ribbon,
    "conch": _conch,
    "ball": _ball,
    "disc": _disc,
    "needle": _needle,
}
"""The words that are understood; `star-like` means the same as `star`."""


def checked_description(text: str) -> str:
    """The word of a description; raises InputError for one that is not understood."""
    word = text.strip().lower().removesuffix("like").rstrip("- ")
    if word not in DESCRIPTIONS:
        raise InputError(f"description {text!r} is not understood; say {', '.join(DESCRIPTIONS)}")
    return word


def likeness(features: Features, word: str) -> Likeness:
    """How well a word of `DESCRIPTIONS` fits a shape."""
    parts = DESCRIPTIONS[word](features)
    score = math.prod(max(0.0, value) for value in parts.values()) ** (1.0 / len(parts))
    return Likeness(score, parts)


def features_of(genome: Genome | npt.ArrayLike, n_points: int = N_POINTS) -> Features:
    """Measure a shape.

    Args:
        genome: a `Genome` or an (N, 7) array.
        n_points: even points to measure it by.

    Raises:
        InputError: an invalid genome.
    """
    valid = as_genome(genome)
    points = even_points(valid, n_points)
    centred = points - points.mean(axis=0)
    variances, axes = np.linalg.eigh(centred.T @ centred / len(points))
    s3, s2, s1 = np.sqrt(np.maximum(variances, 0.0))
    if s1 <= 0.0:
        return Features(0.0, 0.0, 0.0, 3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    own = centred @ axes  # columns along the axes of s3, s2, s1
    about = [_about(np.roll(own, -axis - 1, axis=1)) for axis in range(3)]  # that axis becomes the last
    best = max(range(3), key=lambda axis: about[axis][1] * (0.25 + about[axis][2]))
    fold, symmetry, rays = about[best]
    across = [s for axis, s in enumerate((s3, s2, s1)) if axis != best]
    turns, share, step = _spiral(valid)
    return Features(
        elongation=float(1.0 - s2 / s1),
        flatness=float(1.0 - s3 / s2) if s2 > 0.0 else 0.0,
        thickness=float(s3 / s1),
        fold=fold,
        symmetry=symmetry,
        rays=rays,
        disc=float(1.0 - (s3, s2, s1)[best] / max(min(across), 1e-12)),
        spiral_turns=turns,
        spiral_share=share,
        spiral_step=step,
    )


def _about(points: FloatArray) -> tuple[int, float, float]:
    """Fold, symmetry and rays of points (n, 3) about their last axis."""
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    radius = math.sqrt(float((points[:, :2] ** 2).sum(axis=1).mean())) or 1.0
    grain = float(np.median(tree.query(points, 2)[0][:, 1])) / radius  # an even sample does not meet itself exactly
    sample = points[:: max(1, len(points) // 250)]
    best = (3, 0.0, 0.0)
    profile = _reach(points)
    spectrum = np.abs(np.fft.rfft(profile - profile.mean())) ** 2
    strength = float(profile.std() / profile.mean()) if profile.mean() > 0.0 else 0.0
    harmonics = {fold: float(spectrum[fold::fold].sum() / max(spectrum[1:].sum(), 1e-12)) for fold in _FOLDS}
    for fold in sorted(_FOLDS, key=lambda n: -harmonics[n] - 0.02 * n)[:_TRIED]:
        angle = 2.0 * math.pi / fold
        c, s = math.cos(angle), math.sin(angle)
        turned = sample @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        apart = float(tree.query(turned)[0].mean()) / radius
        symmetry = 1.0 / (1.0 + (max(0.0, apart - 0.6 * grain) / _CLOSE) ** 2)
        rays = harmonics[fold] * _above(strength, 0.02, 0.25)
        # A body of revolution has every symmetry, and no rays.
        if symmetry * (0.25 + rays) > best[1] * (0.25 + best[2]):
            best = fold, symmetry, rays
    return best


def _reach(points: FloatArray) -> FloatArray:
    """How far points (n, 3) reach from the last axis, in each of 72 directions about it."""
    angles = np.arctan2(points[:, 1], points[:, 0])
    sectors = ((angles / (2.0 * math.pi) + 0.5) * _SECTORS).astype(np.int64) % _SECTORS
    reach = np.zeros(_SECTORS)
    np.maximum.at(reach, sectors, np.hypot(points[:, 0], points[:, 1]))
    return reach


def _spiral(genome: Genome) -> tuple[float, float, float]:
    """Turns in a tenfold shrinking, share, and step in degrees, of the largest map."""
    linear = resolved_maps(genome)[:, :, :3]
    ratios = np.cbrt(np.abs(np.linalg.det(linear)))
    largest = int(ratios.argmax())
    rho = float(ratios[largest])
    cosine = (float(np.trace(linear[largest])) / rho - 1.0) / 2.0
    angle = math.acos(min(1.0, max(-1.0, cosine)))
    turns = angle / (2.0 * math.pi) * math.log(10.0) / max(-math.log(rho), 1e-9)
    return turns, rho / float(ratios.sum()), math.degrees(angle)


def _above(value: float, none: float, full: float) -> float:
    """0 below `none`, 1 from `full` on, straight between."""
    return min(1.0, max(0.0, (value - none) / (full - none)))


def _below(value: float, full: float, none: float) -> float:
    """1 up to `full`, 0 from `none` on, straight between."""
    return 1.0 - _above(value, full, none)
