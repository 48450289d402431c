"""Runs that draw symmetries: the same bits in any batches, inherited, stored, and grown again."""

import numpy as np
import pytest

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue.rows import GENOME_COLUMNS, genome_of
from fractal_farm.catalogue.verify import verify
from fractal_farm.ifs.gap import gap
from fractal_farm.ifs.random_iteration import attractor_points
from tests.farm.runs import small_config

SHARES = 'evolution.symmetries={"none": 0.4, "rotation:6": 0.3, "mirror": 0.2, "helix:4": 0.1}'


@pytest.fixture(scope="module", params=["best", "niches"])
def run(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("symmetric") / request.param
    config = small_config(SHARES, f"evolution.method={request.param}", "stop.epochs=3")
    return config, path, farm.submit(config, path, executor="serial").ended.digest


def test_batches_change_nothing(run, tmp_path):
    config, _, digest = run
    small = config.model_copy(update={"execution": config.execution.model_copy(update={"batch_size": 7})})
    assert farm.submit(small, tmp_path / "again", executor="serial").ended.digest == digest


def test_founders_draw_a_symmetry_and_children_inherit_it_unless_they_say_so(run):
    rows = Catalogue.open(run[1]).designs(ancestors=True).to_pylist()
    symmetry = {row["design_id"]: row["symmetry"] for row in rows}
    assert set(symmetry.values()) == {"none", "rotation:6", "mirror", "helix:4"}
    children = [row for row in rows if row["parents"] and row["parents"][0] in symmetry]
    assert len(children) > 20
    for row in children:
        changed = row["symmetry"] != symmetry[row["parents"][0]]
        assert changed == ("symmetry" in row["operator"])


def test_clouds_and_gaps_are_those_of_the_symmetric_genome(run):
    catalogue = Catalogue.open(run[1])
    table = catalogue.designs([*GENOME_COLUMNS, "gap", "scale"])
    for row in [row for row in table.to_pylist() if row["symmetry"] != "none"][:10]:
        genome = genome_of(row)
        assert genome.symmetry == row["symmetry"]
        assert gap(genome) == row["gap"]
        stored, grown = catalogue.points(row["design_id"]), attractor_points(genome, 1000)
        np.testing.assert_allclose(np.sort(stored, axis=0), np.sort(grown, axis=0), atol=row["scale"] / 65535)


def test_a_symmetric_catalogue_is_sound_to_the_last_bit(run):
    report = verify(run[1], "deep")
    assert report.exit_code == 0
