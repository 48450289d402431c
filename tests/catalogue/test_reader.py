import json
import threading

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue import writer as writer_module
from fractal_farm.catalogue.layout import part_name
from fractal_farm.catalogue.schema import DESIGN_SCHEMA
from fractal_farm.errors import FarmError, InputError
from tests.catalogue.examples import N_POINTS, RUN, commit_epochs, designs, files, genome, records, writer

ANOTHER_RUN = "fedcba9876543210"


def test_an_empty_catalogue_has_no_designs_but_all_columns(root):
    catalogue = Catalogue.open(root)
    assert catalogue.designs().schema.equals(DESIGN_SCHEMA)
    assert catalogue.designs().num_rows == 0
    assert catalogue.dense_points()[:].shape == (0, 0, 3)
    assert catalogue.runs() == catalogue.solids() == []
    assert len(catalogue.digest()) == 32


def test_designs_come_best_first_then_by_id(root):
    given, clouds = designs(range(12), fitness=[0.5, 0.7, 0.5, 0.9] * 3)
    writer(root).commit(given, clouds, records(0), (0, 0))
    rows = Catalogue.open(root).designs(["design_id", "fitness"]).to_pylist()
    keys = [(-row["fitness"], row["design_id"]) for row in rows]
    assert keys == sorted(keys)
    assert len(keys) == 12


def test_of_equal_designs_the_one_born_first_stands_whatever_the_order_of_commits(root):
    births = [(2, 0, 9, 0), (1, 2, 9, 9), (1, 2, 8, 9), (1, 2, 8, 4), (3, 0, 0, 0)]
    used = writer(root)
    for i, birth in enumerate(births):
        columns = dict(zip(("epoch", "island", "generation", "slot"), ([value] for value in birth), strict=True))
        used.commit(*designs([0], **columns), records(i), (i, i))
    (row,) = Catalogue.open(root).designs().to_pylist()
    assert (row["epoch"], row["island"], row["generation"], row["slot"]) == min(births)


def test_a_run_can_be_looked_at_alone(root):
    writer(root).commit(*designs(range(8)), records(0), (0, 0))
    writer(root, run_id=ANOTHER_RUN).commit(*designs(range(4, 10)), records(0), (0, 0))
    catalogue = Catalogue.open(root)
    assert catalogue.designs().num_rows == 10
    assert catalogue.designs(run_id=RUN).num_rows == 8
    assert catalogue.designs(run_id=ANOTHER_RUN).num_rows == 6
    assert len(catalogue.dense_points(ANOTHER_RUN)) == 6
    assert len({catalogue.digest(), catalogue.digest(RUN), catalogue.digest(ANOTHER_RUN)}) == 3


def test_columns_carry_units_and_meaning_and_nothing_private(root):
    commit_epochs(root, 0, 1)
    table = Catalogue.open(root).designs(["lle", "fitness"])
    assert table.schema.names == ["lle", "fitness"]
    assert table.schema.field("lle").metadata[b"unit"] == b"nats/iteration"
    assert not table.schema.metadata


def test_an_unknown_column_is_refused(root):
    with pytest.raises(InputError, match=r"no column fitnes; the columns are design_id, .*fitness"):
        Catalogue.open(root).designs(["fitnes"])


@pytest.fixture(scope="module")
def grown(tmp_path_factory):
    """A catalogue of 40 designs in 5 commits."""
    root = Catalogue.create(tmp_path_factory.mktemp("grown") / "my.farm").path
    commit_epochs(root, 0, 4)
    return root


@given(length=st.integers(4, 32), number=st.integers(0, 39))
def test_a_prefix_that_only_one_design_has_finds_it(grown, length, number):
    identity = genome(number).design_id
    alike = [other for other in range(40) if genome(other).design_id.startswith(identity[:length])]
    assert alike == [number]
    catalogue = Catalogue.open(grown)
    assert catalogue.design(identity[:length])["design_id"] == identity
    assert catalogue.genome(identity[:length].upper()) == genome(number)


