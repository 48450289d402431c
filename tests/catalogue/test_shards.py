import numpy as np
import pytest
import zarr

from fractal_farm.catalogue.shards import CAPACITY, SHARD, array_metadata, shard_files
from fractal_farm.ifs.quantised_cloud import QuantisedClouds, quantise_clouds


@pytest.mark.parametrize("count", [1, 5, SHARD])
@pytest.mark.parametrize("n_points", [1, 40, 5000])
def test_our_shards_are_byte_for_byte_those_of_zarr_python(count, n_points):
    if count * n_points > 200_000:
        count = 40
    rng = np.random.default_rng(count)
    clouds = quantise_clouds(rng.normal(size=(count, n_points, 3)).cumsum(axis=1))
    clouds.points[0, 0] = 1  # zarr-python leaves a cloud of zeros out
    ids = [rng.bytes(16).hex() for _ in range(count)]
    ours = shard_files(clouds, ids, first_shard=0)

    store = zarr.storage.MemoryStore()
    for name, metadata in array_metadata(n_points).items():
        store._store_dict[f"{name}/zarr.json"] = zarr.core.buffer.default_buffer_prototype().buffer.from_bytes(metadata)
    zarr.open_array(store, path="points")[:count] = clouds.points
    zarr.open_array(store, path="transform")[:count] = np.column_stack([clouds.origin, clouds.scale])
    zarr.open_array(store, path="design_id")[:count] = [list(bytes.fromhex(identity)) for identity in ids]
    theirs = {key: value.to_bytes() for key, value in store._store_dict.items() if "/c." in key}
    assert ours == theirs


def test_256_designs_make_one_shard_and_one_more_the_next():
    clouds = QuantisedClouds(
        np.ones((SHARD + 1, 2, 3), np.uint16), np.zeros((SHARD + 1, 3), np.float32), np.ones(SHARD + 1, np.float32)
    )
    keys = list(shard_files(clouds, ["0" * 32] * (SHARD + 1), first_shard=7))
    assert keys[:3] == ["points/c.7.0.0", "transform/c.7.0", "design_id/c.7.0"]
    assert keys[3:] == ["points/c.8.0.0", "transform/c.8.0", "design_id/c.8.0"]


def test_all_codecs_are_registered_ones_that_other_implementations_read():
    import json

    for metadata in array_metadata(100).values():
        array = json.loads(metadata)
        assert array["shape"][0] == CAPACITY
        codecs = array["codecs"]
        names = {codec["name"] for codec in codecs}
        if "sharding_indexed" in names:
            names |= {codec["name"] for codec in codecs[0]["configuration"]["codecs"]}
        assert names <= {"bytes", "blosc", "crc32c", "sharding_indexed"}
