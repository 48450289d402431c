"""The house's order: who may import whom, and what is loaded when."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from importlinter.cli import lint_imports

ROOT = Path(__file__).parents[1]
HEAVY = ("ray", "numba", "zarr", "numpy", "scipy", "pyarrow", "pydantic", "trimesh", "skimage", "rich")


def loaded_by(code: str) -> set[str]:
    """Top-level modules that a fresh interpreter has loaded after running some code."""
    report = "import sys; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", f"{code}\n{report}"], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


def test_imports_point_one_way(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    assert lint_imports(config_filename="pyproject.toml", no_cache=True) == 0


@pytest.mark.parametrize("package", ["ifs", "fitness", "evolution", "catalogue", "solid", "picture", "config"])
def test_no_part_below_the_farm_loads_ray(package: str) -> None:
    walk = (
        f"import importlib, pkgutil; package = importlib.import_module('fractal_farm.{package}')\n"
        "for found in pkgutil.walk_packages(getattr(package, '__path__', []), package.__name__ + '.'):\n"
        "    importlib.import_module(found.name)"
    )
    assert "ray" not in loaded_by(walk)


def test_help_loads_nothing_heavy() -> None:
    loaded = loaded_by("from fractal_farm.cli import main; main(['--help'])")
    assert "typer" in loaded
    assert not loaded.intersection(HEAVY)


def test_import_loads_nothing_heavy_until_a_name_is_used() -> None:
    assert not loaded_by("import fractal_farm").intersection(HEAVY)
    assert "numba" not in loaded_by("import fractal_farm; fractal_farm.Genome; fractal_farm.RunConfig")


def test_genomes_need_no_numba() -> None:
    assert "numba" not in loaded_by("import fractal_farm.ifs.genome")


def test_every_public_name_is_there() -> None:
    loaded_by("import fractal_farm\nfor name in fractal_farm.__all__: assert getattr(fractal_farm, name)")


def test_a_name_that_is_not_public_is_an_attribute_error() -> None:
    import fractal_farm

    assert set(fractal_farm.__all__) <= set(dir(fractal_farm))
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        getattr(fractal_farm, "nonsense")  # noqa: B009 - the attribute is what is tested
