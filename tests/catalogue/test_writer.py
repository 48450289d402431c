import errno
import os

import numpy as np
import pytest

from fractal_farm.catalogue import (
    Catalogue,
    RunWriter,
    committed_records,
    design_table,
    remove_orphans,
)
from fractal_farm.catalogue import shards as shards_module
from fractal_farm.catalogue import writer as writer_module
from fractal_farm.errors import FarmError, InputError, StorageFullError
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.quantised_cloud import QuantisedClouds, quantised_attractors
from tests.catalogue.examples import N_POINTS, RUN, commit_epochs, designs, files, genome, records, writer


def test_rows_come_back_as_they_were_committed(root):
    given, clouds = designs(range(20))
    receipt = writer(root).commit(given, clouds, records(0), (0, 0))
    assert (receipt.seq, receipt.rows) == (0, 20)
    found = Catalogue.open(root).designs().sort_by("design_id")
    assert found.select(given.schema.names).equals(given.sort_by("design_id"))


def test_genomes_and_points_come_back_as_they_were_committed(root):
    given, clouds = designs(range(20))
    writer(root).commit(given, clouds, records(0), (0, 0))
    catalogue = Catalogue.open(root)
    for number, identity in enumerate(given.column("design_id").to_pylist()):
        np.testing.assert_array_equal(catalogue.genome(identity).genes, genome(number).genes)
        np.testing.assert_array_equal(catalogue.points(identity), clouds[number].dequantise())


def test_every_kind_of_genome_comes_back(root):
    rows = genome(0).genes
    affine = np.hstack([np.diag([0.5, 0.4, 0.3]), np.ones((3, 1))]).reshape(1, 12)
    genomes = [
        Genome(rows, Phenotype(influence=2.5, map_form="rho R x + d", rotation_sign=-1)),
        Genome(rows, probabilities=(0.3, 0.7)),
        Genome(np.vstack([affine, -affine]), Phenotype(family="affine")),
        Genome(np.vstack([genome(i).genes for i in range(4)])[:8]),
    ]
    columns = designs(range(4))[0].select(["epoch", "island", "generation", "slot", "fitness", "d0", "d2", "lle"])
    table = design_table(genomes, columns.to_pydict())
    writer(root).commit(table, quantised_attractors(genomes, N_POINTS), b"", (0, 0))
    for each in genomes:
        found = Catalogue.open(root).genome(each.design_id)
        np.testing.assert_array_equal(found.genes, each.genes)
        assert (found.phenotype, found.probabilities) == (each.phenotype, each.probabilities)


def test_a_commit_makes_four_files_and_a_commit_without_designs_one(root):
    used = writer(root)
    first = used.commit(*designs(range(8)), records(0), (0, 0))
    assert first.files == 8  # and the metadata of the arrays, once for each writer
    before = files(root)
    second = used.commit(*designs(range(8, 16)), records(1), (1, 1))
    new = {name: size for name, size in files(root).items() if name not in before}
    assert (second.files, second.bytes) == (len(new), sum(new.values())) == (4, second.bytes)
    before = files(root)
    third = used.commit(designs([])[0], None, records(2), (2, 2))
    assert len(files(root)) - len(before) == third.files == 1
    assert [epochs for epochs, _ in committed_records(root, RUN)] == [(0, 0), (1, 1), (2, 2)]


def test_nothing_that_was_written_is_written_again(root):
    used = writer(root)
    content = {}
    for epoch in range(4):
        used.commit(*designs(range(8 * epoch, 8 * epoch + 8)), records(epoch), (epoch, epoch))
        now = {path: (path.stat().st_ino, path.read_bytes()) for path in root.rglob("*") if path.is_file()}
        assert now.items() >= content.items()
        content = now


def test_more_designs_than_fit_a_shard_take_several(root, monkeypatch):
    monkeypatch.setattr(shards_module, "SHARD", 4)
    monkeypatch.setattr(writer_module, "SHARD", 4)
    shards_module.array_metadata.cache_clear()
    used = writer(root)
    given, clouds = designs(range(11))
    used.commit(given, clouds, records(0), (0, 0))
    more, more_clouds = designs(range(11, 14))
    used.commit(more, more_clouds, records(1), (1, 1))
    shards_module.array_metadata.cache_clear()
    catalogue = Catalogue.open(root)
    for table, batch in ((given, clouds), (more, more_clouds)):
        for i, identity in enumerate(table.column("design_id").to_pylist()):
            np.testing.assert_array_equal(catalogue.points(identity), batch[i].dequantise())


def test_a_writer_whose_arrays_are_full_takes_a_new_name(root, monkeypatch):
    monkeypatch.setattr(writer_module, "CAPACITY", 2 * writer_module.SHARD)
    used = writer(root)
    names = []
    for epoch in range(5):
        used.commit(*designs(range(8 * epoch, 8 * epoch + 8)), records(epoch), (epoch, epoch))
        names.append(used.name)
    assert len(set(names)) == 3
    assert len(list(committed_records(root, RUN))) == 5
    assert Catalogue.open(root).dense_points()[:].shape == (40, N_POINTS, 3)


