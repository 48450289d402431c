"""The browser's formulas against those of the command line: one genome, the same maps, probabilities and points."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fractal_farm.ifs.cover import attractor_cover
from fractal_farm.ifs.genome import Genome, Phenotype, as_genome
from fractal_farm.ifs.maps import resolved
from fractal_farm.ifs.random_iteration import attractor_points
from fractal_farm.ifs.symmetry import SYMMETRIES
from tests.table1 import TABLE1

CORE = Path(__file__).parents[2] / "fractal_farm" / "studio" / "static" / "core"
COUNT = 2_000
EVEN = 4_000
RELATIVE = 1e-5  # float32 has 6e-8; points are compared with the size of the attractor
_MAX_MAPS = 8

SCRIPT = """
import * as ifs from %s;
let text = "";
for await (const chunk of process.stdin) text += chunk;
const { genomes, count, even } = JSON.parse(text);
const answers = genomes.map((genome) => {
  const { maps, probabilities } = ifs.resolve(genome);
  const points = ifs.randomIteration(maps, probabilities, count, ifs.seedOf(genome), genome.symmetry);
  const shown = ifs.randomIteration(maps, probabilities, count, ifs.seedOf(genome, "display", 3), genome.symmetry);
  const covered = ifs.evenPoints(maps, even, { symmetry: genome.symmetry, probabilities, seed: ifs.seedOf(genome) });
  return [maps, probabilities, points, shown, covered].map((numbers) => Array.from(numbers));
});
console.log(JSON.stringify({ answers, symmetries: ifs.SYMMETRIES.map((one) => one.name) }));
"""


@pytest.fixture(scope="module")
def genomes() -> list[Genome]:
    """Table 1, and random genomes of 2 to 8 maps: both families, forms and signs, symmetries, probabilities by hand."""
    drawn = np.random.default_rng(7)
    made = [as_genome(genes) for genes in TABLE1.values()]
    while len(made) < 100:
        case = len(made)
        n_maps = 2 + case % (_MAX_MAPS - 1)
        affine = case % 4 == 3
        if affine:
            genes = drawn.normal(0.0, 0.25, (n_maps, 12))
            genes[:, 3::4] *= 4.0
        else:
            genes = np.concatenate(
                [
                    drawn.uniform(-np.pi, np.pi, (n_maps, 3)),
                    drawn.uniform(0.05, 0.9, (n_maps, 1)),
                    drawn.uniform(-2.0, 2.0, (n_maps, 3)),
                ],
                axis=1,
            )
        if case % 5 == 0:
            genes[0] = -0.0 if affine else genes[1]  # rows that are equal, and a minus zero
            genes[0, 5 if affine else 4] = 0.3
        shares = drawn.dirichlet(np.ones(n_maps)) * 0.9 + 0.1 / n_maps
        phenotype = Phenotype(
            "affine" if affine else "similarity",
            float(
                drawn.choice([1.1, 1.5, 4.0])
            ),  # with 1 all shares are equal, and rounding says where an orbit begins
            "rho R x + d" if case % 3 == 1 else "rho R (x + d)",
            -1 if case % 2 else 1,
        )
        by_hand = tuple((shares / shares.sum()).tolist()) if case % 6 == 0 else None
        symmetry = SYMMETRIES[case % len(SYMMETRIES)].name
        genome = Genome(genes, phenotype, by_hand, symmetry)
        norms = np.linalg.svd(resolved_if_contracting(genome), compute_uv=False)
        if norms.max() < 0.95:
            made.append(as_genome(genome))
        else:
            genes[:, [0, 1, 2, 4, 5, 6, 8, 9, 10]] *= 0.9 / norms.max()
            made.append(as_genome(Genome(genes, phenotype, by_hand, symmetry)))
    return made


def resolved_if_contracting(genome: Genome) -> np.ndarray[Any, Any]:
    """The linear parts (N, 3, 3) of a genome of which an affine map may not contract yet."""
    if genome.phenotype.family == "affine":
        return genome.genes.reshape(-1, 3, 4)[:, :, :3]
    return resolved(genome)[0][:, :, :3]


def as_mapping(genome: Genome) -> dict[str, Any]:
    """What stands in a file of genomes, and in requests."""
    shape = genome.phenotype
    mapping: dict[str, Any] = {
        "genes": genome.genes.tolist(),
        "symmetry": genome.symmetry,
        "phenotype": {
            "family": shape.family,
            "influence": shape.influence,
            "map_form": shape.map_form,
            "rotation_sign": shape.rotation_sign,
        },
    }
    return mapping | ({"probabilities": list(genome.probabilities)} if genome.probabilities else {})


@pytest.fixture(scope="module")
def answers(genomes: list[Genome]) -> dict[str, Any]:
    """What the browser's modules make of the genomes."""
    asked = json.dumps({"genomes": [as_mapping(genome) for genome in genomes], "count": COUNT, "even": EVEN})
    if node := shutil.which("node"):
        script = SCRIPT % json.dumps((CORE / "ifs.js").as_uri())
        done = subprocess.run(
            [node, "--input-type=module", "-e", script], input=asked, capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)  # type: ignore[no-any-return]
    return in_chromium(asked)


