"""When two designs are different: six numbers a design, in units of what chance does to them (DESIGN section 8).

The numbers of a descriptor are noisy to different degrees, and together: where one quantile of a cloud comes out large
its neighbours do. So they are not compared as they are. The signature holds their linear discriminants (Fisher 1936):
of all directions in the space of descriptor, D0 and D2, those in which designs differ most, measured by how far two
clouds of the same design lie apart. Two designs are *distinct* if their signatures are at least 1 apart. Of random
qualified designs, 98 % of the copies with other random numbers, and less than 1 % of unrelated pairs, are nearer.

Sums run in a fixed order, since they decide what is kept.
"""

from __future__ import annotations

import functools
import importlib.resources
import json

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError

FloatArray = npt.NDArray[np.float64]

DESCRIPTOR_LENGTH = 14
LENGTH = 6
DISTINCT = 1.0  # distance at and above which two designs are distinct


def signatures(descriptors: npt.ArrayLike, d0: npt.ArrayLike, d2: npt.ArrayLike) -> FloatArray:
    """Signatures of designs.

    Args:
        descriptors: (n, 14) real, see `fitness.shape_descriptor`.
        d0: (n,) capacity dimensions.
        d2: (n,) correlation dimensions.

    Returns:
        (n, 6) float64; nan where a number is.

    Raises:
        InputError: shapes that do not fit.
    """
    shapes = np.asarray(descriptors, np.float64)
    dimensions = np.asarray(d0, np.float64), np.asarray(d2, np.float64)
    n = len(shapes)
    if shapes.shape != (n, DESCRIPTOR_LENGTH) or any(values.shape != (n,) for values in dimensions):
        raise InputError(f"descriptors: shape {shapes.shape}; give (n, {DESCRIPTOR_LENGTH}), and n values of D0 and D2")
    features = [*np.ascontiguousarray(shapes.T), *dimensions]
    result = np.zeros((n, LENGTH))
    for column, weights in enumerate(projection()):
        for weight, feature in zip(weights, features, strict=True):
            result[:, column] += weight * feature
    return result


def squared_distances(one: FloatArray, many: FloatArray) -> FloatArray:
    """Squared distances (n,) of one signature (6,) from many (n, 6)."""
    total = np.zeros(len(many))
    for column in range(LENGTH):
        difference = many[:, column] - one[column]
        total += difference * difference
    return total


@functools.cache
def projection() -> tuple[tuple[float, ...], ...]:
    """The discriminants: six rows of sixteen weights."""
    text = importlib.resources.files("fractal_farm").joinpath("distinctness.json").read_text()
    return tuple(tuple(row) for row in json.loads(text)["projection"])
