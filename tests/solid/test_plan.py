import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fractal_farm.errors import FarmError
from fractal_farm.solid.parameters import SolidParameters
from fractal_farm.solid.plan import plan_solid

gaps = st.floats(0.0, 1.5)
sizes = st.floats(10.0, 100.0)
shares = st.floats(0.02, 0.3)


@given(gaps, sizes, shares)
def test_a_thickened_solid_keeps_its_size_and_leaves_no_neck_thinner_than_the_wall(gap, size, share):
    plan = plan_solid(gap, SolidParameters(size, share * size, 1000), "d")
    thickness = 2 * plan.radius_mm
    assert plan.attractor_mm + thickness == pytest.approx(size)
    neck = math.sqrt(thickness**2 - (gap * plan.attractor_mm) ** 2)
    assert neck == pytest.approx(share * size, rel=1e-6)


def test_without_a_gap_the_wall_is_what_was_asked_for():
    assert plan_solid(0.0, SolidParameters(), "d").radius_mm == pytest.approx(0.4)
    assert not plan_solid(0.0, SolidParameters(), "d").thickened


@given(st.floats(0.03, 1.0))
def test_what_falls_apart_is_refused_and_each_of_the_remedies_passes(gap):
    with pytest.raises(FarmError) as refusal:
        plan_solid(gap, SolidParameters(thicken=False), "0a1b")
    message = str(refusal.value)
    wall, size = map(float, re.search(r"wall >= ([\d.]+) mm, or size <= ([\d.]+) mm, or thicken", message).groups())
    if wall < 10.0:
        plan_solid(gap, SolidParameters(wall_mm=wall, thicken=False), "0a1b")
    if size > 2.4:
        plan_solid(gap, SolidParameters(size_mm=size, thicken=False), "0a1b")
    assert plan_solid(gap, SolidParameters(), "0a1b").thickened
