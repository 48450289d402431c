"""The mirror of a catalogue in an object store: sound at every instant, one catalogue's alone, and back bit for bit."""

import io
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from PIL import Image

from fractal_farm.catalogue import Catalogue, create_run, record_end, write_snapshot
from fractal_farm.catalogue.compaction import compact_all
from fractal_farm.catalogue.documents import encoded_document
from fractal_farm.catalogue.judging import judge, judgements
from fractal_farm.catalogue.layout import CLOUDS, DESIGNS, crc32c
from fractal_farm.catalogue.mirror import Store, StoreError, fetch, keeping, kept
from fractal_farm.catalogue.parts import list_parts, read_rows
from fractal_farm.catalogue.solids import add_solid
from fractal_farm.catalogue.verify import verify
from fractal_farm.config import RunConfig
from fractal_farm.errors import FarmError, InputError
from tests.catalogue.examples import RUN, commit_epochs, files, genome

HOUSE = Path(__file__).resolve().parents[2]
SOLID = {"solid.json": b"{}", "solid.stl": bytes(2000), "solid.glb": bytes(1000)}
OWN = ("index/", f"runs/{RUN}/lock")


def grow(root, first, last):
    """Epochs, in two writers, with all that a session leaves behind."""
    middle = (first + last) // 2
    commit_epochs(root, first, middle)
    commit_epochs(root, middle + 1, last, attempt=last)
    write_snapshot(root, RUN, last, bytes(500), "process")
    add_solid(root, genome(first).design_id, "30x08", SOLID, "process")
    picture = io.BytesIO()
    Image.new("RGB", (8, 8)).save(picture, "PNG")
    (root / "catalogue.png").write_bytes(picture.getvalue())
    record_end(root, RUN, {"progress": {"epochs": last + 1}, "digest": Catalogue.open(root).digest(RUN)}, "process")
    (root / "logs").mkdir(exist_ok=True)
    (root / "logs" / f"{RUN}.jsonl").write_text('{"event": "RunEnded"}\n')


@pytest.fixture
def grown(root):
    """A catalogue with one finished run of six epochs."""
    create_run(root, RUN, {"config": RunConfig().to_dict()}, "process")
    grow(root, 0, 5)
    return root


def mirror(root, url, everything=True):
    """Bring the mirror up to date, as `farm mirror` does."""
    with kept(root, url, "test", lambda cause, remedy: None) as uploader:
        uploader.catch_up(lambda backlog: None, everything=everything)
    return uploader.arrived


def bring(url, root):
    return fetch(url, root, lambda fetched, commits: None)


def vouched_for(root):
    """Every file of a catalogue but those that concern one machine, with its content."""
    return {key: (root / key).read_bytes() for key in files(root) if not key.startswith(OWN)}


def assert_sound_beginning(root, whole):
    """A directory is a sound catalogue, with the first epochs of another."""
    report = verify(root, "full")
    assert [finding for finding in report.findings if finding.damage] == []
    epochs = [part.seq for part in list_parts(root)]
    assert set(list_parts(root)) <= set(list_parts(whole))
    first = commit_order(whole)[: len(epochs)]
    assert sorted(first) == list_parts(root)


def commit_order(root):
    """Parts of `grow` by epoch: the attempt is the last epoch of the session, 0 of its first half."""
    order = []
    for path in (root / DESIGNS).iterdir():
        (part,) = [part for part in list_parts(root) if part.file_name == path.name]
        table = read_rows(root, part, ["epoch"])
        order.append((max(table.column("epoch").to_pylist()), part))
    return [part for _, part in sorted(order)]


def test_a_catalogue_comes_back_bit_for_bit_and_nothing_is_carried_twice(grown, object_store, tmp_path):
    assert mirror(grown, object_store.url) > 20
    fetched = bring(object_store.url, tmp_path / "back")
    assert fetched.damaged == []
    assert vouched_for(tmp_path / "back") == vouched_for(grown)
    assert verify(tmp_path / "back", "full").findings == ()
    assert mirror(grown, object_store.url) == 0
    assert bring(object_store.url, tmp_path / "back").files == 0


