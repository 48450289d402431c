"""`farm scene`, `sweep`, `morph` and `find` on a real catalogue."""

from __future__ import annotations

import builtins
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from fractal_farm.catalogue import Catalogue
from fractal_farm.cli import main
from fractal_farm.description import features_of, likeness
from fractal_farm.fitness import evaluate
from tests.cli.conftest import CONFIGS
from tests.cli.test_commands import output, result

TABLE1 = CONFIGS / "table1.yaml"
SCENE = """
genomes:
  a: [[0, 0, 0, 0.5, 0, 0, 0], [0, 0, 0, 0.5, 1, 0, 0], [0, 0, 0, 0.5, 0, 0, 1]]
objects:
  - {name: one, genome: a, points: 300}
  - {name: two, genome: a, like: star, points: 300, places: [[2, 0, 0]]}
"""


def ids(directory: Path) -> list[str]:
    found: list[str] = Catalogue.open(directory).designs(["design_id"]).column(0).to_pylist()
    return found


def test_find_ranks_by_what_is_measured(
    capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path
) -> None:
    found = result(capsys, "find", run_directory, "ribbon-like", "-k", "4", "--sheet", tmp_path / "sheet.png")
    catalogue = Catalogue.open(run_directory)
    scores = {each: likeness(features_of(catalogue.genome(each)), "ribbon").score for each in ids(run_directory)}
    assert [each["score"] for each in found] == pytest.approx(sorted(scores.values(), reverse=True)[:4])
    assert (tmp_path / "sheet.png").is_file()
    three = result(capsys, "find", run_directory, "star", "--where", "n_maps == 3")
    assert all(catalogue.design(each["design_id"])["n_maps"] == 3 for each in three)


def test_a_scene_is_drawn_and_designs_come_from_a_catalogue(
    capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path
) -> None:
    file = tmp_path / "scene.yaml"
    file.write_text(SCENE)
    for name in ("a.png", "b.png", "a.glb", "a.html"):
        output(capsys, "scene", file, "--out", tmp_path / name, "--width", "80", "--height", "60")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.size == (80, 60)
    found = tmp_path / "found.png"
    output(capsys, "scene", file, "--out", found, "--width", "80", "--height", "60", "--catalogue", run_directory)
    assert found.read_bytes() != (tmp_path / "a.png").read_bytes()
    output(capsys, "scene", file, "--out", tmp_path / "t.webp", "--width", "40", "--height", "40", "--turntable", "4")
    with Image.open(tmp_path / "t.webp") as moving:
        assert moving.n_frames == 4


def test_a_sweep_of_a_catalogue_s_design_and_of_a_file(
    capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path
) -> None:
    small = ("--size", "32", "--points", "200")
    output(capsys, "sweep", run_directory, ids(run_directory)[0], "--out", tmp_path / "row.png", *small)
    with Image.open(tmp_path / "row.png") as row:
        assert row.width == 9 * 42 + 10
    output(capsys, "sweep", TABLE1, "06447", "--paper", "--out", tmp_path / "five.png", *small)
    with Image.open(tmp_path / "five.png") as five:
        assert five.height == 5 * (42 + 28 + 30) + 10
    output(capsys, "sweep", TABLE1, "--out", tmp_path / "row.webp", "--steps", "5", *small)
    with Image.open(tmp_path / "row.webp") as moving:
        assert moving.n_frames == 8  # there and back


def test_a_morph_tells_its_scores(capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path) -> None:
    first, second = ids(run_directory)[:2]
    words = ("--out", tmp_path / "m.png", "--frames", "4", "--size", "32", "--points", "200")
    told = result(capsys, "morph", run_directory, first, second, *words)
    assert [told[0]["design_id"], told[-1]["design_id"]] == [first, second]
    assert [each["share"] for each in told] == pytest.approx([0, 0.25, 0.75, 1])
    catalogue = Catalogue.open(run_directory)
    assert told[0]["fitness"] == catalogue.design(first)["fitness"]
    between = evaluate([np.array(told[1]["genes"])])
    assert told[1]["fitness"] == pytest.approx(between.fitness[0])


def test_mp4_can_be_played(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    words = ("--steps", "5", "--size", "33", "--points", "500")
    for name in ("a.mp4", "b.mp4"):
        output(capsys, "sweep", TABLE1, "06582", "--map", "2", "--out", tmp_path / name, *words)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()
    with av.open(str(tmp_path / "a.mp4")) as container:
        assert container.streams.video[0].codec_context.name in ("vp9", "libvpx-vp9")
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(frames) == 8
    output(capsys, "sweep", TABLE1, "06582", "--map", "2", "--out", tmp_path / "row.webp", *words)
    with Image.open(tmp_path / "row.webp") as moving:
        still = np.asarray(moving.convert("RGB")).astype(int)
    assert np.abs(frames[0][:33, :33].astype(int) - still).mean() < 10


def test_mp4_without_pyav_is_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    real = builtins.__import__

    def without(name: str, *arguments: Any, **more: Any) -> Any:
        if name == "av":
            raise ImportError(name)
        return real(name, *arguments, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    assert main(["sweep", str(TABLE1), "--out", str(tmp_path / "x.mp4")]) == 1
    _, err = capsys.readouterr()
    assert err.count("\n") == 1
    assert "fractal-farm[video]" in err


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["scene", "missing.yaml", "--out", "x.png"], "no such file"),
        (["scene", str(CONFIGS / "christmas_tree.yaml"), "--out", "x.jpg"], "ends in .png, .glb, .html"),
        (["scene", str(CONFIGS / "christmas_tree.yaml"), "--out", "x.png", "--turntable", "8"], "a turntable moves"),
        (["scene", str(CONFIGS / "christmas_tree.yaml"), "--out", "x.png", "--meshes"], "only a GLB"),
        (["sweep", str(TABLE1), "00000", "--out", "x.png"], "no genome 00000"),
        (["sweep", str(TABLE1), "--map", "9", "--out", "x.png"], "maps 1 to 3"),
        (["sweep", str(TABLE1), "--step", "big", "--out", "x.png"], "step is 'big'"),
        (["sweep", str(TABLE1), "--paper", "--out", "x.webp"], "ends in .png"),
        (["find", "DIR", "lovely"], "is not understood"),
        (["morph", "DIR", "00000000", "00000000", "--out", "x.png"], "no design 00000000"),
    ],
)
def test_what_is_wrong_is_one_line(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    run_directory: Path,
    tmp_path: Path,
    arguments: list[str],
    reason: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([str(run_directory) if word == "DIR" else word for word in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert reason in err
    assert not list(tmp_path.iterdir())
