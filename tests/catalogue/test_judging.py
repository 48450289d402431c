"""Judgements: nothing acknowledged is lost, nobody gets in each other's way, and no digest knows of them."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fractal_farm.catalogue import Catalogue, judge, judgements, with_judgements, withdraw
from fractal_farm.catalogue.judging import Judgement
from fractal_farm.catalogue.verify import Remakers, repair, verify
from fractal_farm.errors import InputError
from tests.catalogue.examples import commit_epochs, genome

HOUSE = Path(__file__).resolve().parents[2]
JUDGE_FOR_EVER = """
import sys
from pathlib import Path
from fractal_farm.catalogue import judge
for number in range(100_000):
    judge(Path(sys.argv[1]), [f"{number:032x}"], stars=number % 6)
    print(number, flush=True)
"""


def ids(count):
    return [genome(number).design_id for number in range(count)]


def judge_ten(root, worker):
    for number in range(10):
        judge(root, [f"{worker:02x}{number:030x}", "f" * 32], stars=worker)


def test_the_last_judgement_counts_and_each_word_stands_for_itself(root):
    one, two, three = ids(3)
    judge(root, [one, two], stars=2)
    judge(root, [one], favourite=True)
    judge(root, [two, three], stars=5, favourite=True)
    judge(root, [two], favourite=False)
    assert judgements(root) == {one: Judgement(2, True), two: Judgement(5), three: Judgement(5, True)}
    assert withdraw(root, [three]) == {three: Judgement()}
    assert set(judgements(root)) == {one, two}


@pytest.mark.parametrize("stars", [-1, 6])
def test_other_stars_are_refused_and_leave_nothing(root, stars):
    with pytest.raises(InputError, match=r"0 .* to 5"):
        judge(root, ids(1), stars=stars)
    assert not judgements(root)


def test_a_table_gets_stars_and_favourites_row_by_row(root):
    commit_epochs(root, 0, 1)
    chosen = ids(3)
    judge(root, chosen[:2], stars=0)
    judge(root, chosen[2:], favourite=True)
    table = with_judgements(root, Catalogue.open(root).designs(["design_id"]))
    rows = {row["design_id"]: (row["stars"], row["favourite"]) for row in table.to_pylist()}
    assert [rows[identity] for identity in chosen] == [(0, False), (0, False), (None, True)]
    assert sum(row == (None, False) for row in rows.values()) == len(rows) - 3 == 13


def test_judgements_leave_the_digest_as_it_is(root):
    commit_epochs(root, 0, 1)
    before = Catalogue.open(root).digest()
    judge(root, ids(4), stars=1)
    assert Catalogue.open(root).digest() == before


def test_processes_that_judge_at_the_same_time_lose_nothing(root):
    context = multiprocessing.get_context("fork")
    workers = [context.Process(target=judge_ten, args=(root, worker)) for worker in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
        assert worker.exitcode == 0
    found = judgements(root)
    assert len(found) == 41
    assert len(list((root / "runs/hand").glob("judgement~*.json"))) == 40


def test_a_kill_at_any_instant_loses_no_acknowledged_judgement(root):
    for life in range(4):
        child = subprocess.Popen(
            [sys.executable, "-c", JUDGE_FOR_EVER, str(root)],
            cwd=HOUSE,
            env=os.environ | {"PYTHONPATH": str(HOUSE)},
            stdout=subprocess.PIPE,
            text=True,
        )
        child.stdout.readline()
        time.sleep(0.03 * life)
        child.send_signal(signal.SIGKILL)
        acknowledged = [0, *map(int, child.stdout.read().split())]
        child.wait()
        found = judgements(root)
        assert all(found[f"{number:032x}"].stars == number % 6 for number in acknowledged)
    assert not [finding for finding in verify(root).findings if finding.damage]


@pytest.fixture
def judged(root):
    commit_epochs(root, 0, 0)
    for number, identity in enumerate(ids(3)):
        judge(root, [identity], stars=number)
    return root


def mend(root):
    return repair(root, "full", Remakers({}, lambda *_: {}))


def test_a_flipped_bit_in_a_judgement_is_found_and_restored(judged):
    path = next((judged / "runs/hand").glob("judgement~00000001~*"))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(content)
    (finding,) = (finding for finding in verify(judged, "quick").findings if finding.kind != "run")
    assert finding.damage
    assert finding.path == f"runs/hand/{path.name}"
    mend(judged)
    assert judgements(judged)[ids(2)[1]] == Judgement(1)


def test_a_lost_judgement_is_found_and_the_others_stay(judged):
    next((judged / "runs/hand").glob("judgement~00000001~*")).unlink()
    findings = [finding for finding in verify(judged, "quick").findings if finding.kind == "judgement"]
    assert [finding.path for finding in findings] == ["runs/hand/judgement~00000001"]
    mend(judged)
    assert not [finding for finding in verify(judged).findings if finding.kind == "judgement"]
    assert set(judgements(judged)) == {ids(3)[0], ids(3)[2]}
