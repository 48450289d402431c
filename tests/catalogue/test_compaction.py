"""Merging parts: the same rows, records and digest before, after and at any instant in between."""

from fractal_farm.catalogue import Catalogue, committed_records, remove_orphans
from fractal_farm.catalogue.compaction import compact
from fractal_farm.catalogue.parts import list_parts
from fractal_farm.catalogue.verify import verify
from tests.catalogue.examples import RUN, commit_epochs


def test_a_compacted_catalogue_tells_the_same(root):
    commit_epochs(root, 0, 9)
    before = Catalogue.open(root)
    rows, digest, records = before.designs(), before.digest(), list(committed_records(root, RUN))
    clouds = before.dense_points()[:]
    done = compact(root, RUN)
    assert (done.before, done.after) == (10, 1)
    assert len(list_parts(root)) == 1
    after = Catalogue.open(root)
    assert after.designs().equals(rows)
    assert after.digest() == digest
    assert list(committed_records(root, RUN)) == records
    assert (after.dense_points()[:] == clouds).all()
    assert remove_orphans(root, RUN) == 0
    print(verify(root, "full"))
