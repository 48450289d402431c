import json

import pytest

from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue.verify import verify
from fractal_farm.errors import FarmError, InputError
from tests.catalogue.examples import files

DESIGN = "0" * 31 + "a"
FILES = {"solid.json": b'{"watertight": true}', "design.glb": b"glTF", "design.stl": b"solid"}


def test_a_solid_comes_back_with_its_files_and_facts(root):
    catalogue = Catalogue.open(root)
    assert catalogue.add_solid(DESIGN, "abc123", FILES)
    (solid,) = catalogue.solids()
    assert (solid.design_id, solid.parameters_hash, solid.facts) == (DESIGN, "abc123", {"watertight": True})
    assert {name: path.read_bytes() for name, path in solid.files.items()} == FILES


def test_a_solid_is_stored_once(root):
    catalogue = Catalogue.open(root)
    catalogue.add_solid(DESIGN, "abc123", FILES)
    before = files(root)
    assert not catalogue.add_solid(DESIGN, "abc123", FILES | {"design.glb": b"other"})
    assert files(root) == before
    assert catalogue.add_solid(DESIGN, "other", FILES)
    assert [solid.parameters_hash for solid in catalogue.solids()] == ["abc123", "other"]


def test_a_half_written_solid_is_none(root):
    partial = root / "solids" / DESIGN / ".abc.0.partial"
    partial.mkdir(parents=True)
    (partial / "solid.json").write_bytes(b"{}")
    assert Catalogue.open(root).solids() == []


@pytest.mark.parametrize("name", ["../escape", "a/b", ".hidden", "", "checksums.json", "a\nb"])
def test_names_that_leave_the_directory_are_refused(root, name):
    with pytest.raises(InputError, match="cannot name a file"):
        Catalogue.open(root).add_solid(DESIGN, "abc", FILES | {name: b""})
    assert not (root / "solids").exists()


@pytest.mark.parametrize(("design", "parameters"), [("../" + DESIGN, "a"), (DESIGN, "../a"), (DESIGN, ""), ("x", "a")])
def test_addresses_that_leave_the_catalogue_are_refused(root, design, parameters):
    with pytest.raises(InputError, match="32 hex digits"):
        Catalogue.open(root).add_solid(design, parameters, FILES)


def test_a_solid_without_facts_is_refused(root):
    with pytest.raises(InputError, match=r"solid\.json is missing"):
        Catalogue.open(root).add_solid(DESIGN, "abc", {"design.stl": b""})


def test_damaged_facts_are_reported(root):
    catalogue = Catalogue.open(root)
    catalogue.add_solid(DESIGN, "abc", FILES)
    (root / "solids" / DESIGN / "abc" / "solid.json").write_bytes(b"{")
    with pytest.raises(FarmError, match=r"solid\.json: cannot be read"):
        catalogue.solids()


def certificate(design_id=DESIGN, verdict="fail"):
    finding = {"severity": "failure", "what": "is too thin", "how_much": "0.2 mm", "remedy": "wall >= 0.8 mm"}
    told = {"design_id": design_id, "verdict": verdict, "material": "silver", "findings": [finding]}
    return json.dumps(told).encode()


def test_a_solid_tells_its_certificate_and_one_of_an_earlier_version_has_none(root):
    catalogue = Catalogue.open(root)
    catalogue.add_solid(DESIGN, "old", FILES)
    catalogue.add_solid(DESIGN, "new", FILES | {"certificate.json": certificate()})
    new, old = catalogue.solids()
    assert old.certificate is None
    assert new.certificate["findings"][0]["remedy"] == "wall >= 0.8 mm"


@pytest.mark.parametrize("content", [b"", b"[]", b"{}", certificate("0" * 32), certificate(verdict="maybe")])
def test_what_is_no_certificate_of_the_design_is_refused_and_found(root, content):
    catalogue = Catalogue.open(root)
    catalogue.add_solid(DESIGN, "abc123", FILES | {"certificate.json": content})
    (solid,) = catalogue.solids()
    with pytest.raises(FarmError, match="verify --repair"):
        _ = solid.certificate
    found = [finding for finding in verify(root, "full").findings if finding.kind == "solid"]
    assert ["certificate" in finding.problem for finding in found] == [True]
