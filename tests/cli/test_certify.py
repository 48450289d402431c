"""`farm certify` on a design of a real run; files are certified in tests/solid/test_certificate.py."""

import json

from fractal_farm.catalogue import Catalogue
from fractal_farm.cli import main


def test_certify_makes_the_solid_of_a_design_for_the_material(capsys, run_directory):
    identity = Catalogue.open(run_directory).designs().slice(0, 1).to_pylist()[0]["design_id"]
    code = main(["certify", str(run_directory), identity[:8], "--material", "resin", "--size", "25", "--json"])
    report = json.loads(capsys.readouterr().out)
    assert report["design_id"] == identity
    assert report["material"] == "resin"
    assert abs(max(report["box_mm"]) - 25.0) < 1e-3
    assert (code == 0) == (report["verdict"] == "pass")


def test_certify_names_an_unknown_design_in_one_line(capsys, run_directory):
    assert main(["certify", str(run_directory), "ffffffffffff"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_certificate_that_a_run_stores_is_what_certify_says(capsys, run_directory):
    (solid,) = Catalogue.open(run_directory).solids()
    parameters = solid.facts["parameters"]
    lengths = ["--size", str(parameters["size_mm"]), "--wall", str(parameters["wall_mm"])]
    code = main(["certify", str(run_directory), solid.design_id, *lengths, "--json"])
    certified = json.loads(capsys.readouterr().out)
    assert main(["show", str(run_directory), solid.design_id, "--json"]) == 0
    (stored,) = json.loads(capsys.readouterr().out)["certificates"]
    assert stored | {"source": None} == certified | {"source": None}
    assert main(["show", str(run_directory), solid.design_id]) == 0
    shown = capsys.readouterr().out
    assert ("passes for silver" if code == 0 else "does not pass for silver") in shown
