"""What is published opens without the farm, and is what the catalogue holds."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import pyarrow.compute as pc
import pytest
import xarray

from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue import export as export_module
from fractal_farm.catalogue.compaction import compact
from fractal_farm.catalogue.export import SCHEMA, export
from fractal_farm.distinctness import signatures
from fractal_farm.errors import FarmError, InputError
from tests.catalogue.examples import N_POINTS, RUN, commit_epochs, designs, files, records, writer

HOUSE = Path(__file__).resolve().parents[2]


@pytest.fixture
def catalogue(root):
    """56 designs, some in a merged part, and the last eight without stored clouds; ancestors besides."""
    commit_epochs(root, 0, 3)
    compact(root, RUN)
    commit_epochs(root, 4, 5, attempt=1)
    bare = writer(root, attempt=2, clouds="none")
    bare.commit(designs(range(48, 56))[0], None, records(6), (6, 6))
    bare.commit(designs(range(56, 60), kind=["ancestor"] * 4)[0], None, records(7), (7, 7))
    return Catalogue.open(root)


@pytest.fixture(params=[256, 10])
def out(request, catalogue, tmp_path, monkeypatch):
    """Everything published, in blocks of one size or another."""
    monkeypatch.setattr(export_module, "BLOCK", request.param)
    done = export(catalogue, tmp_path / "out", licence="CC-BY-4.0")
    assert (done.designs, done.clouds) == (56, 56)
    assert done.bytes == sum(files(tmp_path / "out").values())
    return tmp_path / "out"


def test_pandas_and_duckdb_read_the_table_best_first(catalogue, out):
    ours = catalogue.designs()
    frame = pd.read_parquet(out / "designs.parquet")
    assert list(frame.columns) == SCHEMA.names
    rows = duckdb.sql(f"select * from '{out}/designs.parquet'").fetchall()
    for place, name in enumerate(name for name in SCHEMA.names if name != "signature"):
        values = ours.column(name).to_pylist()
        read = [row[place] for row in rows]
        assert [list(value) if isinstance(value, tuple) else value for value in read] == values
    marks = signatures(np.stack(frame.descriptor), frame.d0, frame.d2)
    np.testing.assert_array_equal(np.stack(frame.signature), marks)


def test_xarray_reads_the_clouds_in_the_order_of_the_table(catalogue, out):
    clouds = xarray.open_zarr(out / "clouds.zarr", consolidated=False)
    assert dict(clouds.sizes) == {"design": 56, "point": N_POINTS, "axis": 3, "byte": 16}
    ids = [bytes(row).hex() for row in clouds.design_id.values]
    assert ids == catalogue.designs(["design_id"]).column(0).to_pylist()
    points = (clouds.points / 65535 * clouds.scale.astype(float) + clouds.origin.astype(float)).values
    expected = catalogue.dense_points()[:]
    np.testing.assert_allclose(points, expected, atol=1e-12 * np.abs(expected).max())


def test_the_collection_says_what_it_is(catalogue, out):
    told = json.loads((out / "collection.json").read_text())
    fitness = catalogue.designs(["fitness"]).column(0).to_numpy()
    assert told["license"] == "CC-BY-4.0"
    assert told["assets"]["designs"]["table:row_count"] == 56
    assert told["summaries"]["fitness"] == {"minimum": fitness.min(), "maximum": fitness.max()}
    assert told["summaries"]["n_maps"] == [2, 3]
    assert [column["name"] for column in told["table:columns"]] == SCHEMA.names
    assert all(column["description"] for column in told["table:columns"])
    for asset in told["assets"].values():
        assert (out / asset["href"]).exists()


def test_the_checksums_are_those_of_sha256sum_and_cover_every_file(out):
    done = subprocess.run(["sha256sum", "--check", "--strict", "checksums.sha256"], cwd=out, capture_output=True)
    assert done.returncode == 0
    listed = {line.split("  ")[1] for line in (out / "checksums.sha256").read_text().splitlines()}
    assert listed == set(files(out)) - {"checksums.sha256"}


def test_a_filter_chooses_what_is_published(catalogue, tmp_path):
    done = export(catalogue, tmp_path / "out", pc.field("n_maps") == 3, ("n_maps",), clouds=False)
    expected = catalogue.designs(["design_id", "n_maps"]).filter(pc.field("n_maps") == 3)
    assert pd.read_parquet(tmp_path / "out/designs.parquet").design_id.to_list() == expected.column(0).to_pylist()
    assert (done.designs, done.clouds) == (expected.num_rows, 0)
    assert not (tmp_path / "out/clouds.zarr").exists()


@pytest.mark.parametrize(
    ("place", "message"), [("out", "exists already"), ("my.farm/out", "lies in"), ("my.farm", "exists already")]
)
def test_a_place_that_is_taken_or_in_the_catalogue_is_refused(catalogue, tmp_path, place, message):
    (tmp_path / "out").mkdir()
    before = files(tmp_path)
    with pytest.raises(InputError, match=message):
        export(catalogue, tmp_path / place)
    assert files(tmp_path) == before


def test_nothing_to_publish_and_clouds_of_different_sizes_are_refused_and_leave_nothing(catalogue, tmp_path):
    with pytest.raises(InputError, match="no design to export"):
        export(catalogue, tmp_path / "out", pc.field("fitness") > 2, ("fitness",))
    writer(catalogue.path, attempt=3, n_points=7).commit(*few_points(range(60, 62)), records(8), (8, 8))
    with pytest.raises(InputError, match=r'--where "n_points == 7" or --where "n_points == 32"'):
        export(catalogue, tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["my.farm"]
    export(catalogue, tmp_path / "out", pc.field("n_points") == 7, ("n_points",))


def few_points(numbers):
    table, clouds = designs(numbers)
    return table, type(clouds)(clouds.points[:, :7], clouds.origin, clouds.scale)


def test_a_damaged_cloud_is_not_published(catalogue, tmp_path):
    shard = next(catalogue.path.glob("clouds/*/points/c.1.0.0"))
    content = bytearray(shard.read_bytes())
    content[40] ^= 1
    shard.write_bytes(content)
    with pytest.raises(FarmError, match="farm verify --repair"):
        export(catalogue, tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["my.farm"]


SLOWLY = """
import sys, time
from fractal_farm.catalogue import Catalogue, cloud_export, export
write = cloud_export.joined_pieces
cloud_export._BLOCK = 8
def slowly(pieces):
    print("at work", flush=True)
    time.sleep(0.05)
    return write(pieces)
cloud_export.joined_pieces = slowly
export.export(Catalogue.open(sys.argv[1]), __import__("pathlib").Path(sys.argv[2]))
"""


def test_a_killed_export_leaves_nothing_that_looks_finished_and_the_next_one_tidies_up(catalogue, tmp_path):
    command = [sys.executable, "-c", SLOWLY, str(catalogue.path), str(tmp_path / "out")]
    environment = os.environ | {"PYTHONPATH": str(HOUSE)}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        time.sleep(0.1)
        os.kill(process.pid, signal.SIGKILL)
    assert not (tmp_path / "out").exists()
    (left,) = (path.name for path in tmp_path.iterdir() if path.name != "my.farm")
    assert left.endswith(".partial")
    export(catalogue, tmp_path / "out")
    assert {path.name for path in tmp_path.iterdir()} == {"my.farm", "out"}
