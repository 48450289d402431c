"""A catalogue opens without the farm: the snippets of the README, run as they stand there."""

import runpy
import warnings

import duckdb
import numpy as np
import pandas as pd
import pytest
import xarray
import zarr

from fractal_farm.catalogue import Catalogue
from tests.catalogue.examples import commit_epochs

SNIPPETS = {
    "zarr": """
import zarr
writer = next(zarr.open_group("my.farm/clouds", mode="r").group_values())
points, (x, y, z, scale) = writer["points"][0], writer["transform"][0]
""",
    "xarray": """
import glob, xarray
clouds = xarray.open_zarr(glob.glob("my.farm/clouds/*-*")[0], consolidated=False).isel(design=0)
points = clouds.transform[:3].values + clouds.transform[3].values * clouds.points.values / 65535
""",
    "pandas": """
import pandas
designs = pandas.read_parquet("my.farm/manifest/designs").drop_duplicates("design_id")
best = designs.nlargest(10, "fitness")[["design_id", "n_maps", "fitness", "gap"]]
""",
    "duckdb": """
import duckdb
designs = duckdb.sql("select * from 'my.farm/manifest/designs/*.parquet'")
best = designs.order("fitness desc").limit(10).df()
""",
}


@pytest.fixture
def catalogue(root, monkeypatch):
    """my.farm in the working directory, while somebody is writing to it."""
    commit_epochs(root, 0, 2)
    (root / "manifest/designs/.half.parquet.0.partial").write_bytes(b"half")
    monkeypatch.chdir(root.parent)
    return Catalogue.open(root)


@pytest.fixture
def run_snippet(tmp_path, catalogue):
    """Run a snippet in the directory of my.farm, warnings being errors; returns its variables."""

    def run(name):
        script = tmp_path / f"{name}_snippet.py"
        script.write_text(SNIPPETS[name])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return runpy.run_path(str(script))

    return run


@pytest.mark.parametrize("name", SNIPPETS)
def test_a_snippet_takes_three_lines(name):
    assert len(SNIPPETS[name].strip().splitlines()) == 3


def test_zarr_opens_the_clouds(catalogue, run_snippet):
    found = run_snippet("zarr")
    identity = bytes(found["writer"]["design_id"][0]).hex()
    corner = np.array([found["x"], found["y"], found["z"]], float)
    points = corner + float(found["scale"]) * found["points"] / 65535
    np.testing.assert_array_equal(points, catalogue.points(identity))


def test_xarray_opens_the_clouds_with_names_and_coordinates(catalogue, run_snippet):
    found = run_snippet("xarray")
    clouds = found["clouds"]
    assert set(clouds.data_vars) == {"points"}
    assert clouds.points.dims == ("point", "axis")
    identity = bytes(clouds.design_id.values).hex()
    np.testing.assert_allclose(found["points"], catalogue.points(identity), atol=2e-6 * float(clouds.transform[3]))


@pytest.mark.parametrize("name", ["pandas", "duckdb"])
def test_pandas_and_duckdb_open_the_manifest(catalogue, run_snippet, name):
    best = run_snippet(name)["best"]
    assert isinstance(best, pd.DataFrame)
    assert list(best["design_id"]) == catalogue.designs(["design_id"])[:10].column(0).to_pylist()


def test_every_column_and_value_reads_the_same_in_pandas_and_duckdb(catalogue):
    ours = catalogue.designs().sort_by("design_id")
    frame = pd.read_parquet(catalogue.path / "manifest/designs").sort_values("design_id")
    table = duckdb.sql("select * from 'my.farm/manifest/designs/*.parquet' order by design_id").fetchall()
    assert list(frame.columns) == ours.schema.names
    for i, name in enumerate(ours.schema.names):
        if name == "created_us":
            continue
        values = ours.column(name).to_pylist()
        assert [list(row[i]) if isinstance(row[i], (list, tuple)) else row[i] for row in table] == values
        for value, other in zip(values, frame[name], strict=True):
            assert (value is None and pd.isna(other)) or np.array_equal(value, other)


def test_zarr_finds_only_sound_members_below_the_clouds(catalogue):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (writer,) = zarr.open_group(catalogue.path / "clouds", mode="r").groups()
        assert sorted(name for name, _ in writer[1].arrays()) == ["design_id", "points", "transform"]
        whole = xarray.open_zarr(next((catalogue.path / "clouds").glob("*-*")), consolidated=False)
    assert dict(whole.sizes) == {"design": 1 << 20, "point": 32, "axis": 3, "parameter": 4, "byte": 16}
    assert set(whole.coords) == {"transform", "design_id"}
