"""Attractors with known geometry, and random ones."""

import itertools

import numpy as np

from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.similarity_dimension import solve_moran


def lattice(ratio, step, axes=3):
    """2^axes maps x -> ratio (x + d), d on the corners of a cube of edge `step`: a Cantor dust, or a cube."""
    corners = itertools.product((0.0, step), repeat=axes)
    return np.array([[0, 0, 0, ratio, *corner, *[0.0] * (3 - axes)] for corner in corners])


UNIT_CUBE = lattice(1 / 2, 1.0)
CANTOR_SET = lattice(1 / 3, 2.0, axes=1)
CANTOR_SQUARE = lattice(1 / 3, 2.0, axes=2)
TETRAHEDRON = np.array([[0, 0, 0, 0.5, *v] for v in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1.0))])


def random_genome(seed, similarity_dimension=(1.0, 3.0)):
    """A random genome of two or three maps, in the ranges of the paper."""
    rng = np.random.default_rng(seed)
    while True:
        n = int(rng.integers(2, 4))
        angles = rng.uniform(-np.pi, np.pi, (n, 3))
        ratios = rng.uniform(0.05, 0.97, (n, 1))
        if similarity_dimension[0] < solve_moran(ratios[:, 0].tolist()) < similarity_dimension[1]:
            return np.hstack([angles, ratios, rng.uniform(-2, 2, (n, 3))])


def random_affine_genome(seed):
    """Three random affine maps with spectral norms of 0.4 to 0.8."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(3):
        linear = rng.normal(size=(3, 3))
        linear *= rng.uniform(0.4, 0.8) / np.linalg.norm(linear, 2)
        rows.append(np.column_stack([linear, rng.uniform(-2, 2, 3)]).ravel())
    return Genome(np.array(rows), Phenotype(family="affine"))
