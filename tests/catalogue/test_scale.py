"""Two hundred thousand designs and more: the answers of commands are right, and memory stays small."""

import json
import os
import subprocess
import sys
from pathlib import Path

import duckdb
import pyarrow.parquet as pq
import pytest

from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue.parts import list_parts
from tests.catalogue import synthetic

pytestmark = pytest.mark.slow

DESIGNS = 200_000
HOUSE = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def large(tmp_path_factory):
    """A large catalogue in small parts."""
    return synthetic.write(tmp_path_factory.mktemp("large") / "catalogue", DESIGNS, 1000)


COMMAND = """
import re, sys
from pathlib import Path
from fractal_farm.cli import main
code = main()
print(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1], file=sys.stderr)
sys.exit(code)
"""


def farm(*arguments):
    """Output of a command, and the most memory that it took, MB."""
    environment = os.environ | {"PYTHONPATH": str(HOUSE)}
    words = [sys.executable, "-c", COMMAND, *map(str, arguments)]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    return done.stdout, int(done.stderr.split()[-1]) / 1024


def test_a_large_catalogue_is_merged_listed_looked_at_verified_and_published(large, tmp_path):
    parts = f"'{large}/manifest/designs/*.parquet'"
    best = duckdb.sql(f"from {parts} where kind = 'design' order by fitness desc, design_id limit 100").df()
    chosen = duckdb.sql(f"select count(*) from {parts} where kind = 'design' and gap < .01 and n_maps = 3").fetchall()
    digest = Catalogue.open(large).digest()

    assert farm("compact", large)[1] < 1000
    assert len(list_parts(large)) <= 6
    listed, memory = farm("list", large, "--limit", 100, "--json")
    assert [row["design_id"] for row in json.loads(listed)] == best.design_id.to_list()
    assert memory < 300
    filtered, _ = farm("list", large, "--where", "gap < .01 and n_maps == 3", "--format", "csv", "--columns", "gap")
    assert filtered.count("\n") == chosen[0][0] + 1
    shown, memory = farm("show", large, best.design_id[57][:12], "--json")
    assert json.loads(shown)["parents"] == best.parents[57].tolist()
    assert memory < 300

    status, memory = farm("status", large, "--json")
    facts = json.loads(status)
    assert (facts["state"], facts["designs"], facts["digest"]) == ("ended", DESIGNS, digest)
    assert facts["refused"] == 5 * facts["epochs"]
    assert memory < 400
    assert json.loads(farm("verify", large, "quick", "--json")[0])["findings"] == []
    verified = json.loads(farm("verify", large, "full", "--json")[0])
    assert (verified["findings"], verified["digest"]) == ([], digest)

    _, memory = farm("export", large, "--to", tmp_path / "out", "--no-clouds")
    table = pq.read_table(tmp_path / "out" / "designs.parquet", columns=["design_id", "fitness"])
    assert table.equals(Catalogue.open(large).designs(["design_id", "fitness"]))
    assert memory < 700
