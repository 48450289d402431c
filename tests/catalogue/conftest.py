import pytest

from fractal_farm.catalogue import Catalogue


@pytest.fixture
def root(tmp_path):
    """An empty catalogue's directory."""
    return Catalogue.create(tmp_path / "my.farm").path
