"""Designs made by hand: whole designs of the catalogue, of which no digest knows."""

import shutil

import numpy as np
import pytest

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue.comparison import compared
from fractal_farm.catalogue.lineage import read_lineage
from fractal_farm.catalogue.pedigree import pedigree
from fractal_farm.catalogue.verify import verify
from fractal_farm.catalogue.verify.reproduction import reproduce
from fractal_farm.errors import InputError
from fractal_farm.fitness import evaluate
from fractal_farm.hand.keeping import keep
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.quantised_cloud import quantised_attractors


@pytest.fixture
def root(grown, tmp_path):
    shutil.copytree(grown, tmp_path / "run")
    return tmp_path / "run"


def tuned(root, identity, by):
    """A variant of a design: one angle is turned."""
    genome = Catalogue.open(root).genome(identity)
    genes = genome.genes.copy()
    genes[0, 0] += by
    return Genome(genes, genome.phenotype)


def test_a_variant_has_scores_cloud_and_lineage_and_leaves_digest_and_runs_alone(root, ids):
    before = farm.status(root)["digest"], Catalogue.open(root).digest(), Catalogue.open(root).designs().num_rows
    variant = tuned(root, ids[0], 0.05)
    (row,) = keep(root, [variant], [ids[0][:8]])
    catalogue = Catalogue.open(root)
    assert (farm.status(root)["digest"], catalogue.digest(), catalogue.designs().num_rows - 1) == before
    assert (row["design_id"], row["run_id"], row["parents"]) == (variant.design_id, "hand", [ids[0]])
    assert (row["operator"], row["kind"], row["epoch"]) == ("hand", "design", None)
    again = evaluate([variant], n_points=1000)
    assert [row[name] for name in ("d0", "d2", "lle", "fitness")] == [
        getattr(again, name)[0] for name in ("d0", "d2", "lle", "fitness")
    ]
    np.testing.assert_array_equal(
        catalogue.points(variant.design_id), quantised_attractors([variant], 1000)[0].dequantise()
    )
    assert len(catalogue.runs()) == 1


def test_variants_of_variants_are_sound_to_the_last_number(root, ids):
    first = tuned(root, ids[0], 0.05)
    keep(root, [first, tuned(root, ids[1], 0.1)], [ids[0], ids[1]])
    keep(root, [tuned(root, first.design_id, 0.02)], [first.design_id])
    report = verify(root, "deep")
    assert not [finding for finding in report.findings if finding.damage]


def test_what_is_made_by_hand_is_reproduced_compared_and_drawn_like_any_design(root, ids):
    variant = tuned(root, ids[0], 0.05)
    keep(root, [variant], [ids[0]])
    catalogue = Catalogue.open(root)
    assert reproduce(catalogue, variant.design_id).same
    assert compared(catalogue, variant.design_id, ids[0]).common_ancestor == (ids[0], 1, 0)
    family = pedigree(read_lineage(catalogue), read_lineage(catalogue).find(variant.design_id), "ancestors")
    assert family.lines[1].design_id == ids[0]
    assert family.lines[1].migrated_from is None


def test_a_wrong_score_of_a_variant_is_found(root, ids, monkeypatch):
    from fractal_farm.hand import keeping

    monkeypatch.setattr(keeping, "gap", lambda _genome: 0.5)
    keep(root, [tuned(root, ids[0], 0.05)])
    assert [finding.kind for finding in verify(root, "deep").findings if finding.damage] == ["row"]


def test_what_a_killed_process_left_is_cleaned_up_and_the_run_goes_on_to_the_same_digest(root, ids, tmp_path):
    orphan = root / "clouds/hand-node-0-0123abcd/points/c.0.0.0"
    orphan.parent.mkdir(parents=True)
    orphan.write_bytes(b"half")
    keep(root, [tuned(root, ids[0], 0.05)])
    assert not orphan.parent.parent.exists()
    end = farm.resume(root, overrides=["stop.epochs=9"], executor="serial")
    shutil.rmtree(root)
    whole = farm.submit(_longer(end), tmp_path / "whole", executor="serial")
    assert whole.ended.digest == end.ended.digest


def _longer(end):
    from tests.farm.test_niches import niches

    assert end.ended.progress.epochs == 9
    return niches("stop.epochs=9")


def test_a_design_that_is_there_already_is_refused(root, ids):
    with pytest.raises(InputError, match="there already"):
        keep(root, [Catalogue.open(root).genome(ids[0])])
    assert not (root / "clouds").joinpath("hand").exists()
    assert not list((root / "manifest/designs").glob("hand-*"))