def test_an_earlier_state_is_brought_up_to_date_and_a_later_one_is_refused(grown, object_store, tmp_path):
    mirror(grown, object_store.url)
    bring(object_store.url, tmp_path / "back")
    grow(grown, 6, 7)
    with pytest.raises(InputError, match=r"2 commits that .* lacks"):
        bring(object_store.url, grown)
    mirror(grown, object_store.url)
    assert bring(object_store.url, tmp_path / "back").commits == 2
    assert vouched_for(tmp_path / "back") == vouched_for(grown)


def test_what_people_said_comes_along(grown, object_store, tmp_path):
    mirror(grown, object_store.url)
    identities = Catalogue.open(grown).designs(["design_id"]).column(0).to_pylist()[:6]
    for identity in identities:
        judge(grown, [identity], stars=5)
    mirror(grown, object_store.url)
    bring(object_store.url, tmp_path / "back")
    assert judgements(tmp_path / "back") == judgements(grown)
    assert verify(tmp_path / "back", "full").findings == ()


def test_parts_that_were_merged_reach_mirrors_and_earlier_states(grown, object_store, tmp_path):
    mirror(grown, object_store.url)
    bring(object_store.url, tmp_path / "earlier")
    grow(grown, 6, 9)
    digest = Catalogue.open(grown).digest()
    compact_all(grown)
    assert len(list_parts(grown)) == 4
    mirror(grown, object_store.url)
    for name in ("earlier", "new"):
        fetched = bring(object_store.url, tmp_path / name)
        assert fetched.damaged == []
        assert verify(tmp_path / name, "full").findings == ()
        assert Catalogue.open(tmp_path / name).digest() == digest
        assert list_parts(tmp_path / name) == list_parts(grown)
    assert mirror(grown, object_store.url) == 0


def test_parts_that_are_merged_while_they_go_up_are_passed_over(grown, object_store, tmp_path, monkeypatch):
    create = Store.put_all

    def merging(self, objects):
        if any(key.startswith(f"{CLOUDS}/") and "/points/c." in key for key in objects):
            compact_all(grown)
        create(self, objects)

    monkeypatch.setattr(Store, "put_all", merging)
    mirror(grown, object_store.url)
    bring(object_store.url, tmp_path / "back")
    assert [part.is_merged for part in list_parts(tmp_path / "back")] == [True, True]
    assert verify(tmp_path / "back", "full").findings == ()
    assert Catalogue.open(tmp_path / "back").digest() == Catalogue.open(grown).digest()


class Killed(BaseException):
    """As if the process had been killed; nothing tidies up."""


def fail_after(monkeypatch, name, calls):
    """Let so many objects go up (put_all) or come down (get_all), one by one, and then die."""
    method, left = getattr(Store, name), [calls]

    def works_for_a_while(self, objects):
        results = []
        for key in objects:
            left[0] -= 1
            if left[0] < 0:
                raise Killed
            results += method(self, {key: objects[key]} if name == "put_all" else [key]) or []
        return results or None

    monkeypatch.setattr(Store, name, works_for_a_while)


@pytest.mark.parametrize("step", [7, pytest.param(1, marks=pytest.mark.slow)])
def test_a_mirror_is_sound_after_every_single_upload(grown, object_store, tmp_path, monkeypatch, step):
    states = set()
    for puts in range(9, 100, step):  # identity, lease and what makes it a catalogue go first
        url, back = f"{object_store.url}/{puts}", tmp_path / str(puts)
        with monkeypatch.context() as patch, suppress(Killed):
            fail_after(patch, "put_all", puts)
            mirror(grown, url)
            break
        bring(url, back)
        assert_sound_beginning(back, grown)
        states.add(len(list_parts(back)))
        mirror(grown, url)  # goes on where it was interrupted
        bring(url, back)
        assert vouched_for(back) == vouched_for(grown)
    assert puts > 20
    assert states > {0, 6}
    assert states == set(range(7)) or step > 1


def test_before_there_is_a_catalogue_nothing_is_fetched(grown, object_store, tmp_path, monkeypatch):
    for puts in range(3):
        with monkeypatch.context() as patch, suppress(Killed):
            fail_after(patch, "put_all", puts)
            mirror(grown, object_store.url)
        with pytest.raises(InputError, match="no catalogue is mirrored there"):
            bring(object_store.url, tmp_path / "back")
        assert not (tmp_path / "back").exists()


