"""Small runs with niches that the tests of what people do begin with."""

import pytest

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue
from tests.farm.test_niches import niches


@pytest.fixture(scope="session")
def grown(tmp_path_factory):
    """A finished run; read-only by agreement."""
    path = tmp_path_factory.mktemp("grown") / "run"
    farm.submit(niches(), path, executor="serial")
    return path


@pytest.fixture(scope="session")
def ids(grown):
    """Its designs, in order of their ids."""
    return sorted(Catalogue.open(grown).designs(["design_id"]).column("design_id").to_pylist())