def test_a_prefix_that_several_designs_have_is_refused(root):
    ids = [f"abcd{i:028d}" for i in range(6)] + ["abce" + "0" * 28]
    writer(root, clouds="none").commit(designs(range(7), design_id=ids)[0], None, b"", (0, 0))
    with pytest.raises(InputError, match="6 designs begin with abcd"):
        Catalogue.open(root).design("abcd")
    assert Catalogue.open(root).design("abce")["design_id"] == ids[-1]


@pytest.mark.parametrize(
    ("given", "message"),
    [("abc", "at least 4 hex digits"), ("zzzz", "hex digits"), ("", "hex digits"), ("0" * 32, "no design 0000")],
)
def test_what_is_no_design_is_refused(grown, given, message):
    for method in ("design", "genome", "points"):
        with pytest.raises(InputError, match=message):
            getattr(Catalogue.open(grown), method)(given)


def test_a_design_committed_after_the_first_look_is_found(root):
    used = commit_epochs(root, 0, 0)
    catalogue = Catalogue.open(root)
    catalogue.points(genome(3).design_id)
    used.commit(*designs(range(8, 12)), records(1), (1, 1))
    assert catalogue.points(genome(9).design_id).shape == (N_POINTS, 3)


def test_the_dense_view_holds_what_single_reads_give(grown):
    catalogue = Catalogue.open(grown)
    dense = catalogue.dense_points()
    assert dense.shape == (40, N_POINTS, 3)
    assert dense.design_ids == catalogue.designs(["design_id"]).column(0).to_pylist()
    single = np.stack([catalogue.points(identity) for identity in dense.design_ids])
    np.testing.assert_array_equal(dense[:], single)
    np.testing.assert_array_equal(np.concatenate(list(dense.batches(7))), single)
    np.testing.assert_array_equal(dense[-1], single[-1])
    np.testing.assert_array_equal(dense[30:3:-4], single[30:3:-4])
    np.testing.assert_array_equal(catalogue.dense_points(limit=5)[:], single[:5])
    with pytest.raises(IndexError):
        dense[40]


def test_clouds_of_different_sizes_make_no_dense_view(root):
    writer(root).commit(*designs(range(2)), records(0), (0, 0))
    writer(root, n_points=7, clouds="none", run_id=ANOTHER_RUN).commit(designs([5])[0], None, b"", (0, 0))
    with pytest.raises(InputError, match=r"clouds of \[7, 32\] points"):
        Catalogue.open(root).dense_points()
    assert Catalogue.open(root).dense_points(ANOTHER_RUN).shape == (1, 7, 3)
    assert Catalogue.open(root).points(genome(5).design_id).shape == (7, 3)


def test_reading_writes_nothing(grown):
    before = files(grown)
    catalogue = Catalogue.open(grown)
    catalogue.digest()
    catalogue.dense_points()[:]
    catalogue.runs()
    catalogue.usage()
    assert files(grown) == before


def test_usage_counts_files_bytes_and_rows(grown):
    usage = Catalogue.open(grown).usage()
    assert (usage.files, usage.bytes, usage.rows) == (len(files(grown)), sum(files(grown).values()), 40)


def test_readers_of_a_growing_catalogue_see_whole_commits_in_order(root):
    last = 30
    growing = threading.Thread(target=commit_epochs, args=(root, 0, last))
    growing.start()
    catalogue = Catalogue.open(root)
    seen = 0
    while growing.is_alive():
        epochs = np.array(catalogue.designs(["epoch"]).column(0))
        assert np.bincount(epochs).tolist() == [8] * len(np.unique(epochs))
        assert len(epochs) >= seen
        seen = len(epochs)
        for _ in catalogue.dense_points(limit=3).batches():
            pass
    growing.join()
    assert catalogue.designs().num_rows == 8 * (last + 1)


def test_a_catalogue_is_made_once_and_in_an_empty_place(tmp_path):
    (tmp_path / "empty").mkdir()
    Catalogue.create(tmp_path / "empty")
    with pytest.raises(InputError, match="holds a catalogue already"):
        Catalogue.create(tmp_path / "empty")
    (tmp_path / "used").mkdir()
    (tmp_path / "used" / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match="is not empty"):
        Catalogue.create(tmp_path / "used")
    with pytest.raises(InputError, match="is a file"):
        Catalogue.create(tmp_path / "used" / "letter.txt")
    assert files(tmp_path / "used") == {"letter.txt": 4}


