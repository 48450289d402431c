import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from fractal_farm.ifs.cover import attractor_cover
from fractal_farm.solid.voxels import Skeleton, distance_field, grid_around
from tests.table1 import TABLE1

NONE = np.zeros((0, 3))


def samples_of(grid):
    return np.stack(np.indices(grid.shape), axis=-1) * grid.spacing + grid.origin


@pytest.mark.parametrize("radius", [2.5, 6.0])
def test_the_field_is_the_distance_to_the_nearest_point_less_the_radius(radius):
    points = attractor_cover(TABLE1["06582"], 0.1)
    points *= 60 / np.ptp(points, axis=0).max()
    grid = grid_around(np.array([points.min(axis=0), points.max(axis=0)]), radius, 1.0)
    field = distance_field(Skeleton(points, NONE), grid)
    true, _ = cKDTree(points).query(samples_of(grid), distance_upper_bound=radius + 3.0)
    band = np.abs(true - radius) < 1.0
    error = field[band] - (true[band] - radius)
    # The balls are a fraction of a voxel larger, which smoothing and gaps between kept points then consume.
    assert abs(error.mean()) < 0.3
    assert np.quantile(np.abs(error), 0.99) < 1.0
    assert (field[true > radius + 2.0] > 0).all()
    assert (field[true < radius - 1.5] < 0).all()
    assert (field != 0).all()


def test_dense_matter_is_solid_although_its_points_are_dropped():
    steps = np.arange(0.0, 20.0, 0.5)
    block = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    grid = grid_around(np.array([[0.0] * 3, [19.5] * 3]), 2.5, 1.0)
    field = distance_field(Skeleton(block, NONE), grid)
    _, spaces = ndimage.label(field >= 0)
    assert spaces == 1
    inside = ((samples_of(grid) > 0) & (samples_of(grid) < 19.5)).all(axis=-1)
    assert (field[inside] < 0).all()


def test_fixed_points_are_never_dropped():
    crowd = np.random.default_rng(0).uniform(0, 0.9, (50, 3)) + 0.05
    grid = grid_around(np.array([[0.0] * 3, [1.0] * 3]), 3.0, 1.0)
    near = distance_field(Skeleton(crowd[:1], crowd), grid)
    true, _ = cKDTree(crowd).query(samples_of(grid))
    outside = (true > 2.8) & (true < 3.2)
    np.testing.assert_allclose(near[outside], true[outside] - 3.0, atol=0.35)
