"""What all tests share: one local Ray cluster of two cores for the whole session, and calm hypothesis settings."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings

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
