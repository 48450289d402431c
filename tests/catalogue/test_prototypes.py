"""Prototypes of planted groups are members of them, one each, with the right sizes."""

from __future__ import annotations

import numpy as np
import pytest

from fractal_farm.catalogue.prototypes import prototypes
from fractal_farm.errors import InputError

SIZES = (500, 300, 120, 60, 20, 5, 1)


def planted(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Signatures (6, n) of groups far apart, in random order, and the group of each."""
    generator = np.random.default_rng(seed)
    centres = 100 * np.eye(7)[:, :6] + generator.normal(size=(7, 6))
    groups = generator.permutation(np.repeat(np.arange(7), SIZES))
    return (centres[groups] + generator.normal(size=(len(groups), 6))).T, groups


def test_each_planted_group_has_one_prototype_its_medoid() -> None:
    marks, groups = planted()
    found = prototypes(marks, 7)
    assert found.sizes.tolist() == list(SIZES)
    assert groups[found.medoids].tolist() == list(range(7))
    assert (found.group_of == groups).all()
    for group, (medoid, spread) in enumerate(zip(found.medoids, found.spreads, strict=True)):
        members = np.flatnonzero(groups == group)
        points = marks[:, members].astype(np.float32).astype(np.float64)
        squares = np.square(points[:, :, None] - points[:, None, :]).sum(axis=0).mean(axis=0)
        assert squares[members == medoid] == pytest.approx(squares.min(), rel=1e-5)
        assert spread == pytest.approx(np.sqrt(squares.min()), rel=1e-3, abs=1e-6)


def test_a_rare_shape_among_a_hundred_thousand_is_not_lost_and_all_are_assigned() -> None:
    generator = np.random.default_rng(1)
    marks = generator.normal(size=(6, 250_000))
    marks[:, 1::2] += 50  # a second group, which every sample contains
    marks[:, 7] = np.nan
    found = prototypes(marks, 2)
    assert sorted(found.sizes.tolist()) == [124_999, 125_000]
    assert found.group_of[7] == -1
    assert len(set(found.group_of[9::2].tolist())) == 1
    rare = generator.normal(size=(6, 5000))
    rare[:, 4321] += 500
    assert 4321 in prototypes(rare, 2).medoids


def test_there_are_no_more_prototypes_than_different_designs_and_none_of_nothing() -> None:
    assert len(prototypes(np.ones((6, 9)), 4).medoids) == 1
    assert prototypes(np.repeat(np.eye(6), 3, axis=1), 40).sizes.tolist() == [3] * 6
    with pytest.raises(InputError, match="no design has a descriptor"):
        prototypes(np.full((6, 3), np.nan), 4)
    with pytest.raises(InputError, match="at least 1"):
        prototypes(np.ones((6, 3)), 0)
