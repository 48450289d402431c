import pytest

from fractal_farm.errors import InputError
from fractal_farm.solid import SolidParameters, preset
from fractal_farm.solid.materials import material
from fractal_farm.solid.presets import parameters_of, presets


@pytest.mark.parametrize("name", presets())
def test_every_preset_is_what_its_material_asks_for(name):
    parameters, profile = preset(name), presets()[name].material
    assert name.endswith((f"-{profile.name}", "resin"))
    assert parameters.wall_mm >= profile.wall
    assert not parameters.bridges or parameters.wall_mm >= profile.wire
    if parameters.shell_mm:
        assert parameters.shell_mm > parameters.wall_mm
        assert parameters.shell_above_mm == profile.solid
    else:
        assert not presets()[name].shelled


@pytest.mark.parametrize("name", presets())
@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0, 4.0])
def test_every_preset_can_be_made_smaller_and_larger(name, scale):
    size = preset(name).size_mm * scale
    made = preset(name, size_mm=size)
    assert made.size_mm == size
    assert made.wall_mm >= preset(name).wall_mm


def test_what_is_given_goes_before_the_preset_and_what_follows_from_it_follows():
    plain = preset("pendant-silver")
    assert plain.wall_mm == material("silver").wall
    thick = preset("pendant-silver", wall_mm=1.6, bail="none", size_mm=None)
    assert (thick.wall_mm, thick.shell_mm, thick.bail, thick.size_mm) == (1.6, 2.0, "none", plain.size_mm)
    assert thick.shell_above_mm == pytest.approx(6.0)
    assert preset("pendant-silver", shell_mm=0.0).shell_mm == 0.0


def test_without_a_preset_only_what_is_given_counts():
    assert parameters_of(None, size_mm=20.0, base="plate") == SolidParameters(20.0, base="plate")
    assert parameters_of(None) == SolidParameters()


def test_an_unknown_preset_is_refused_with_the_choice():
    with pytest.raises(InputError, match=r"preset is 'pendant-lead'; choose from pendant-silver, pendant-gold"):
        preset("pendant-lead")
    with pytest.raises(InputError, match=r"parameter is 'wal'; choose from size_mm, wall_mm"):
        preset("pendant-silver", wal=1.0)
