import hashlib
import json

import pytest

from fractal_farm.errors import InputError
from fractal_farm.solid import SolidParameters
from fractal_farm.solid.parameters import PIPELINE_VERSION


def test_the_hash_tells_parameters_apart_and_equal_ones_not():
    assert SolidParameters().hash == SolidParameters(30, 0.8, 180, True).hash
    others = [SolidParameters(31), SolidParameters(wall_mm=0.9), SolidParameters(resolution=200)]
    others += [SolidParameters(thicken=False)]
    assert len({each.hash for each in [SolidParameters(), *others]}) == 5


def test_a_solid_without_a_feature_is_called_what_it_was_before_there_were_any():
    # What was hashed before there were features: four numbers and the version.
    asked = {"size_mm": 30.0, "wall_mm": 0.8, "resolution": 180, "thicken": True}
    content = json.dumps([PIPELINE_VERSION, asked], sort_keys=True).encode()
    assert SolidParameters().hash == hashlib.blake2b(content, digest_size=8, person=b"farm-solid-1").hexdigest()
    features = {"bridges": True, "closing_mm": 0.3, "shell_mm": 1.0, "base": "plate", "bail": "ring", "sprue": True}
    made = [SolidParameters(**{name: value}) for name, value in features.items()]
    assert len({each.hash for each in [SolidParameters(), *made]}) == 1 + len(features)
    assert made[0].asked_for == {**asked, "bridges": True}


def test_the_resolution_grows_with_what_the_wall_needs():
    assert SolidParameters(30.0, 0.8).resolution == 180
    assert SolidParameters(60.0, 0.8).resolution == 225
    assert SolidParameters(60.0, 0.8).voxel_mm * 3 <= 0.8


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"size_mm": 0.0}, "size_mm is 0"),
        ({"size_mm": float("inf")}, "size_mm is inf"),
        ({"wall_mm": -1.0}, "wall_mm is -1"),
        ({"wall_mm": 11.0}, "below a third"),
        ({"resolution": 8}, "32 to 1000"),
    ],
)
def test_values_out_of_range_are_refused_by_name(values, message):
    with pytest.raises(InputError, match=message):
        SolidParameters(**values)


def test_a_wall_too_thin_for_the_voxels_is_refused_with_three_remedies_that_pass():
    with pytest.raises(InputError, match=r"resolution >= 450, wall_mm >= 0.225, or size_mm <= 26.67") as refusal:
        SolidParameters(30.0, 0.2)
    assert "0.2" in str(refusal.value)
    SolidParameters(30.0, 0.2, 450)
    SolidParameters(30.0, 0.225)
    SolidParameters(26.66, 0.2)
