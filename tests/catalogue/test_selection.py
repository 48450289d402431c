"""`Catalogue.select` reads little, and says what sorting and filtering the whole table says."""

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest

from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue.compaction import compact
from fractal_farm.catalogue.schema import DESIGN_SCHEMA
from fractal_farm.errors import FarmError, InputError
from tests.catalogue.examples import RUN, commit_epochs, designs, records, writer

COLUMNS = ["design_id", "fitness", "gap", "parents", "operator"]


@pytest.fixture(scope="module", params=["parts", "merged", "both"])
def catalogue(request, tmp_path_factory):
    """48 designs and 8 ancestors; ties, nulls, and designs that several commits hold."""
    root = Catalogue.create(tmp_path_factory.mktemp("selection") / "my.farm").path
    used = commit_epochs(root, 0, 3)
    numbers = range(32, 40)
    ties = {"fitness": [0.5, 0.5, 0.7, 0.7, 0.7, 0.1, 0.1, 0.1], "gap": [None, 0.1] * 4}
    used.commit(*designs(numbers, **ties), records(4), (4, 4))
    if request.param != "parts":
        compact(root, RUN)
    used.commit(*designs([3, 5, 35, *range(40, 45)]), records(5), (5, 5))
    ancestors, _ = designs([*range(45, 49), 1, 2, 33, 34], kind=["ancestor"] * 8)
    used.commit(ancestors, None, records(6), (6, 6))
    if request.param == "merged":
        compact(root, RUN)
    return Catalogue.open(root)


@pytest.mark.parametrize("limit", [None, 3, 44])
@pytest.mark.parametrize(
    ("column", "descending"),
    [("fitness", True), ("fitness", False), ("gap", True), ("gap", False), ("operator", True), ("epoch", True),
     ("design_id", False), ("created_us", False), ("probabilities_by_hand", True)],
)  # fmt: skip
def test_the_first_in_an_order_are_those_of_the_sorted_table(catalogue, column, descending, limit):
    keys = [(column, "descending" if descending else "ascending")]
    keys += [] if column == "design_id" else [("design_id", "ascending")]
    expected = catalogue.designs().sort_by(keys).select(COLUMNS).slice(0, limit)
    found, total = catalogue.select(COLUMNS, order=(column, descending), limit=limit)
    assert found.to_pylist() == expected.to_pylist()
    assert total == 45


@pytest.mark.parametrize(
    ("where", "names"),
    [
        (pc.field("fitness") > 0.5, ["fitness"]),
        ((pc.field("gap") < 0.5) & (pc.field("n_maps") == 3), ["gap", "n_maps"]),
        (pc.field("gap").is_null(), ["gap"]),
        (pc.field("fitness") > 2, ["fitness"]),
    ],
)
def test_a_filter_chooses_what_it_chooses_of_the_whole_table(catalogue, where, names):
    expected = catalogue.designs().filter(where)
    found, total = catalogue.select(COLUMNS, where, names, limit=5)
    assert found.to_pylist() == expected.select(COLUMNS).slice(0, 5).to_pylist()
    assert total == expected.num_rows


def test_every_column_can_be_asked_for_and_an_unknown_one_cannot(catalogue):
    table, _ = catalogue.select(DESIGN_SCHEMA.names, limit=7)
    assert table.schema.equals(DESIGN_SCHEMA)
    assert table.equals(catalogue.designs().slice(0, 7).combine_chunks())
    with pytest.raises(InputError, match="no column fitnes"):
        catalogue.select(["fitnes"])


def test_a_fitness_that_is_not_a_number_comes_last(root):
    fitness = [0.3, np.nan, 0.9, 0.1, np.nan, 0.5, 0.2, 0.4]
    writer(root).commit(*designs(range(8), fitness=fitness), records(0), (0, 0))
    found, _ = Catalogue.open(root).select(["fitness"], limit=7)
    np.testing.assert_array_equal(found.column(0).to_numpy(), [0.9, 0.5, 0.4, 0.3, 0.2, 0.1, np.nan])


def test_an_empty_catalogue_has_nothing_to_select(root):
    found, total = Catalogue.open(root).select(["design_id"], pc.field("fitness") > 0.5, ["fitness"], limit=3)
    assert (found.num_rows, total) == (0, 0)


def test_an_id_of_the_wrong_length_is_reported(root):
    given, _ = designs(range(2), design_id=["abc", "d" * 32])
    writer(root, clouds="none").commit(given, None, b"", (0, 0))
    with pytest.raises(FarmError, match="not 32 digits"):
        Catalogue.open(root).select(["fitness"])


def test_indices_of_arrow_and_numpy_are_the_same():
    from fractal_farm.catalogue.scan import indices, numbers, places_of

    places = np.array([5, 0, 3])
    assert indices(places).to_pylist() == [5, 0, 3]
    assert places_of(indices(places).slice(1)).tolist() == [0, 3]
    column = pa.chunked_array([[1.5, 2.5], [], [3.5]])
    assert numbers(column.slice(1)).tolist() == [2.5, 3.5]
