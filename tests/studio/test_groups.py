"""Groups: who is like whom, the same however late the designs came."""

import numpy as np
import pytest

from fractal_farm.distinctness import DISTINCT, first_of_each_shape
from fractal_farm.studio.columns import COLUMNS, Maps, encoded, encoded_bytes, id_bytes
from fractal_farm.studio.groups import Groups, group_sizes


@pytest.fixture
def marks():
    found = np.random.default_rng(5).uniform(0.0, 2.5, (600, 6))
    found[[3, 77, 501]] = np.nan
    return found


def test_the_first_of_each_shape_stands_for_those_that_are_like_it(marks):
    found = Groups().add(marks)
    first = found == np.arange(len(marks))
    np.testing.assert_array_equal(first, first_of_each_shape(marks) | np.isnan(marks).any(axis=1))
    for row in np.flatnonzero(~first):
        distances = np.linalg.norm(marks[first] - marks[row], axis=1)
        assert np.flatnonzero(first)[np.nanargmin(distances)] == found[row]
        assert np.nanmin(distances) < DISTINCT
        assert found[found[row]] == found[row]


def test_what_was_grouped_stays_as_it_was_when_others_come(marks):
    whole, piecewise = Groups().add(marks), Groups()
    found = np.concatenate([piecewise.add(marks[start : start + 150]) for start in range(0, 600, 150)])
    np.testing.assert_array_equal(found[:150], Groups().add(marks[:150]))
    np.testing.assert_array_equal(found == np.arange(600), whole == np.arange(600))


def test_groups_go_on_from_what_is_known_of_them(marks):
    begun = Groups()
    known = begun.add(marks[:400])
    first = np.flatnonzero(known == np.arange(400))
    resumed = Groups(marks[first], first, 400)
    np.testing.assert_array_equal(resumed.add(marks[400:]), begun.add(marks[400:]))


def test_sizes_count_the_members():
    np.testing.assert_array_equal(group_sizes(np.array([0, 0, 2, 0, 2], np.uint32)), [3, 3, 2, 3, 2])


def test_blocks_of_maps_are_padded_with_zeros():
    counts = np.array([2, 3, 2], np.uint8)
    flat = np.arange(7 * 13, dtype=np.float32).reshape(7, 13) + 1
    maps = Maps(counts, flat)
    block = maps.rows(1, 3, 4)
    np.testing.assert_array_equal(block[0, :3], flat[2:5])
    np.testing.assert_array_equal(block[1, :2], flat[5:])
    assert not block[0, 3:].any()
    assert not block[1, 2:].any()
    longer = maps.joined(np.array([2], np.uint8), flat[:2])
    np.testing.assert_array_equal(longer.rows(3, 4, 2)[0], flat[:2])


@pytest.mark.parametrize("rows", [1, 7, 8, 1000])
def test_columns_have_the_length_that_was_said(rows):
    dtypes = {"f4": "<f4", "u1": "u1", "u4": "<u4"}
    arrays = {
        column.name: np.zeros((rows, 16), np.uint8) if column.type == "id" else np.zeros(rows, dtypes[column.type])
        for column in COLUMNS
    }
    assert sum(map(len, encoded(arrays))) == encoded_bytes(rows)
    assert encoded_bytes(rows) % 8 == 0


def test_ids_are_their_sixteen_bytes():
    ids = ["00112233445566778899aabbccddeeff", "ffeeddccbbaa99887766554433221100"]
    words = np.frombuffer("".join(ids).encode(), np.uint64).reshape(-1, 4)
    assert [row.tobytes().hex() for row in id_bytes(words)] == ids
