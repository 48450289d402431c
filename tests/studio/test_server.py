"""The studio over a real socket: pages, data and answers that are what the catalogue holds."""

import numpy as np
import pytest

from fractal_farm.catalogue import Catalogue

DTYPES = {"f4": "<f4", "u1": "u1", "u4": "<u4"}


def columns_of(studio, facts, start=0):
    """The columns as a page reads them: by catalogue.json alone."""
    content = studio.get(f"data/{facts['version']}/columns.bin", params={"from": start}).content
    rows, place, found = facts["rows"] - start, 0, {}
    for column in facts["columns"]:
        width = 16 if column["type"] == "id" else np.dtype(DTYPES[column["type"]]).itemsize
        piece = content[place : place + width * rows]
        found[column["name"]] = (
            [piece[16 * k : 16 * k + 16].hex() for k in range(rows)]
            if column["type"] == "id"
            else np.frombuffer(piece, DTYPES[column["type"]])
        )
        place += -(-width * rows // 8) * 8
    assert place == len(content)
    return found


@pytest.fixture(scope="module")
def designs(studio):
    return Catalogue.open(studio.directory).designs()


def test_columns_hold_the_designs_of_the_catalogue_best_first(studio, designs):
    facts = studio.facts()
    columns = columns_of(studio, facts)
    assert facts["rows"] == designs.num_rows > 20
    assert columns["design_id"] == designs.column("design_id").to_pylist()
    for name in ("fitness", "d0", "d2", "lle", "gap", "similarity_dimension"):
        np.testing.assert_array_equal(columns[name], np.array(designs.column(name).to_pylist(), "f4"))
    np.testing.assert_array_equal(columns["n_maps"], designs.column("n_maps").to_pylist())


def test_columns_from_a_row_on_are_the_end_of_all_columns(studio):
    facts = studio.facts()
    whole, end = columns_of(studio, facts), columns_of(studio, facts, 7)
    assert end["design_id"] == whole["design_id"][7:]
    np.testing.assert_array_equal(end["created"], whole["created"][7:])


def test_blocks_of_maps_hold_the_resolved_maps_and_probabilities(studio, designs):
    facts = studio.facts()
    content = studio.get(f"data/{facts['version']}/maps/0.bin").content
    maps = np.frombuffer(content, "<f4").reshape(-1, facts["maps_per_row"], 13)
    assert len(maps) == min(facts["rows"], facts["block"])
    rows = designs.slice(0, len(maps)).to_pylist()
    for held, row in zip(maps, rows, strict=True):
        count = row["n_maps"]
        np.testing.assert_array_equal(held[:count, :12].ravel(), np.array(row["maps"], "f4"))
        np.testing.assert_array_equal(held[:count, 12], np.array(row["probabilities"], "f4"))
        assert not held[count:].any()


def test_what_there_is_not_is_404(studio):
    facts = studio.facts()
    for path in (
        "nonsense.js",
        "data/0000000000000000/columns.bin",
        f"data/{facts['version']}/maps/1000.bin",
        f"data/{facts['version']}/maps/-1.bin",
        "api/nonsense",
    ):
        answer = studio.get(path)
        assert (path, answer.status_code) == (path, 404)
        assert list(answer.json()) == ["error"]