def test_ancestors_are_rows_without_clouds_and_no_designs(root):
    kinds = ["design", "ancestor", "ancestor", "design", "design"]
    given, clouds = designs(range(5), kind=kinds)
    kept = [i for i, kind in enumerate(kinds) if kind == "design"]
    own = QuantisedClouds(clouds.points[kept], clouds.origin[kept], clouds.scale[kept])
    writer(root).commit(given, own, records(0), (0, 0))
    catalogue = Catalogue.open(root)
    assert catalogue.designs().num_rows == 3
    assert catalogue.designs(ancestors=True).num_rows == 5
    for number in range(5):
        row = catalogue.design(genome(number).design_id)
        assert (row["cloud_row"] is None) == (row["cloud_crc32c"] is None) == (number not in kept)
        np.testing.assert_array_equal(catalogue.points(row["design_id"]), clouds[number].dequantise())
    # A design stays one, even if another run knows it only as an ancestor.
    elsewhere = writer(root, run_id="fedcba9876543210", clouds="none")
    elsewhere.commit(designs([0], kind=["ancestor"], epoch=[-1])[0], None, b"", (0, 0))
    assert catalogue.designs().num_rows == 3
    assert catalogue.designs(run_id="fedcba9876543210").num_rows == 0


def test_without_clouds_the_points_are_grown_again_and_are_the_same(root, tmp_path):
    given, clouds = designs(range(12))
    writer(root).commit(given, clouds, records(0), (0, 0))
    lean = Catalogue.create(tmp_path / "lean")
    writer(lean.path, clouds="none").commit(given, clouds, records(0), (0, 0))
    assert not list(lean.path.glob("clouds/*/*"))
    full = Catalogue.open(root)
    assert lean.digest() == full.digest()
    np.testing.assert_array_equal(lean.dense_points()[:], full.dense_points()[:])
    identity = given.column("design_id")[3].as_py()
    np.testing.assert_array_equal(lean.points(identity), full.points(identity))


def test_the_same_epochs_committed_twice_count_once(root):
    commit_epochs(root, 0, 2)
    digest = Catalogue.open(root).digest()
    commit_epochs(root, 1, 2, attempt=1)
    assert [epochs for epochs, _ in committed_records(root, RUN)] == [(0, 0), (1, 1), (2, 2)]
    assert Catalogue.open(root).designs().num_rows == 24
    assert Catalogue.open(root).digest() == digest


def failing_at(monkeypatch, step, code):
    """Let the step-th call of those that change the disk fail; returns how many calls there were."""
    calls = [0]

    def wrap(original):
        def counted(*arguments, **options):
            calls[0] += 1
            if calls[0] == step:
                raise OSError(code, os.strerror(code))
            return original(*arguments, **options)

        return counted

    for verb in ("fsync", "replace", "mkdir"):
        monkeypatch.setattr(os, verb, wrap(getattr(os, verb)))
    return calls


def test_a_commit_that_fails_at_any_step_can_be_repeated_and_counts_once(tmp_path, monkeypatch):
    expected = None
    step = 0
    while True:
        step += 1
        root = Catalogue.create(tmp_path / str(step)).path
        used = writer(root, durability="full")
        used.commit(*designs(range(3)), records(0), (0, 0))
        batch = designs(range(3, 9))
        with monkeypatch.context() as broken:
            calls = failing_at(broken, step, errno.ENOSPC)
            try:
                used.commit(*batch, records(1), (1, 1))
            except StorageFullError:
                assert not list(root.rglob("*.partial"))
            else:
                assert calls[0] < step
                break
        assert Catalogue.open(root).designs().num_rows in (3, 9)
        with pytest.raises(FarmError, match="commit 1 is not stored; repeat it"):
            used.commit(*designs(range(9, 12)), records(2), (2, 2))
        assert used.commit(*batch, records(1), (1, 1)).seq == 1
        used.commit(*designs(range(9, 12)), records(2), (2, 2))
        assert remove_orphans(root, RUN) == 0
        assert [epochs for epochs, _ in committed_records(root, RUN)] == [(0, 0), (1, 1), (2, 2)]
        digest = Catalogue.open(root).digest()
        assert digest == (expected := expected or digest)
        assert Catalogue.open(root).usage().rows == 12
        Catalogue.open(root).dense_points()[:]
    assert step > 12  # four files and their directories, and then the part


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda table, clouds: (table.drop_columns(["fitness"]), clouds), "missing columns \\['fitness'\\]"),
        (lambda table, clouds: (table.append_column("x", table.column("d0")), clouds), "unknown columns \\['x'\\]"),
        (lambda table, clouds: (table, None), "without clouds"),
        (lambda table, clouds: (table.slice(1), clouds), "this writer stores \\(3, 32, 3\\)"),
    ],
)
def test_a_table_that_does_not_fit_is_refused_and_nothing_is_written(root, change, message):
    before = files(root)
    used = writer(root)
    with pytest.raises(FarmError, match=message):
        used.commit(*change(*designs(range(4))), records(0), (0, 0))
    assert files(root) == before
    assert used.commit(*designs(range(4)), records(0), (0, 0)).seq == 0


def test_names_of_writers_differ_and_begin_with_the_run(root):
    names = {RunWriter(root, RUN, "a strange/node~name", 3, N_POINTS).name for _ in range(20)}
    assert len(names) == 20
    assert all(name.startswith(f"{RUN}-a_strange_node_name-3-") for name in names)
    with pytest.raises(InputError, match="run id"):
        RunWriter(root, "../elsewhere", "node", 0, N_POINTS)
