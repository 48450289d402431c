"""`farm gallery`: the same pages and data in files, the same bytes each time, and nothing of this machine in them."""

import json
import shutil
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import httpx
import numpy as np
import pytest

from fractal_farm.catalogue import Catalogue
from fractal_farm.cli import main
from fractal_farm.studio.static_files import static_files


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_):
        """Nothing."""


@pytest.fixture(scope="module")
def site(small_catalogue, tmp_path_factory):
    path = tmp_path_factory.mktemp("web") / "site"
    assert main(["gallery", str(small_catalogue), "--out", str(path)]) == 0
    return path


def facts_of(site):
    return json.loads((site / "data/catalogue.json").read_bytes())


def test_the_same_catalogue_gives_the_same_bytes(site, small_catalogue, tmp_path):
    assert main(["gallery", str(small_catalogue), "--out", str(tmp_path / "again")]) == 0
    names = sorted(path.relative_to(site) for path in site.rglob("*") if path.is_file())
    assert names == sorted(path.relative_to(tmp_path / "again") for path in tmp_path.rglob("*") if path.is_file())
    for name in names:
        assert (site / name).read_bytes() == (tmp_path / "again" / name).read_bytes()


def test_pages_are_those_of_the_studio(site):
    for name, path in static_files().items():
        assert (site / name).read_bytes() == path.read_bytes()


def test_data_are_those_that_a_studio_serves(site, studio):
    here, there = facts_of(site), studio.facts()
    assert here["version"] == there["version"]
    assert (here["server"], here["live"], here["token_needed"]) == (False, False, False)
    for name in ("columns.bin", "maps/0.bin"):
        path = f"data/{here['version']}/{name}"
        assert (site / path).read_bytes() == studio.get(path).content


def test_details_are_what_the_studio_tells_of_each_design(site, studio):
    facts = facts_of(site)
    block = json.loads((site / f"data/{facts['version']}/details/0.json").read_bytes())
    assert len(block) == min(facts["rows"], facts["block"])
    for told in block[::9]:
        served = studio.get(f"api/design/{told['design_id']}").json()
        for name in sorted(set(served) - {"commands", "solids", "children"}):
            assert told[name] == served[name], name
        assert {child["design_id"] for child in told["children"]} <= {c["design_id"] for c in served["children"]}


def test_similar_designs_are_the_nearest_signatures(site):
    facts = facts_of(site)
    block = json.loads((site / f"data/{facts['version']}/details/0.json").read_bytes())
    for told in block[:20]:
        distances = [alike["distance"] for alike in told["similar"]]
        assert distances == sorted(distances)
        assert told["row"] not in [alike["row"] for alike in told["similar"]]
        assert all(block[alike["row"]]["design_id"] == alike["design_id"] for alike in told["similar"])


def test_only_the_designs_of_a_filter_are_there(small_catalogue, tmp_path):
    middle = float(np.median(Catalogue.open(small_catalogue).designs(["fitness"]).column(0).to_pylist()))
    condition = f"fitness > {middle!r}"
    assert main(["gallery", str(small_catalogue), "--out", str(tmp_path / "few"), "--where", condition]) == 0
    facts = facts_of(tmp_path / "few")
    block = json.loads((tmp_path / "few" / f"data/{facts['version']}/details/0.json").read_bytes())
    expected = [
        row["design_id"]
        for row in Catalogue.open(small_catalogue).designs(["design_id", "fitness"]).to_pylist()
        if row["fitness"] > middle
    ]
    assert [told["design_id"] for told in block] == expected
    assert [told["row"] for told in block] == list(range(len(expected)))


def test_favourites_alone_can_be_shown(small_catalogue, tmp_path):
    shutil.copytree(small_catalogue, tmp_path / "run")
    chosen = Catalogue.open(small_catalogue).designs(["design_id"]).column(0).to_pylist()[3]
    assert main(["rate", str(tmp_path / "run"), chosen, "--favourite"]) == 0
    where = ["--where", "favourite and fitness > 0"]
    assert main(["gallery", str(tmp_path / "run"), "--out", str(tmp_path / "one"), *where]) == 0
    facts = facts_of(tmp_path / "one")
    (told,) = json.loads((tmp_path / "one" / f"data/{facts['version']}/details/0.json").read_bytes())
    assert (told["design_id"], told["judgement"]["favourite"]) == (chosen, True)


def test_nothing_of_this_machine_is_in_it(site, small_catalogue):
    for path in (site / "data").rglob("*.json"):
        content = path.read_text()
        assert str(small_catalogue.parent) not in content
        assert str(Path.home()) not in content


def test_any_web_host_serves_it_below_any_path(site):
    handler = partial(Quiet, directory=str(site.parent))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/site/"
        facts = httpx.get(url + "data/catalogue.json").json()
        assert httpx.get(f"{url}data/{facts['version']}/columns.bin").status_code == 200
        assert httpx.get(url).status_code == 200
        server.shutdown()


def test_bad_input_is_one_line(site, small_catalogue, tmp_path, capsys):
    for arguments, word in (
        ([str(tmp_path / "nothing"), "--out", str(tmp_path / "x")], "no such directory"),
        ([str(small_catalogue), "--out", str(site)], "is there already"),
        ([str(small_catalogue), "--out", str(tmp_path / "x"), "--where", "fitness > 2"], "no designs"),
        ([str(small_catalogue), "--out", str(tmp_path / "x"), "--where", "fitnes > 0"], "did you mean"),
    ):
        assert main(["gallery", *arguments]) == 2
        error = capsys.readouterr().err
        assert word in error
        assert error.count("\n") == 1
        assert not (tmp_path / "x").exists()