@pytest.mark.parametrize("step", [5, pytest.param(1, marks=pytest.mark.slow)])
def test_a_fetch_that_was_interrupted_is_sound_and_goes_on(grown, object_store, tmp_path, monkeypatch, step):
    mirror(grown, object_store.url)
    back = tmp_path / "back"
    for gets in range(4, 100, step):
        with monkeypatch.context() as patch, suppress(Killed):
            fail_after(patch, "get_all", gets)
            bring(object_store.url, back)
            break
        if (back / f"{CLOUDS}/zarr.json").exists():
            assert_sound_beginning(back, grown)
        if gets % 2:
            shutil.rmtree(back)
    assert gets > 12
    assert vouched_for(back) == vouched_for(grown)
    assert not (back / "index/fetched").exists()


CHILD = """
import sys
from fractal_farm.cli import main
print("begun", flush=True)
sys.exit(main(["mirror", *sys.argv[1:]]))
"""


@pytest.mark.slow
def test_an_uploader_that_is_killed_at_random_leaves_a_sound_beginning(root, object_store, tmp_path):
    create_run(root, RUN, {"config": RunConfig().to_dict()}, "process")
    grow(root, 0, 40)
    chance = random.Random(5)
    environment = os.environ | {"PYTHONPATH": str(HOUSE)}
    states = []
    for _ in range(30):
        command = [sys.executable, "-c", CHILD, str(root), object_store.url]
        child = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
        assert child.stdout.readline() == "begun\n"
        time.sleep(chance.uniform(0.3, 1.2))
        child.send_signal(signal.SIGKILL)
        child.wait()
        back = tmp_path / str(len(states))
        with suppress(InputError):  # before there is a catalogue at all
            bring(object_store.url, back)
            assert_sound_beginning(back, root)
            states.append(len(list_parts(back)))
    assert states == sorted(states)
    assert mirror(root, object_store.url) >= 0
    bring(object_store.url, tmp_path / "last")
    assert vouched_for(tmp_path / "last") == vouched_for(root)


def test_the_place_of_another_catalogue_is_refused(grown, object_store, tmp_path):
    mirror(grown, object_store.url)
    other = Catalogue.create(tmp_path / "other").path
    create_run(other, RUN, {"config": RunConfig().to_dict()}, "process")
    with pytest.raises(InputError, match="holds another catalogue"):
        mirror(other, object_store.url)
    mirror(other, f"{object_store.url}/elsewhere/other")
    with pytest.raises(InputError, match="holds another catalogue"):
        mirror(other, object_store.url)
    with pytest.raises(InputError, match="not an earlier state"):
        bring(object_store.url, other)
    Store(f"{object_store.url}-strangers").put("holiday.jpg", b"beach")
    with pytest.raises(InputError, match="other objects"):
        mirror(grown, f"{object_store.url}-strangers")
    with pytest.raises(InputError, match="no catalogue is mirrored there"):
        bring(f"{object_store.url}-strangers", tmp_path / "nothing")
    assert not (tmp_path / "nothing").exists()


def test_one_process_keeps_a_mirror_and_a_dead_one_is_followed(grown, object_store, tmp_path, monkeypatch):
    monkeypatch.setattr(keeping, "LEASE_SECONDS", 1.0)
    monkeypatch.setattr(keeping, "_LOOK_SECONDS", 0.05)
    monkeypatch.setattr(keeping, "_RENEW_SECONDS", 0.0)
    mirror(grown, object_store.url)
    copy = shutil.copytree(grown, tmp_path / "other machine")
    store, said = Store(object_store.url), []
    with kept(grown, object_store.url, "run overnight", lambda *line: said.append(line)) as first:
        with pytest.raises(InputError, match="another process mirrors"):
            mirror(grown, object_store.url)
        # Another machine, while the first lives: it sees the lease renewed.
        renewed = store.get("lease.json").replace(b'"renewals": 1', b'"renewals": 2')
        monkeypatch.setattr(keeping.time, "sleep", lambda seconds: store.put("lease.json", renewed))
        with pytest.raises(InputError, match="kept by run overnight, process") as refusal:
            mirror(copy, object_store.url)
        assert "\n" not in str(refusal.value)
        monkeypatch.undo()
        for name, value in object_store.environment().items():
            monkeypatch.setenv(name, value)
        # The first is silent for long: another machine takes over, and the first one notices.
        monkeypatch.setattr(keeping, "LEASE_SECONDS", 0.3)
        monkeypatch.setattr(keeping, "_LOOK_SECONDS", 0.05)
        with kept(copy, object_store.url, "run elsewhere", lambda *line: said.append(line)):
            monkeypatch.setattr(keeping, "_RENEW_SECONDS", 0.0)
            grow(grown, 6, 7)
            with pytest.raises(keeping.LeaseLostError, match="now kept by run elsewhere"):
                first.catch_up(lambda backlog: None, everything=True)
    assert [cause for cause, _ in said] == [said[0][0]]
    assert store.get("lease.json") is None
    # Killed on the same machine: its successor does not wait.
    store.put("lease.json", json.dumps({"place": keeping._Lease(store, "x", grown)._place}).encode())
    monkeypatch.setattr(keeping, "LEASE_SECONDS", 60.0)
    mirror(grown, object_store.url)