def in_chromium(asked: str) -> dict[str, Any]:
    """The same without node: the modules in a page."""
    program = os.environ.get("CHROMIUM") or shutil.which("chromium")
    if program is None:
        if os.environ.get("CI"):
            pytest.fail("neither node nor chromium is there")
        pytest.skip("needs node or chromium")
    from playwright.sync_api import sync_playwright

    script = SCRIPT % json.dumps("./ifs.js")
    start, end = script.index("let text"), script.index("const { genomes")
    script = script[:start] + f"const text = {json.dumps(asked)};\n" + script[end:]
    script = script.replace("console.log(", "document.title = (")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page()

        def serve(route: Any) -> None:
            name = route.request.url.rsplit("/", 1)[1]
            if name:
                route.fulfill(body=(CORE / name).read_text(), content_type="text/javascript")
            else:
                route.fulfill(body=f"<script type=module>{script}</script>", content_type="text/html")

        page.route("http://core.invalid/*", serve)
        page.goto("http://core.invalid/")
        page.wait_for_function("document.title.length > 10", timeout=60_000)
        answer = page.title()
        browser.close()
    return json.loads(answer)  # type: ignore[no-any-return]


def test_symmetries_have_the_same_codes(answers: dict[str, Any]) -> None:
    assert answers["symmetries"] == [symmetry.name for symmetry in SYMMETRIES]


def test_maps_and_probabilities_agree(genomes: list[Genome], answers: dict[str, Any]) -> None:
    for genome, (maps, probabilities, *_) in zip(genomes, answers["answers"], strict=True):
        expected, shares = resolved(genome)
        np.testing.assert_allclose(np.reshape(maps, (-1, 3, 4)), expected, rtol=1e-13, atol=1e-14)
        np.testing.assert_allclose(probabilities, shares, rtol=1e-12, atol=0.0)


@pytest.mark.parametrize(("place", "purpose", "repeat"), [(2, "fitness", 0), (3, "display", 3)])
def test_points_agree(genomes: list[Genome], answers: dict[str, Any], place: int, purpose: str, repeat: int) -> None:
    for genome, answer in zip(genomes, answers["answers"], strict=True):
        expected = attractor_points(genome, COUNT, purpose, repeat)
        points = np.reshape(answer[place], (-1, 3))
        size = np.abs(expected).max()
        np.testing.assert_allclose(points, expected, rtol=0.0, atol=RELATIVE * size)


def test_even_points_lie_on_the_attractor_and_leave_nothing_out(genomes: list[Genome], answers: dict[str, Any]) -> None:
    """Every point of a long orbit of the genomes of table 1 is near one of the cover, and the other way round."""
    from scipy.spatial import cKDTree

    for genome, answer in list(zip(genomes, answers["answers"], strict=True))[: len(TABLE1)]:
        even = np.reshape(answer[4], (-1, 3))
        assert 0.6 * EVEN <= len(even) <= 2 * EVEN
        size = float(np.ptp(even, axis=0).max())
        whole = attractor_cover(genome, 0.03 * size)
        assert cKDTree(even).query(whole)[0].max() < 0.06 * size  # nothing is left out
        assert cKDTree(whole).query(even)[0].max() <= 0.03 * size * 1.001  # and nothing lies outside