def test_what_is_no_catalogue_is_refused_in_one_line(tmp_path):
    (tmp_path / "zarr.json").write_text('{"zarr_format": 3, "node_type": "group", "attributes": {}}')
    (tmp_path / "folder").mkdir()
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "zarr.json").write_text("{")
    for path, message in [
        (tmp_path / "nowhere", "no such directory"),
        (tmp_path / "folder", "not a catalogue"),
        (tmp_path, "not a catalogue of the farm"),
        (tmp_path / "broken", "not a catalogue of the farm"),
        (tmp_path / "zarr.json", "not a catalogue"),
    ]:
        with pytest.raises(InputError, match=message) as caught:
            Catalogue.open(path)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("key", "value"), [("min_reader", "1.1"), ("min_reader", "2.0"), ("features", ["braids"])])
def test_a_catalogue_that_needs_a_newer_reader_is_refused(root, key, value):
    content = json.loads((root / "zarr.json").read_text())
    content["attributes"]["fractal_farm"][key] = value
    (root / "zarr.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="install a newer fractal-farm"):
        Catalogue.open(root)


def test_parts_of_a_newer_minor_version_are_read(root, monkeypatch):
    commit_epochs(root, 0, 0)
    newer = DESIGN_SCHEMA.append(pa.field("mood", pa.string()))
    newer = newer.remove(newer.get_field_index("niche"))
    with monkeypatch.context() as future:
        future.setattr(writer_module, "DESIGN_SCHEMA", newer)
        commit_epochs(root, 1, 1)
    table = Catalogue.open(root).designs()
    assert table.schema.equals(DESIGN_SCHEMA)
    assert table.num_rows == 16


def flipped(path, position):
    content = bytearray(path.read_bytes())
    content[position % len(content)] ^= 1 << (position % 8)
    path.write_bytes(content)


def test_a_flipped_bit_in_a_manifest_part_is_reported(root):
    commit_epochs(root, 0, 1)
    part = sorted((root / "manifest/designs").iterdir())[0]
    whole = part.read_bytes()
    for position in range(0, len(whole), len(whole) // 25):
        flipped(part, position)
        with pytest.raises(FarmError, match=f"{part_name(part.name).writer}.*damaged"):
            Catalogue.open(root).designs()
        part.write_bytes(whole)
    part.write_bytes(whole[:-7])
    with pytest.raises(FarmError, match="damaged"):
        Catalogue.open(root).digest()


@settings(max_examples=40)
@given(position=st.integers(0, 1 << 20))
def test_a_flipped_bit_in_a_shard_is_reported_or_harmless_but_never_read(grown, position):
    expected = Catalogue.open(grown).dense_points()[:]
    shard = next(grown.glob("clouds/*/points/c.2.0.0"))
    whole = shard.read_bytes()
    flipped(shard, position)
    try:
        found = Catalogue.open(grown).dense_points()[:]
    except FarmError:
        found = expected
    finally:
        shard.write_bytes(whole)
    np.testing.assert_array_equal(found, expected)


def test_a_missing_or_shortened_shard_is_reported(root):
    commit_epochs(root, 0, 1)
    shard = next(root.glob("clouds/*/points/c.1.0.0"))
    whole = shard.read_bytes()
    shard.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FarmError, match="damaged"):
        Catalogue.open(root).points(genome(8).design_id)
    shard.unlink()
    with pytest.raises(FarmError, match="missing or damaged"):
        Catalogue.open(root).points(genome(8).design_id)
    Catalogue.open(root).points(genome(0).design_id)
    for metadata in root.glob("clouds/*/points/zarr.json"):
        metadata.unlink()
    with pytest.raises(FarmError, match="missing or damaged"):
        Catalogue.open(root).points(genome(0).design_id)


def test_a_row_whose_genes_are_not_its_own_is_reported(root):
    given, _ = designs([0, 1], design_id=[genome(5).design_id, genome(1).design_id])
    writer(root, clouds="none").commit(given, None, b"", (0, 0))
    with pytest.raises(FarmError, match=f"{genome(5).design_id}: damaged"):
        Catalogue.open(root).genome(genome(5).design_id)
