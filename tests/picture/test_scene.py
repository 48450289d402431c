"""Scenes of shapes whose place, size and colour are known."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fractal_farm.errors import InputError
from fractal_farm.picture.scene import compose
from fractal_farm.picture.scene_file import SceneFile, load_scene
from fractal_farm.picture.scene_files import scene_glb, scene_page
from fractal_farm.picture.scene_picture import scene_picture, scene_turntable
from tests.constructed import ball, star

CONFIGS = Path(__file__).parents[2] / "configs"
BLACK = [0, 0, 0]


def composed(*objects, **fields):
    genomes = {"ball": ball().genes.tolist(), "star": star(5).genes.tolist()}
    described = [{"genome": "ball", "points": 500, "pose": "as grown", **each} for each in objects]
    return compose(SceneFile.model_validate({"genomes": genomes, "objects": described, **fields}))


def two(red_depth: float, green_depth: float):
    """A red and a green ball behind each other; y leads away from the viewer."""
    return composed(
        {"name": "red", "places": [[0, red_depth, 0]], "colours": {"plain": [1, 0, 0]}, "thickness": 3},
        {"name": "green", "places": [[0, green_depth, 0]], "colours": {"plain": [0, 1, 0]}, "thickness": 3},
        ground=BLACK,
        camera={"tilt": 0, "distance": 1000},
    )


@pytest.mark.parametrize(("depths", "channel"), [((-2, 2), 0), ((2, -2), 1)])
def test_the_nearer_object_hides_the_farther_one(depths, channel):
    picture = scene_picture(two(*depths), 80, 80)
    middle = picture[35:45, 35:45].reshape(-1, 3).astype(int)
    strong, weak = middle[:, channel].mean(), middle[:, 1 - channel].mean()
    assert strong > 80
    assert weak < 0.3 * strong


def test_half_a_turn_shows_the_other_one():
    front, back = scene_turntable(two(-2, 2), 80, 80, 2)
    assert front[40, 40, 0] > front[40, 40, 1]
    assert back[40, 40, 1] > back[40, 40, 0]


def test_objects_stand_where_they_are_placed_in_their_size():
    scene = composed(
        {"name": "one", "size": 2.0, "places": [[1, 2, 3]]},
        {"name": "other", "size": 0.5, "places": [[-1, 0, 0], [0, 0, 5]], "rotation": [0, 0, 90]},
    )
    one, other = scene.things
    corners = np.array([one.placed(0).min(axis=0), one.placed(0).max(axis=0)])
    np.testing.assert_allclose(corners.mean(axis=0), [1, 2, 3], atol=1e-12)
    assert np.ptp(one.placed(0), axis=0).max() == pytest.approx(2.0)
    assert np.ptp(other.placed(1), axis=0).max() == pytest.approx(0.5)
    turned = other.points @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(other.placed(0), 0.5 * turned + [-1, 0, 0], atol=1e-12)
    assert scene.n_points == len(one.points) + 2 * len(other.points)
    assert [len(thing.points) for thing in scene.things] == [500, 500]


def test_colours_are_those_of_the_paper_s_formulas():
    scene = composed(
        {"name": "dual", "colours": {"first": [1, 0.5, 0.2], "second": [0.4, 0.3, 0.1]}},
        {"name": "olive", "colours": {"plain": "olive"}},
    )
    dual, olive = scene.things
    share = (dual.points - dual.points.min(axis=0)) / np.ptp(dual.points, axis=0)
    np.testing.assert_allclose(dual.colours, np.clip([1, 0.5, 0.2] - np.array([0.4, 0.3, 0.1]) * share, 0, 1))
    np.testing.assert_allclose(olive.colours, np.tile([128 / 255, 128 / 255, 0], (len(olive.points), 1)))


def test_light_makes_the_inside_darker_than_the_outside():
    from fractal_farm.picture.balls import light_on

    rng = np.random.default_rng(1)
    points = rng.normal(size=(20_000, 3))
    points *= (rng.uniform(size=20_000) ** (1 / 3) / np.linalg.norm(points, axis=1))[:, None]
    sky, lamp = light_on(points, np.full(20_000, 0.02))
    away = np.linalg.norm(points, axis=1)
    assert sky[away < 0.5].mean() < 0.3 * sky[away > 0.97].mean()
    towards = points @ [-0.45, -0.65, 0.62]
    assert lamp[(away > 0.97) & (towards > 0.7)].mean() > 5 * lamp[(away > 0.97) & (towards < -0.7)].mean()


def test_copies_hang_on_outer_points_all_around():
    scene = composed(
        {"name": "holder", "size": 10, "points": 3_000},
        {"name": "a", "genome": "star", "hang": {"holder": "holder", "copies": 9}},
        {"name": "b", "genome": "star", "hang": {"holder": "holder", "copies": 7}},
    )
    holder = scene.things[0].placed(0)
    middles = np.concatenate([thing.places[:, :3, 3] for thing in scene.things[1:]])
    assert middles.shape == (16, 3)
    distances = [np.linalg.norm(holder - middle, axis=1).min() for middle in middles]
    assert max(distances) < 1.0
    gaps = np.diff(np.sort(np.arctan2(middles[:, 1], middles[:, 0])))
    assert gaps.max() < 1.6
    apart = np.linalg.norm(middles[:, None] - middles[None], axis=2)[np.triu_indices(16, 1)]
    assert apart.min() > 0.3


def test_glb_has_all_points_in_the_right_places():
    scene = composed(
        {"name": "one", "size": 2.0, "places": [[1, 2, 3]]},
        {"name": "other", "places": [[-1, 0, 0], [0, 0, 5]], "colours": {"plain": "red"}},
    )
    loaded = trimesh.load(io.BytesIO(scene_glb(scene)), file_type="glb")
    clouds = loaded.dump()
    assert sum(len(cloud.vertices) for cloud in clouds) == scene.n_points
    found = np.concatenate([cloud.vertices for cloud in clouds])
    expected = np.concatenate([thing.placed(copy) for thing in scene.things for copy in range(len(thing.places))])
    expected = np.stack([expected[:, 0], expected[:, 2], -expected[:, 1]], axis=1)  # y is up in GLB
    np.testing.assert_allclose(
        found[np.lexsort(found.T.round(4))], expected[np.lexsort(expected.T.round(4))], atol=1e-3
    )
    reds = [cloud for cloud in clouds if (np.asarray(cloud.colors)[:, :3] == [255, 0, 0]).all()]
    assert len(reds) == 2


def test_meshes_have_the_place_and_size_of_the_points():
    scene = composed({"name": "one", "size": 2.0, "places": [[1, 2, 3]], "colours": {"metal": "gold"}})
    (mesh,) = trimesh.load(io.BytesIO(scene_glb(scene, meshes=True)), file_type="glb").dump()
    assert mesh.is_watertight
    np.testing.assert_allclose(mesh.bounds.mean(axis=0), [1, 3, -2], atol=1e-6)
    assert mesh.extents.max() == pytest.approx(2.0, abs=1e-6)


def test_the_page_asks_for_nothing():
    page = scene_page(composed({"name": "one"}, title="<b>Tree & star"))
    assert "http" not in page
    assert "src=" not in page
    assert "&lt;b&gt;Tree &amp; star" in page
    assert "@" not in page.replace("@media", "")


def test_designs_are_asked_for():
    genomes = {"ball": ball().genes.tolist()}
    file = SceneFile.model_validate({"genomes": genomes, "objects": [{"name": "x", "genome": "ball", "like": "star"}]})
    assert compose(file).things[0].genome == ball()
    assert compose(file, lambda each: star(5)).things[0].genome == star(5)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("objects: []", "objects"),
        ("objects: [{name: a}]", "give genome, design or like"),
        ("objects: [{name: a, genome: b}]", "no genome b"),
        ("objects: [{name: a, design: b, colours: {plain: greenish}}]", "name of a colour in CSS"),
        ("objects: [{name: a, design: b, colours: {first: red}}]", "needs both first and second"),
        ("objects: [{name: a, design: b, size: -1}]", "size is -1"),
        ("objects: [{name: a, design: b, places: [[0, 0]]}]", "places"),
        ("objects: [{name: a, design: b, places: [[0, 0, .nan]]}]", "places"),
        ("objects: [{name: a, design: b}, {name: a, design: b}]", "two objects are called a"),
        ("objects: [{name: a, design: b, hang: {holder: c, copies: 3}}]", "no object before it"),
        ("objects: [{name: a, design: b, colour: red}]", "did you mean 'colours'"),
        ("objects: [{name: a, design: b, points: 1000000000}]", "points is 1000000000"),
    ],
)
def test_a_bad_scene_is_one_line(tmp_path, text, reason):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_scene(path)
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_design_of_a_catalogue_needs_one(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text("objects: [{name: a, design: b}]")
    with pytest.raises(InputError, match="--catalogue"):
        compose(load_scene(path))


def test_the_christmas_tree_is_that_of_the_paper():
    scene = load_scene(CONFIGS / "christmas_tree.yaml")
    tree, *others = scene.objects
    assert tree.points == 20_000
    assert {each.points for each in others} == {5_000}
    hung = [each for each in others if each.hang]
    assert len({each.genome for each in hung}) == 6
    assert sum(each.colours.first is not None for each in hung) == 3
    assert all(each.colours.plain is None and each.colours.metal is None for each in hung)
