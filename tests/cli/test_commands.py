"""Commands on the catalogue of a real run: what they print is what the library says."""

from __future__ import annotations

import csv
import io
import json
import math
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
import trimesh
from PIL import Image

from fractal_farm.catalogue import Catalogue
from fractal_farm.cli import main
from fractal_farm.ifs.maps import selection_probabilities
from tests.cli.conftest import CONFIGS, submit_arguments


def output(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """What a successful command prints on stdout."""
    capsys.readouterr()
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    assert code == 0, err
    return out


def result(capsys: pytest.CaptureFixture[str], *arguments: object) -> Any:
    """What a successful command prints as JSON."""
    return json.loads(output(capsys, *arguments, "--json"))


def best(directory: Path) -> dict[str, Any]:
    row: dict[str, Any] = Catalogue.open(directory).designs().slice(0, 1).to_pylist()[0]
    return row


def test_submit_prints_only_json_on_stdout(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    summary = json.loads(output(capsys, *submit_arguments(tmp_path / "run", "--set", "solids.max=0", "--json")))
    assert summary["progress"]["epochs"] == 2
    assert summary["digest"] == Catalogue.open(tmp_path / "run").digest()
    assert Path(summary["sheet"]).is_file()


def test_a_directory_that_holds_another_run_is_left_alone(
    capsys: pytest.CaptureFixture[str], run_directory: Path
) -> None:
    before = sorted(run_directory.rglob("*"))
    assert main(submit_arguments(run_directory)) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert str(run_directory) in err
    assert sorted(run_directory.rglob("*")) == before


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        (["--set", "catalogue.min_free_gb=1e6"], "min_free_gb"),
        (["--address", "127.0.0.1:1"], "--address 127.0.0.1:1"),
    ],
)
def test_a_run_that_cannot_start_writes_nothing(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, more: list[str], reason: str
) -> None:
    arguments = [word for word in submit_arguments(tmp_path / "run") if word not in ("--executor", "serial")]
    assert main([*arguments, *more]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert reason in err
    assert list(tmp_path.iterdir()) == []


def test_resume_refuses_another_evolution(capsys: pytest.CaptureFixture[str], run_directory: Path) -> None:
    assert main(["resume", str(run_directory), "--set", "evolution.seed=1"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_resumed_run_goes_on_to_the_digest_of_one_long_run(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, run_directory: Path
) -> None:
    short = tmp_path / "short"
    arguments = ["--set", "stop.epochs=1", "--set", "solids.max=0", "--json"]
    output(capsys, *submit_arguments(short, *arguments))
    resumed = result(capsys, "resume", short, "--executor", "serial", "--set", "stop.epochs=2", "--set", "solids.max=0")
    assert resumed["digest"] == Catalogue.open(run_directory).digest()


def test_ctrl_c_ends_a_run_cleanly_and_says_how_to_resume(tmp_path: Path) -> None:
    arguments = submit_arguments(tmp_path / "run", "--set", "stop.epochs=1000000", "--json")
    command = [sys.executable, "-c", "import sys; from fractal_farm.cli import main; sys.exit(main())"]
    with subprocess.Popen([*command, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        assert run.stderr is not None
        said = next(line for line in run.stderr if line.startswith("epoch"))
        run.send_signal(signal.SIGINT)
        out, err = run.communicate(timeout=120)
    assert run.returncode == 130, said + err
    assert json.loads(out)["interrupted"] is True
    assert f"farm resume {tmp_path / 'run'}" in err
    assert Catalogue.open(tmp_path / "run").digest() == json.loads(out)["digest"]


def test_status_has_the_digest_and_a_forecast(capsys: pytest.CaptureFixture[str], run_directory: Path) -> None:
    facts = result(capsys, "status", run_directory)
    catalogue = Catalogue.open(run_directory)
    assert facts["digest"] == catalogue.digest()
    assert facts["designs"] == catalogue.designs().num_rows
    assert facts["files"] == catalogue.usage().files
    assert facts["forecast"] is None  # a run of seconds foretells nothing
    assert facts["digest"] in output(capsys, "status", run_directory)


def test_list_shows_the_best_first(capsys: pytest.CaptureFixture[str], run_directory: Path) -> None:
    lines = output(capsys, "list", run_directory, "--limit", "3").splitlines()
    assert len(lines) == 4
    assert lines[0].split()[:2] == ["design_id", "fitness"]
    ids = Catalogue.open(run_directory).designs(["design_id"]).column("design_id").to_pylist()
    assert [line.split()[0] for line in lines[1:]] == ids[:3]


def test_list_filters_and_sorts(capsys: pytest.CaptureFixture[str], run_directory: Path) -> None:
    rows = result(capsys, "list", run_directory, "--where", "fitness > 0.7 and n_maps == 3", "--sort", "gap")
    everything = Catalogue.open(run_directory).designs().to_pylist()
    wanted = [row for row in everything if row["fitness"] > 0.7 and row["n_maps"] == 3]
    assert {row["design_id"] for row in rows} == {row["design_id"] for row in wanted}
    assert [row["gap"] for row in rows] == sorted(row["gap"] for row in wanted)


def test_list_formats_hold_the_same_designs(
    capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path
) -> None:
    rows = result(capsys, "list", run_directory)
    ids = [row["design_id"] for row in rows]
    table = list(csv.DictReader(io.StringIO(output_of_file(capsys, run_directory, tmp_path / "a.csv").decode())))
    assert [row["design_id"] for row in table] == ids
    assert [float(row["fitness"]) for row in table] == [row["fitness"] for row in rows]
    assert [json.loads(row["genes"]) for row in table] == [row["genes"] for row in rows]
    parquet = pyarrow.parquet.read_table(io.BytesIO(output_of_file(capsys, run_directory, tmp_path / "a.parquet")))
    assert parquet.column("design_id").to_pylist() == ids
    assert json.loads(output_of_file(capsys, run_directory, tmp_path / "a.json")) == rows


def output_of_file(capsys: pytest.CaptureFixture[str], directory: Path, file: Path) -> bytes:
    assert output(capsys, "list", directory, "--format", file.suffix[1:], "-o", file) == ""
    return file.read_bytes()


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--where", "fitnes > 0.5"], "did you mean 'fitness'"),
        (["--where", "genes > 0.5"], "--where 'genes > 0.5'"),
        (["--where", "fitness"], "--where 'fitness'"),
        (["--where", "fitness > 'a'"], "--where"),
        (["--sort", "beauty"], "--sort 'beauty'"),
        (["--sort", "genes"], "--sort 'genes'"),
        (["--sort", "fitness up"], "asc or desc"),
        (["--columns", "beauty"], "unknown column 'beauty'"),
    ],
)
def test_a_wrong_selection_is_one_line(
    capsys: pytest.CaptureFixture[str], run_directory: Path, arguments: list[str], reason: str
) -> None:
    capsys.readouterr()
    assert main(["list", str(run_directory), *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert reason in err


def test_show_has_genome_lineage_and_files(capsys: pytest.CaptureFixture[str], run_directory: Path) -> None:
    row = best(run_directory)
    shown = result(capsys, "show", run_directory, row["design_id"][:8])
    assert shown["design_id"] == row["design_id"]
    assert np.ravel(shown["genes"]).tolist() == row["genes"]
    assert shown["parents"] == row["parents"]
    assert all((run_directory / name.split("[")[0]).exists() for name in shown["files"])
    page = output(capsys, "show", run_directory, row["design_id"])
    assert row["design_id"] in page
    assert "alpha_p" in page


def test_show_of_an_unknown_design_is_refused(capsys: pytest.CaptureFixture[str], run_directory: Path) -> None:
    assert main(["show", str(run_directory), "0" * 32]) == 2
    assert "no design" in capsys.readouterr().err


def test_score_prints_the_probabilities_of_the_paper_and_exact_exponents(capsys: pytest.CaptureFixture[str]) -> None:
    scores = {entry["name"]: entry for entry in result(capsys, "score", CONFIGS / "table1.yaml")}
    by_hand = {
        "06447": [1 / 12, 10 / 12, 1 / 12],
        "06582": [1 / 8, 7 / 8],
        "06425": [0.0833, 0.1964, 0.7203],
        "06328": [0.4312, 0.4855, 0.0833],
    }
    assert list(scores) == ["06328", "06425", "06447", "06582"]
    for name, entry in scores.items():
        np.testing.assert_allclose(entry["probabilities"], by_hand[name], atol=5e-5)
        closed_form = math.fsum(
            p * math.log(rho) for p, rho in zip(entry["probabilities"], entry["ratios"], strict=True)
        )
        assert entry["lle"] == pytest.approx(closed_form, abs=1e-12)
        assert 0.55 <= entry["fitness"] <= 0.95
        dimension = entry["similarity_dimension"]
        assert math.fsum(rho**dimension for rho in entry["ratios"]) == pytest.approx(1.0, abs=1e-9)


def test_score_as_a_table_has_a_row_for_each_genome(capsys: pytest.CaptureFixture[str]) -> None:
    lines = output(capsys, "score", CONFIGS / "table1.yaml").splitlines()
    assert [line.split()[0] for line in lines] == ["genome", "06328", "06425", "06447", "06582"]


def test_score_takes_the_readings_of_a_configuration(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "run.yaml").write_text("evolution: {fitness: {d2: [0.0, 0.698]}, phenotype: {influence: 1000}}")
    usual = result(capsys, "score", CONFIGS / "table1.yaml")
    other = result(capsys, "score", CONFIGS / "table1.yaml", "--config", tmp_path / "run.yaml")
    assert all(one["fitness"] != two["fitness"] for one, two in zip(usual, other, strict=True))
    assert min(other[2]["probabilities"]) == pytest.approx(1 / 3000)


def test_scores_of_affine_genomes_have_no_similarity_dimension(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    rows = [[0.5, 0, 0, x, 0, 0.25, 0, 0, 0, 0, 0.5, 0] for x in (0.0, 1.0)]
    (tmp_path / "affine.yaml").write_text(json.dumps({"phenotype": {"family": "affine"}, "genomes": {"a": rows}}))
    (entry,) = result(capsys, "score", tmp_path / "affine.yaml")
    assert entry["similarity_dimension"] is None
    np.testing.assert_allclose(entry["ratios"], [0.0625 ** (1 / 3)] * 2)


@pytest.mark.parametrize("count", [1, 3])
def test_render_draws_designs(
    capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path, count: int
) -> None:
    ids = Catalogue.open(run_directory).designs(["design_id"]).column("design_id").to_pylist()[:count]
    path = tmp_path / "pictures" / "design.png"
    output(capsys, "render", run_directory, *ids, "-o", path, "--size", 64)
    with Image.open(path) as picture:
        assert len(picture.convert("RGB").getcolors(1 << 24) or []) > 20
        assert min(picture.size) >= 64


def test_render_shows_solids_in_metal_and_turns_them(
    capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path
) -> None:
    identity = best(run_directory)["design_id"]
    still, moving = tmp_path / "gold.png", tmp_path / "gold.webp"
    output(capsys, "render", run_directory, identity, "-o", still, "--size", 64, "--metal", "gold")
    output(capsys, "render", run_directory, identity, "-o", moving, "--size", 64, "--turntable", 5)
    with Image.open(still) as picture:
        shown = np.asarray(picture.convert("RGB")).reshape(-1, 3).astype(int)
    bright = shown[shown.sum(axis=1) > 150]
    assert len(bright) > 100
    assert (bright[:, 0] > bright[:, 2]).mean() > 0.95
    with Image.open(moving) as film:
        assert (film.format, film.size, film.n_frames) == ("WEBP", (64, 64), 5)
        assert film.info["loop"] == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "a.png", "--turntable", "12"], "ends in .webp or .gif"),
        (["-o", "a.webp", "--metal", "gold"], "ends in .png"),
        (["abce", "-o", "a.webp", "--turntable", "12"], "2 designs were given"),
    ],
)
def test_a_turntable_of_another_kind_is_refused(
    capsys: pytest.CaptureFixture[str], run_directory: Path, arguments: list[str], message: str
) -> None:
    assert main(["render", str(run_directory), "abcd", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_mesh_makes_watertight_solids_of_the_size_asked_for(
    capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path
) -> None:
    identity = best(run_directory)["design_id"]
    arguments = ["--size", 20, "--wall", 2, "--format", "stl", "--format", "ply"]
    (report,) = result(capsys, "mesh", run_directory, identity, "-o", tmp_path, *arguments)
    assert report["design_id"] == identity
    assert sorted(Path(name).suffix for name in report["files"]) == [".json", ".ply", ".stl"]
    solid = trimesh.load_mesh(tmp_path / f"{identity}.stl")
    assert solid.is_watertight
    assert solid.body_count == 1
    assert solid.volume > 0
    assert solid.extents.max() == pytest.approx(20, rel=0.02)


def test_mesh_takes_a_preset_and_what_is_said_besides_goes_before_it(
    capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path
) -> None:
    identity = best(run_directory)["design_id"]
    arguments = ["--preset", "pendant-silver", "--size", 20, "--no-bridge", "--closing", 0, "--shell", 0, "--sprue"]
    (report,) = result(capsys, "mesh", run_directory, identity, "-o", tmp_path, *arguments, "--format", "stl")
    expected = {"size_mm": 20.0, "wall_mm": 0.8, "resolution": 180, "thicken": True, "bail": "ring", "sprue": True}
    assert report["parameters"] == expected
    solid = trimesh.load_mesh(tmp_path / f"{identity}.stl")
    assert solid.body_count == 1
    # Ring and cone are above and below.
    assert solid.extents[2] > report["box_mm"][2] - 0.01
    assert main(["mesh", str(run_directory), identity, "-o", str(tmp_path), "--preset", "pendant-lead"]) == 2
    assert "preset is 'pendant-lead'; choose from pendant-silver" in capsys.readouterr().err


def test_the_solids_of_a_run_are_in_its_catalogue(run_directory: Path) -> None:
    solids = Catalogue.open(run_directory).solids()
    assert len(solids) == 1
    assert selection_probabilities(Catalogue.open(run_directory).genome(solids[0].design_id)).sum() == pytest.approx(1)


def test_a_table_that_is_no_terminal_loses_no_column(capsys: pytest.CaptureFixture[str], run_directory: Path) -> None:
    header, row = output(capsys, "list", run_directory, "--columns", "all", "--limit", "1").splitlines()[:2]
    assert header.split()[0] == "design_id"
    assert len(row.split()[0]) == 32
    assert {"operator", "cloud_array", "parents"} <= set(header.split())


def test_a_column_that_is_asked_for_twice_is_shown_once(
    capsys: pytest.CaptureFixture[str], run_directory: Path
) -> None:
    lines = output(capsys, "list", run_directory, "--columns", "fitness,d0,fitness", "--limit", "1").splitlines()
    assert lines[0].split() == ["fitness", "d0"]


def test_designs_are_chosen_by_what_they_weigh_and_how_large_they_are(
    capsys: pytest.CaptureFixture[str], run_directory: Path
) -> None:
    rows = result(capsys, "list", run_directory, "--columns", "design_id,grams,width_mm,depth_mm")
    assert all(0 < row["grams"] < 0.01036 * 30**3 and row["depth_mm"] <= row["width_mm"] <= 30.01 for row in rows)
    limit = sorted(row["grams"] for row in rows)[len(rows) // 2]
    light = result(capsys, "list", run_directory, "--where", f"grams < {limit} and depth_mm < 20")
    expected = [row for row in rows if row["grams"] < limit and row["depth_mm"] < 20]
    assert {row["design_id"] for row in light} == {row["design_id"] for row in expected} != set()
    told = output(capsys, "show", run_directory, light[0]["design_id"])
    assert f"in silver             about {light[0]['grams']:.1f} g" in told
