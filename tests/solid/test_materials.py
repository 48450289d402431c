import pytest

from fractal_farm.errors import InputError
from fractal_farm.solid.materials import material, materials


def test_every_profile_is_one_that_a_shop_could_mean():
    assert {"silver", "gold", "resin", "nylon", "steel", "filament"} <= set(materials())
    for name, profile in materials().items():
        assert profile.name == name
        assert 0.0 < profile.wire <= profile.wall * 2.0 <= profile.solid * 2.0
        assert 0.0 <= profile.shrink < 0.1
        assert 0.0 <= profile.polish < 0.5
        assert profile.source
        assert profile.date >= "2026"


def test_a_cubic_centimetre_weighs_its_density():
    assert material("gold").grams(1000.0) == pytest.approx(material("gold").density)


def test_an_unknown_material_is_named_with_the_choice():
    with pytest.raises(InputError, match=r"^material is 'mithril'; choose from silver, gold, resin"):
        material("mithril")
