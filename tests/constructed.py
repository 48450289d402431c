"""Genomes whose shape is known by construction."""

from __future__ import annotations

import math

import numpy as np

from fractal_farm.ifs.genome import Genome


def gene(rotation: np.ndarray, rho: float, offset: object) -> list[float]:
    """The row of the map x -> rho R x + offset."""
    pitch = math.asin(float(np.clip(rotation[2, 1], -1, 1)))
    roll = math.atan2(-rotation[0, 1], rotation[1, 1])
    yaw = math.atan2(-rotation[2, 0], rotation[2, 2])
    return [pitch, yaw, roll, rho, *(rotation.T @ np.asarray(offset, float) / rho)]


def about_z(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def star(rays: int, turn: float = 0.0) -> Genome:
    """Flat, of `rays` straight rays: a large map that turns by one ray, and a row of small ones along the first."""
    rows = [gene(about_z(2 * math.pi / rays), 0.97, [0, 0, 0])]
    rows += [gene(np.eye(3), 0.12, [x, 0, 0]) for x in (0.55, 0.7, 0.85)]
    return turned(Genome(np.array(rows)), turn)


def ribbon(turn: float = 0.0) -> Genome:
    """A strip of 1 by 0.2 without thickness, out of ten squares less the inner ones: 2 x 4 maps."""
    rows = [gene(np.eye(3), 0.25, [x, y, 0]) for x in (0, 0.25, 0.5, 0.75) for y in (0, 0.03)]
    return turned(Genome(np.array(rows)), turn)


def conch(turn: float = 0.0) -> Genome:
    """A spiral: a map of ratio 0.9 that turns by 25 degrees, and a small one."""
    rows = [gene(about_z(math.radians(25)), 0.9, [0, 0, 0.03]), gene(np.eye(3), 0.2, [0.8, 0, 0])]
    return turned(Genome(np.array(rows)), turn)


def ball() -> Genome:
    """The eight corners of a cube, half filled: as long as wide as high."""
    return Genome(np.array([gene(np.eye(3), 0.45, [x, y, z]) for x in (0, 0.55) for y in (0, 0.55) for z in (0, 0.55)]))


def turned(genome: Genome, angle: float) -> Genome:
    """The same shape turned about an oblique axis: each map conjugated."""
    if angle == 0.0:
        return genome
    from scipy.spatial.transform import Rotation

    from fractal_farm.ifs.maps import resolved_maps

    whole = Rotation.from_rotvec(angle * np.array([0.6, 0.48, 0.64])).as_matrix()
    rows = []
    for linear, rho in zip(resolved_maps(genome), genome.genes[:, 3], strict=True):
        rows.append(gene(whole @ (linear[:, :3] / rho) @ whole.T, float(rho), whole @ linear[:, 3]))
    return Genome(np.array(rows))
