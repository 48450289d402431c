"""What all tests share: one local Ray cluster of two cores for each process, and calm hypothesis settings."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from tests.s3 import ObjectStore

settings.register_profile(
    "farm", deadline=None, max_examples=50, suppress_health_check=[HealthCheck.too_slow], derandomize=True
)
settings.load_profile("farm")


@pytest.fixture(scope="session")
def ray_cluster() -> Iterator[int]:
    """A real local cluster with two cores, started once; yields its number of cores."""
    from fractal_farm.farm.on_ray.session import session

    with session(None, 2) as cluster:
        yield cluster.processors


@pytest.fixture(scope="session")
def _object_store_of_the_session() -> Iterator[ObjectStore]:
    store = ObjectStore("catalogues")
    yield store
    store.stop()


@pytest.fixture
def object_store(
    _object_store_of_the_session: ObjectStore, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> ObjectStore:
    """An object store that answers, with an empty place of the test's own; this process is its client."""
    store = _object_store_of_the_session
    store.at(tmp_path.name)
    for name, value in store.environment().items():
        monkeypatch.setenv(name, value)
    return store
