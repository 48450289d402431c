import numpy as np

from fractal_farm.solid.body import make_one_body


def ball(centre, radius, size=40):
    return np.linalg.norm(np.indices((size,) * 3) - np.reshape(centre, (3, 1, 1, 1)), axis=0) - radius


def test_the_largest_body_stays_and_its_cavities_are_filled():
    shell = np.maximum(ball((15, 15, 15), 10), -ball((15, 15, 15), 4))
    crumb = ball((33, 33, 33), 3)
    field = np.minimum(shell, crumb).astype(np.float32)
    report = make_one_body(field)
    assert (report.bodies, report.cavities) == (2, 1)
    assert report.share == (shell < 0).sum() / ((shell < 0).sum() + (crumb < 0).sum())
    np.testing.assert_array_equal(field < 0, ball((15, 15, 15), 10) < 0)


def test_bodies_that_touch_along_an_edge_only_are_two():
    field = np.ones((6, 6, 6), np.float32)
    field[1:3, 1:3, 1:5] = -1
    field[3:5, 3:5, 2:5] = -1
    assert make_one_body(field).bodies == 2


def test_one_sound_body_is_left_as_it_is():
    field = ball((20, 20, 20), 9).astype(np.float32)
    before = field.copy()
    assert make_one_body(field).bodies == 1
    np.testing.assert_array_equal(field, before)
