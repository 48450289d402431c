"""The index of signatures says what the manifest says, and planted copies are found through it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from scipy.spatial.transform import Rotation

from fractal_farm.bench.genomes import random_genomes
from fractal_farm.catalogue import Catalogue, design_table
from fractal_farm.catalogue.compaction import compact
from fractal_farm.catalogue.layout import INDEX
from fractal_farm.catalogue.signatures import open_signatures
from fractal_farm.catalogue.similar import similar_to_design, similar_to_genome
from fractal_farm.distinctness import DISTINCT, signatures
from fractal_farm.errors import InputError
from fractal_farm.fitness import evaluate
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.maps import resolved_maps, selection_probabilities
from fractal_farm.ifs.similarity_dimension import similarity_dimension
from tests.catalogue.examples import RUN, commit_epochs, designs, writer

COPIED = 10


def commit(root: Path, genomes: list[Genome], epoch: int) -> None:
    scores = evaluate(genomes)
    numbers = {name: getattr(scores, name) for name in ("d0", "d2", "lle", "fitness", "descriptor")}
    places: dict[str, Any] = {name: [0] * len(genomes) for name in ("island", "generation")}
    places |= {
        "epoch": [epoch] * len(genomes),
        "slot": list(range(len(genomes))),
        "operator": ["random"] * len(genomes),
    }
    table = design_table(genomes, {**numbers, **places, "parents": [[]] * len(genomes)})
    writer(root, clouds="none", n_points=5000, attempt=epoch).commit(table, None, b"", (epoch, epoch))


def copy_of(genome: Genome, seed: int) -> Genome:
    """The same shape elsewhere, turned, scaled and mirrored, as affine maps with the same probabilities: x -> T x."""
    turn = Rotation.random(random_state=seed).as_matrix() @ np.diag([-1.0, 1.0, 1.0])
    shift, scale = np.array([2.0, -1.0, 0.5]), 3.0
    rows = []
    for a, b in ((table[:, :3], table[:, 3]) for table in resolved_maps(genome)):
        linear = turn @ a @ turn.T
        rows.append(np.column_stack([linear, scale * turn @ b + shift - linear @ shift]).ravel())
    return Genome(np.array(rows), Phenotype("affine"), tuple(selection_probabilities(genome).tolist()))


@pytest.fixture(scope="module")
def planted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Genome], list[Genome]]:
    """A catalogue of unrelated designs, and in a second part copies of some of them."""
    genes, n_maps = random_genomes(900, seed=21)
    genomes = [Genome(table[:count]) for table, count in zip(genes, n_maps, strict=True)]
    fitness = evaluate(genomes).fitness
    good = [g for g, f in zip(genomes, fitness, strict=True) if f > 0.85 and 1 <= similarity_dimension(g) <= 3][:80]
    copies = [copy_of(genome, seed) for seed, genome in enumerate(good[:COPIED])]
    root = Catalogue.create(tmp_path_factory.mktemp("planted") / "catalogue").path
    commit(root, good, 0)
    commit(root, copies, 1)
    return root, good, copies


def test_the_index_has_the_rows_that_stand_for_the_catalogue(tmp_path: Path) -> None:
    root = Catalogue.create(tmp_path / "catalogue").path
    table, _ = designs(range(6))
    of_another_run = table.set_column(table.column_names.index("operator"), "operator", pa.array(["seed"] * 6))
    fitter = of_another_run.set_column(table.column_names.index("fitness"), "fitness", pa.array([2.0] * 6))
    writer(root, clouds="none").commit(table, None, b"", (3, 3))
    earlier = fitter.set_column(table.column_names.index("epoch"), "epoch", pa.array([0] * 6, pa.int32()))
    writer(root, clouds="none", attempt=1).commit(earlier, None, b"", (0, 0))
    rows = Catalogue.open(root).designs(["design_id", "fitness"]).sort_by("design_id")
    index = open_signatures(root)
    assert [index.design_id(k) for k in range(len(index))] == rows.column("design_id").to_pylist()
    np.testing.assert_array_equal(index.fitness, rows.column("fitness").to_numpy().astype(np.float32))


def test_an_index_finds_its_rows_after_the_parts_were_merged(root: Path) -> None:
    commit_epochs(root, 0, 2)
    index = open_signatures(root)
    before = index.rows([0, 7, 3], ["design_id", "fitness"])
    compact(root, RUN)
    assert index.rows([0, 7, 3], ["design_id", "fitness"]) == before


def test_the_first_hit_is_the_planted_copy(planted: tuple[Path, list[Genome], list[Genome]]) -> None:
    root, good, copies = planted
    index = open_signatures(root)
    for original, copy in zip(good, copies, strict=False):
        hits = similar_to_design(index, original.design_id[:12], 5)
        assert hits[0].design_id == copy.design_id
        assert hits[0].same_shape
        assert hits[0].distance < DISTINCT
        assert not any(hit.same_shape for hit in hits[1:])
        assert original.design_id not in [hit.design_id for hit in hits]


def test_a_genome_that_the_catalogue_holds_finds_itself(planted: tuple[Path, list[Genome], list[Genome]]) -> None:
    root, good, copies = planted
    hits = similar_to_genome(open_signatures(root), good[3], 4)
    assert [hit.design_id for hit in hits[:2]] == [good[3].design_id, copies[3].design_id]
    assert hits[0].distance == 0.0
    assert hits[0].aligned_distance == pytest.approx(0.0, abs=1e-9)


def manifest_marks(root: Path) -> dict[str, np.ndarray]:
    table = Catalogue.open(root).designs(["design_id", "descriptor", "d0", "d2"])
    rows = table.to_pylist()
    return {row["design_id"]: signatures([row["descriptor"]], [row["d0"]], [row["d2"]])[0] for row in rows}


def test_the_index_is_made_again_when_parts_appear_or_its_file_is_damaged_or_lost(root: Path) -> None:
    used = writer(root)
    used.commit(*designs(range(8)), b"", (0, 0))
    assert len(open_signatures(root)) == 8
    (before,) = (root / INDEX).iterdir()
    used.commit(*designs(range(6, 20), epoch=[0] * 14), b"", (1, 1))  # two of them again, born before
    index = open_signatures(root)
    (after,) = (root / INDEX).iterdir()
    assert before != after
    expected = manifest_marks(root)
    assert [index.design_id(place) for place in range(len(index))] == sorted(expected)
    for place in range(len(index)):
        assert index.marks[:, place] == pytest.approx(expected[index.design_id(place)], rel=1e-5)
    content = bytearray(after.read_bytes())
    content[len(content) // 2] ^= 1
    after.write_bytes(bytes(content))
    np.testing.assert_array_equal(open_signatures(root).marks, index.marks)
    after.unlink()
    np.testing.assert_array_equal(open_signatures(root).marks, index.marks)


def test_rows_come_from_where_the_index_says(root: Path) -> None:
    used = writer(root)
    for epoch in range(3):
        used.commit(*designs(range(8 * epoch, 8 * epoch + 8)), b"", (epoch, epoch))
    index = open_signatures(root)
    places = np.random.default_rng(0).permutation(24)[:9]
    rows = index.rows(places, ["design_id", "fitness"])
    assert [row["design_id"] for row in rows] == [index.design_id(place) for place in places]
    assert [np.float32(row["fitness"]) for row in rows] == index.fitness[places].tolist()


def test_the_nearest_are_what_brute_force_finds_and_designs_without_descriptor_are_left_out(root: Path) -> None:
    table, clouds = designs(range(30))
    table = table.set_column(
        table.schema.get_field_index("descriptor"),
        table.schema.field("descriptor"),
        pa.array(
            [None if row % 3 == 0 else value for row, value in enumerate(table.column("descriptor").to_pylist())],
            table.schema.field("descriptor").type,
        ),
    )
    writer(root).commit(table, clouds, b"", (0, 0))
    index = open_signatures(root)
    known = np.flatnonzero(np.isfinite(index.marks).all(axis=0))
    assert len(known) == 20
    mark = index.marks[:, known[4]]
    apart = np.linalg.norm(index.marks[:, known].T - mark, axis=1)
    assert index.nearest(mark, 7).tolist() == known[np.argsort(apart)[:7]].tolist()
    assert len(index.nearest(mark, 100)) == 20
    unknown = index.design_id(int(np.flatnonzero(np.isnan(index.marks[0]))[0]))
    with pytest.raises(InputError, match="has no descriptor"):
        similar_to_design(index, unknown, 3)


def test_an_empty_catalogue_has_nothing_similar(root: Path) -> None:
    open_signatures(root)
    index = open_signatures(root)
    assert len(index) == 0
    assert index.nearest(np.zeros(6), 3).tolist() == []
    with pytest.raises(InputError, match="no design abcd"):
        similar_to_design(index, "abcd", 3)


def test_a_question_gets_the_same_answer_with_and_without_the_index(
    root: Path, planted: tuple[Path, list[Genome], list[Genome]]
) -> None:
    good = planted[1]
    commit(root, good[:5], 0)
    commit(root, good[3:8], 1)  # two designs are there twice
    catalogue = Catalogue.open(root)

    def asked() -> list[Any]:
        where, columns = pa.compute.field("fitness") > 0.86, ["design_id", "fitness", "epoch"]
        answers = [catalogue.select(columns, order=(name, False), limit=6) for name in ("fitness", "design_id")]
        return [*answers, catalogue.select(columns, where, ["fitness"]), catalogue.select(columns, ancestors=True)]

    before = asked()
    open_signatures(root)
    assert list((root / INDEX).iterdir())
    assert before[0][1] == 8
    assert asked() == before
    # What is committed later counts, though the file does not know it.
    commit(root, good[8:10], 2)
    assert catalogue.select(["design_id"])[1] == 10