def test_what_is_damaged_here_does_not_go_up(grown, object_store, tmp_path):
    (last,) = commit_order(grown)[-1:]
    cloud = next((grown / CLOUDS / last.writer / "points").glob("c.2.*"))
    cloud.write_bytes(bytes(cloud.stat().st_size))
    with pytest.raises(FarmError, match=r"c\.2\.0\.0: missing or damaged.*--repair"):
        mirror(grown, object_store.url)
    bring(object_store.url, tmp_path / "back")
    assert_sound_beginning(tmp_path / "back", grown)
    assert len(list_parts(tmp_path / "back")) == 5


def test_what_is_damaged_in_the_mirror_is_found_and_named(grown, object_store, tmp_path):
    mirror(grown, object_store.url)
    store = Store(object_store.url)
    part = f"{DESIGNS}/{commit_order(grown)[-1].file_name}"
    cloud = next(key for key in files(grown) if "/points/c.0" in key)
    for key in (part, cloud, f"runs/{RUN}/run.json"):
        content = bytearray(store.get(key))
        content[len(content) // 2] ^= 1
        store.put(key, bytes(content))
    assert set(bring(object_store.url, tmp_path / "back").damaged) == {part, cloud, f"runs/{RUN}/run.json"}
    assert mirror(grown, object_store.url) == 1  # run.json, which is compared; the others have their sizes


def test_nothing_is_written_outside_of_the_directory(grown, object_store, tmp_path):
    mirror(grown, object_store.url)
    store = Store(object_store.url)
    listed = {"../../../../escaped": {"bytes": 1, "crc32c": crc32c(b"x")}}
    store.put(f"solids/{32 * 'a'}/hash/checksums.json", encoded_document({"files": listed}))
    bring(object_store.url, tmp_path / "deep" / "back")
    assert not list(tmp_path.rglob("escaped"))
    assert not (tmp_path / "deep" / "back" / "solids" / (32 * "a")).exists()


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("s3://", "write s3://bucket/prefix"),
        ("file:///tmp", "write s3://bucket/prefix"),
        ("s3://bucket/../other", "write s3://bucket/prefix"),
        ("s3://nobody-has-this", "no such bucket"),
    ],
)
def test_a_place_that_cannot_be_is_refused_in_one_line(object_store, tmp_path, url, words):
    with pytest.raises(InputError, match=words) as error:
        bring(url, tmp_path / "back")
    assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_what_is_wrong_with_the_surroundings_is_said_in_one_line(object_store, tmp_path, monkeypatch):
    def said():
        with pytest.raises(FarmError) as error:
            bring(object_store.url, tmp_path / "back")
        assert "\n" not in str(error.value)
        return error

    with monkeypatch.context() as patch:
        patch.delenv("AWS_ACCESS_KEY_ID")
        patch.delenv("AWS_SECRET_ACCESS_KEY")
        assert "no credentials; set AWS_ACCESS_KEY_ID" in str(said().value)
    with monkeypatch.context() as patch:
        patch.delenv("AWS_ALLOW_HTTP")
        assert "AWS_ALLOW_HTTP=true" in str(said().value)
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "obstore.store", None)
        assert "pip install -c constraints.txt 'fractal-farm[s3]'" in str(said().value)
    object_store.stop()
    error = said()
    assert "does not answer" in str(error.value)
    assert error.type is StoreError
    assert list(tmp_path.iterdir()) == []
