import hashlib
import itertools
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fractal_farm.catalogue import Catalogue
from fractal_farm.ifs.quantised_cloud import QuantisedClouds
from tests.catalogue.examples import designs, genome, records, writer

COUNT = 12


def in_plain_words(rows):
    """The content digest, written down a second time, row by row."""
    digest = hashlib.blake2b(digest_size=16, person=b"farm-content-1")
    for row in sorted(rows, key=lambda row: row["design_id"]):
        texts = [row[name].encode() for name in ("design_id", "kind", "operator")]
        lists = [row[name] for name in ("genes", "maps", "probabilities", "parents")]
        integers = [row[name] for name in ("island", "epoch", "generation", "slot", "cloud_crc32c")]
        numbers = [row[name] for name in ("d0", "d2", "lle", "fitness", "gap")]
        digest.update(struct.pack("<12q", *map(len, texts), *map(len, lists), *integers))
        digest.update(struct.pack("<5d", *numbers))
        digest.update(struct.pack("<14f", *row["descriptor"]))
        digest.update(b"".join(texts))
        for values in lists[:3]:
            digest.update(struct.pack(f"<{len(values)}d", *values))
        digest.update(" ".join(lists[3]).encode())
    return digest.hexdigest()


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """Digest of the twelve designs committed at once."""
    return digest_of(tmp_path_factory.mktemp("whole"), [range(COUNT)])


def digest_of(folder, groups, **options):
    catalogue = Catalogue.create(folder / "my.farm")
    for attempt, numbers in enumerate(groups):
        used = writer(catalogue.path, attempt=attempt, **options)
        used.commit(*designs(list(numbers)), records(attempt), (attempt, attempt))
    return catalogue.digest()


def test_the_digest_is_what_its_definition_says(root):
    writer(root).commit(*designs(range(COUNT)), records(0), (0, 0))
    catalogue = Catalogue.open(root)
    assert catalogue.digest() == in_plain_words(catalogue.designs().to_pylist())


@settings(max_examples=12)
@given(st.permutations(range(COUNT)), st.sets(st.integers(0, COUNT)), st.lists(st.integers(0, COUNT - 1), max_size=5))
def test_grouping_order_writers_and_duplicates_do_not_matter(tmp_path_factory, expected, order, cuts, again):
    bounds = sorted({0, COUNT} | cuts)
    groups = [order[a:b] for a, b in itertools.pairwise(bounds)] + [again]
    assert digest_of(tmp_path_factory.mktemp("grouped"), groups, node="elsewhere") == expected


def test_empty_and_absent_values_have_a_digest(root):
    columns = {"descriptor": [None] * 2, "gap": [None] * 2, "d0": [np.nan, None], "operator": [None, ""]}
    table, _ = designs(range(2), **columns)
    writer(root, clouds="none").commit(table, None, b"", (0, 0))
    assert len(Catalogue.open(root).digest()) == 32


def one_step_further(value):
    return float(np.nextafter(value, np.inf))


CHANGES = {
    "fitness": one_step_further,
    "d0": one_step_further,
    "d2": one_step_further,
    "lle": one_step_further,
    "gap": one_step_further,
    "genes": lambda genes: [*genes[:-1], one_step_further(genes[-1])],
    "maps": lambda maps: [one_step_further(maps[0]), *maps[1:]],
    "probabilities": lambda p: [one_step_further(p[0]), *p[1:]],
    "descriptor": lambda values: [*values[:-1], float(np.nextafter(np.float32(values[-1]), np.float32(2)))],
    "parents": lambda parents: [*parents, genome(99).design_id],
    "operator": lambda operator: operator + " ",
    "kind": lambda kind: "ancestor" if kind == "design" else "design",
    "island": lambda number: number + 1,
    "epoch": lambda number: number + 1,
    "generation": lambda number: number + 1,
    "slot": lambda number: number + 1,
    "design_id": lambda identity: identity[:-1] + ("0" if identity[-1] != "0" else "1"),
}


@pytest.mark.parametrize("column", CHANGES)
def test_the_smallest_change_of_one_value_changes_the_digest(tmp_path, column):
    table, _ = designs(range(COUNT))
    values = table.column(column).to_pylist()
    changed, _ = designs(range(COUNT), **{column: [*values[:5], CHANGES[column](values[5]), *values[6:]]})
    digests = []
    for i, rows in enumerate((table, changed)):
        catalogue = Catalogue.create(tmp_path / str(i))
        writer(catalogue.path, clouds="none").commit(rows, None, b"", (0, 0))
        digests.append(catalogue.digest())
    assert digests[0] != digests[1]


def test_one_bit_of_one_cloud_changes_the_digest(tmp_path, expected):
    table, clouds = designs(range(COUNT))
    points = clouds.points.copy()
    points[7, 20, 1] ^= 1
    catalogue = Catalogue.create(tmp_path / "other")
    writer(catalogue.path).commit(table, QuantisedClouds(points, clouds.origin, clouds.scale), b"", (0, 0))
    assert catalogue.digest() != expected


@pytest.mark.parametrize("column", ["d0_error", "similarity_dimension", "niche", "generator_version"])
def test_what_does_not_belong_to_the_result_does_not_matter(tmp_path, expected, column):
    table, clouds = designs(range(COUNT))
    values = table.column(column).to_pylist()
    other = "another" if column == "generator_version" else 3
    changed, _ = designs(range(COUNT), **{column: [*values[:5], other, *values[6:]]})
    catalogue = Catalogue.create(tmp_path / "other")
    writer(catalogue.path).commit(changed, clouds, b"", (0, 0))
    assert catalogue.digest() == expected
