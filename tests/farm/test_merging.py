"""One catalogue out of several: every design once, runs that stay what they were, whatever the order."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue, committed_records, committed_until, judge, judgements, run_lock
from fractal_farm.catalogue.layout import DESIGNS, crc32c
from fractal_farm.catalogue.parts import encoded_part, list_parts, read_commits, read_rows
from fractal_farm.catalogue.schema import DESIGN_SCHEMA, ORDER_OF_BIRTH
from fractal_farm.catalogue.steering import bind_wishes, record_wish, steering_requests
from fractal_farm.catalogue.verify import verify
from fractal_farm.distinctness import DistinctSet, signatures
from fractal_farm.errors import FarmError, InputError
from fractal_farm.farm.merging import merge
from fractal_farm.hand.keeping import keep
from fractal_farm.ifs.genome import Genome
from tests.farm.runs import small_config

LONG, LONGER = "stop.epochs=6", "stop.epochs=7"


def grown(path: Path, *overrides: str) -> Path:
    farm.submit(small_config("stop.epochs=4", *overrides), path, executor="serial")
    return path


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """A run; the same grown on in a copy; the same grown again elsewhere, for longer; another one with another seed."""
    place = tmp_path_factory.mktemp("sources")
    first = grown(place / "first")
    longer = Path(shutil.copytree(first, place / "longer"))
    farm.resume(longer, overrides=[LONG], executor="serial")
    elsewhere = grown(place / "elsewhere", "stop.epochs=5", "solids.max=1")
    other = grown(place / "other", "evolution.seed=8")
    return [first, longer, elsewhere, other]


@pytest.fixture(scope="module")
def merged(sources, tmp_path_factory):
    out = tmp_path_factory.mktemp("merged") / "out"
    told = merge(out, sources)
    assert told.designs == Catalogue.open(out).designs(["design_id"]).num_rows
    return out


def contents(root: Path) -> dict[str, bytes]:
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


def test_the_order_of_the_sources_does_not_matter(sources, merged, tmp_path):
    merge(tmp_path / "again", [*sources[::-1], sources[0]])
    assert contents(tmp_path / "again") == contents(merged)


def test_the_designs_are_the_union_and_of_equal_ones_the_first_born_stands(sources, merged):
    births: dict[str, tuple[int, ...]] = {}
    for source in sources:
        for row in Catalogue.open(source).designs(["design_id", *ORDER_OF_BIRTH]).to_pylist():
            birth = tuple(row[name] for name in ORDER_OF_BIRTH)
            births[row["design_id"]] = min(birth, births.get(row["design_id"], birth))
    rows = Catalogue.open(merged).designs(["design_id", *ORDER_OF_BIRTH]).to_pylist()
    assert {row["design_id"]: tuple(row[name] for name in ORDER_OF_BIRTH) for row in rows} == births


def test_a_merged_catalogue_is_sound_and_its_runs_are_what_they_were(sources, merged):
    assert verify(merged, "full").findings == ()
    catalogue = Catalogue.open(merged)
    _, longer, _, other = map(Catalogue.open, sources)
    (first_run,), (other_run,) = longer.runs(), other.runs()
    assert catalogue.digest(first_run.run_id) == longer.digest()
    assert catalogue.digest(other_run.run_id) == other.digest()
    assert [len(run.ends) for run in catalogue.runs() if run.run_id == first_run.run_id] == [3]
    assert committed_until(merged, first_run.run_id) == committed_until(longer.path, first_run.run_id) == 5
    assert list(committed_records(merged, other_run.run_id)) == list(committed_records(other.path, other_run.run_id))
    assert len(catalogue.solids()) == 1
    for identity in catalogue.designs(["design_id"]).column(0).to_pylist()[::50]:
        holder = next(source for source in (longer, other) if identity in ids_of(source))
        np.testing.assert_array_equal(catalogue.points(identity), holder.points(identity))


def ids_of(catalogue: Catalogue) -> set[str]:
    return set(catalogue.designs(["design_id"]).column(0).to_pylist())


def test_the_best_of_each_shape_is_marked(merged):
    table = Catalogue.open(merged).designs(["descriptor", "d0", "d2", "distinct"])
    marks = signatures(np.array(table.column(0).to_pylist()), table.column(1).to_numpy(), table.column(2).to_numpy())
    _, entered = DistinctSet(np.zeros((0, 6))).sift(marks)
    assert table.column("distinct").to_pylist() == entered
    assert 0 < sum(entered) < len(entered)


def test_runs_go_on_in_a_merged_catalogue_as_if_nothing_had_happened(merged, tmp_path):
    path = Path(shutil.copytree(merged, tmp_path / "copy"))
    for seed in (7, 8):
        config = small_config(f"evolution.seed={seed}", LONGER)
        farm.resume(path, run=config.run_id, overrides=[LONGER], executor="serial")
        alone = farm.submit(config, tmp_path / str(seed), executor="serial")
        assert Catalogue.open(path).digest(config.run_id) == alone.ended.digest
    assert verify(path, "full").findings == ()


def test_the_sources_stay_as_they_are(sources, tmp_path):
    before = [contents(source) for source in sources]
    merge(tmp_path / "out", sources)
    assert [contents(source) for source in sources] == before


def test_a_damaged_cloud_comes_from_another_source_or_not_at_all(sources, tmp_path):
    first, longer = (Path(shutil.copytree(source, tmp_path / source.name)) for source in sources[:2])
    shard = next(first.glob("clouds/*/points/c.0.0.0")).relative_to(first)
    whole = (first / shard).read_bytes()
    (first / shard).write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    merge(tmp_path / "out", [first, longer])
    assert (tmp_path / "out" / shard).read_bytes() == whole
    (longer / shard).unlink()
    with pytest.raises(FarmError, match=r"missing or damaged in all sources; `farm verify --repair`"):
        merge(tmp_path / "again", [first, longer])
    assert not list(tmp_path.glob("*again*"))


def test_what_does_not_fit_together_is_refused_and_leaves_nothing(sources, tmp_path):
    stricter = grown(tmp_path / "stricter", "catalogue.keep=qualified")
    run_id = small_config().run_id
    with pytest.raises(InputError, match=r"keeps what is (accepted|qualified) in .*; merge one of them"):
        merge(tmp_path / "out", [sources[0], stricter])
    with run_lock(stricter, run_id), pytest.raises(InputError, match="is at work"):
        merge(tmp_path / "out", [stricter])
    with pytest.raises(InputError, match="no such directory"):
        merge(tmp_path / "out", [stricter, tmp_path / "nowhere"])
    with pytest.raises(InputError, match="lies in"):
        merge(stricter / "out", [stricter])
    with pytest.raises(InputError, match="is a file; name another place"):
        merge(stricter / "zarr.json" / "out", [stricter])
    assert os.listdir(tmp_path) == ["stricter"]  # noqa: PTH208


def test_what_people_made_and_said_is_there_and_what_was_said_last_counts(sources, tmp_path):
    first, other = (Path(shutil.copytree(sources[k], tmp_path / str(k))) for k in (0, 3))
    ids = [Catalogue.open(root).select(["design_id"], limit=2)[0].column(0).to_pylist() for root in (first, other)]
    variants = []
    for root, (identity, _) in zip((first, other), ids, strict=True):
        genome = Catalogue.open(root).genome(identity)
        variants.append(Genome(genome.genes * 0.99, genome.phenotype))
        keep(root, variants[-1:], [identity])
    judge(first, ids[0], stars=2)
    judge(other, [ids[0][0], ids[1][0]], stars=4, favourite=True)
    judge(first, ids[0][1:], stars=5)
    merge(tmp_path / "out", [other, first])
    found = judgements(tmp_path / "out")
    assert {identity: str(judgement) for identity, judgement in found.items()} == {
        ids[0][0]: "4 stars, favourite",
        ids[0][1]: "5 stars",
        ids[1][0]: "4 stars, favourite",
    }
    catalogue = Catalogue.open(tmp_path / "out")
    assert {variant.design_id for variant in variants} <= ids_of(catalogue)
    assert not [finding for finding in verify(tmp_path / "out", "deep").findings if finding.damage]


def test_a_run_that_was_steered_in_two_ways_is_refused(sources, tmp_path):
    run_id = small_config().run_id
    roots = [Path(shutil.copytree(sources[0], tmp_path / str(k))) for k in (1, 2, 3)]
    best, second = Catalogue.open(sources[0]).select(["design_id"], limit=2)[0].column(0).to_pylist()
    for root, identity in zip(roots[1:], (best, second), strict=True):
        record_wish(root, run_id, [Catalogue.open(root).genome(identity)])
        bind_wishes(root, run_id, 4)
    merge(tmp_path / "one", roots[:2])
    assert len(steering_requests(tmp_path / "one", run_id)) == 1
    with pytest.raises(InputError, match=r"was steered in .* otherwise than in"):
        merge(tmp_path / "both", roots)
    farm.resume(roots[0], overrides=[LONG], executor="serial")
    with pytest.raises(InputError, match=r"was steered in .* otherwise than in"):  # it has gone on without
        merge(tmp_path / "diverged", roots[:2])


def test_requests_and_wishes_of_every_source_are_kept(sources, tmp_path):
    run_id = small_config().run_id
    behind, ahead = (Path(shutil.copytree(source, tmp_path / source.name)) for source in sources[:2])
    genome = Catalogue.open(behind).genome(Catalogue.open(behind).select(["design_id"], limit=1)[0][0][0].as_py())
    bound = record_wish(behind, run_id, [genome])
    bind_wishes(behind, run_id, 6)
    waiting = record_wish(behind, run_id, [genome])
    merge(tmp_path / "out", [behind, ahead])
    assert [request.wish for request in steering_requests(tmp_path / "out", run_id)] == [bound]
    assert [request.wish for request in bind_wishes(tmp_path / "out", run_id, 6)] == [waiting]


def test_a_part_that_refers_to_what_is_no_cloud_of_its_writer_takes_nothing_else_along(sources, tmp_path):
    root = Path(shutil.copytree(sources[0], tmp_path / "box" / "root"))
    (tmp_path / "box" / "bait").write_bytes(b"bait")
    name = list_parts(root)[0]
    (commit,) = read_commits(root, name)
    stray = replace(commit, files={**commit.files, "../bait": (4, crc32c(b"bait"))})
    forged, content = encoded_part(read_rows(root, name, DESIGN_SCHEMA.names), name.writer, stray)
    (root / DESIGNS / name.file_name).unlink()
    (root / DESIGNS / forged.file_name).write_bytes(content)
    merge(tmp_path / "out", [root])
    assert not list(tmp_path.glob("bait"))
