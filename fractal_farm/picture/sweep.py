"""Sweeps: rows of pictures in which one gene of a design goes up and down in steps (paper section 5.3, figure 10).

All pictures of a row have one view and one scale, each shape stands in the middle of its own, and the points are the
same words of the address tree, so that they move with the gene. The original is in the middle of the row.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from PIL import Image

from fractal_farm.errors import InputError
from fractal_farm.ifs.corresponding import corresponding_points
from fractal_farm.ifs.genome import RHO, Genome, as_genome
from fractal_farm.picture.cloud import cloud_picture
from fractal_farm.picture.colours import coloured, legible
from fractal_farm.picture.sheet import labelled_rows
from fractal_farm.picture.view import choose_view

FloatArray = npt.NDArray[np.float64]

SWEPT = ("pitch", "yaw", "roll", "rho", "d1", "d2", "d3")
"""The genes by the names of the paper's text, in the order of `GENE_NAMES`."""
N_POINTS = 10_000
STEPS = 9
_N_ANGLES = 3
_LARGEST_RHO = 0.999
_MOST_GROWTH = 2.0
_PAPER_STEPS = (("pitch", "pi/60"), ("yaw", "pi/60"), ("roll", "pi/60"), ("d1", "0.25"), ("rho", "3%"))
_ANGLE = re.compile(r"([+-]?)(\d+(?:\.\d+)?)?\s*\*?\s*(?:pi|π)\s*(?:/\s*(\d+(?:\.\d+)?))?")


@dataclass(frozen=True)
class Step:
    """How much a gene changes from one picture to the next.

    Attributes:
        amount: what is added; radians for an angle. For a share, 0.03 means 3 %.
        share: whether the gene is multiplied by 1 + amount instead.
        text: as somebody wrote it.
    """

    amount: float
    share: bool
    text: str


@dataclass(frozen=True)
class Sweep:
    """A row of genomes.

    Attributes:
        genomes: in order of the gene, the original in the middle.
        values: of the gene, in each of them.
        label: map, gene and step in words.
    """

    genomes: tuple[Genome, ...]
    values: tuple[float, ...]
    label: str


def step_of(text: str) -> Step:
    """A step as somebody writes it: a number, a share such as 3%, or an angle such as pi/60.

    Raises:
        InputError: neither.
    """
    word = text.strip()
    angle = _ANGLE.fullmatch(word)
    if angle:
        sign, times, over = angle.groups()
        amount = float(f"{sign}1") * float(times or 1) * math.pi / float(over or 1) if float(over or 1) else math.inf
        share = False
    else:
        share = word.endswith("%")
        try:
            amount = float(word.rstrip("%")) / (100.0 if share else 1.0)
        except ValueError:
            amount = math.nan
    if not math.isfinite(amount) or (share and amount <= -1.0):
        raise InputError(f"step is {text!r}; give a number, a share above -100% such as 3%, or an angle such as pi/60")
    return Step(amount, share, word)


def swept(genome: Genome | npt.ArrayLike, map_number: int, gene: str, step: Step, steps: int = STEPS) -> Sweep:
    """A row of genomes in which one gene of one map changes.

    Args:
        genome: of similarity maps.
        map_number: of the map, from 1 on.
        gene: one of `SWEPT`.
        step: from one genome to the next. Angles are wrapped into [-pi, pi].
        steps: number of genomes, odd, from 3 to 361.

    Raises:
        InputError: an invalid genome, no such map or gene, an even number, or a rho that would not lie in (0, 1).
    """
    valid = as_genome(genome)
    if valid.phenotype.family != "similarity":
        raise InputError("a sweep needs similarity maps; this genome has affine ones, whose numbers are no such genes")
    if not 1 <= map_number <= valid.n_maps:
        raise InputError(f"map is {map_number}; the design has maps 1 to {valid.n_maps}")
    if gene not in SWEPT:
        raise InputError(f"gene is {gene!r}; choose one of {', '.join(SWEPT)}")
    if not (3 <= steps <= 361 and steps % 2 == 1):
        raise InputError(f"steps is {steps}; give an odd number from 3 to 361, so that the original is in the middle")
    row, column = map_number - 1, SWEPT.index(gene)
    original = float(valid.genes[row, column])
    values = []
    for k in range(-(steps // 2), steps // 2 + 1):
        value = original * (1.0 + step.amount) ** k if step.share else original + k * step.amount
        if column < _N_ANGLES and k != 0:
            value = math.remainder(value, 2.0 * math.pi)
        if column == RHO and k != 0 and not 0.0 < value <= _LARGEST_RHO:
            raise InputError(
                f"rho of map {map_number} is {original:g} and would be {value:.4g} after {k:+d} steps of {step.text}; "
                f"it must lie between 0 and {_LARGEST_RHO}: take fewer or smaller steps, or another map"
            )
        values.append(value)
    return Sweep(
        tuple(_with_gene(valid, row, column, value) for value in values),
        tuple(values),
        f"{gene} of map {map_number}, steps of {step.text}",
    )


def paper_sweeps(genome: Genome | npt.ArrayLike, steps: int = STEPS) -> list[Sweep]:
    """The five rows of figure 10: pitch, yaw and roll by pi/60, d1 by 0.25, rho by 3 %.

    They are those of the largest map, or of the largest whose rho stays below 1 where rho is changed.

    Raises:
        InputError: as `swept`; no map may grow by so many steps of rho.
    """
    valid = as_genome(genome)
    order = np.argsort(-valid.genes[:, RHO], kind="stable") + 1
    rows = []
    for gene, text in _PAPER_STEPS:
        step = step_of(text)
        growth = (1.0 + step.amount) ** (steps // 2) if step.share else 1.0
        able = [int(number) for number in order if valid.genes[number - 1, RHO] * growth <= _LARGEST_RHO]
        rows.append(swept(valid, able[0] if able else int(order[0]), gene, step, steps))
    return rows


def sweep_pictures(
    sweep: Sweep, size: int = 256, colouring: str = "gradient", n_points: int = N_POINTS, view: FloatArray | None = None
) -> list[Image.Image]:
    """The pictures of a row, at one view and one scale.

    A shape that grows beyond twice the extent of the original is drawn smaller, so that the others stay visible.

    Args:
        sweep: see `swept`.
        size: width and height of each, pixels.
        colouring: "gradient" or "dual".
        n_points: points of each, at most.
        view: (3, 3) rotation; `choose_view` of the original if None.

    Raises:
        InputError: arguments out of range.
    """
    return [picture for picture, _ in _drawn(sweep, size, colouring, n_points, view)]


def sweep_sheet(
    sweeps: Sequence[Sweep], size: int = 256, colouring: str = "gradient", n_points: int = N_POINTS
) -> Image.Image:
    """Rows of pictures, one below the other, with what changes and the values of the gene as captions.

    All rows of one design have one view.

    Raises:
        InputError: arguments out of range, or no row.
    """
    rows = []
    view = None
    for sweep in sweeps:
        middle = sweep.genomes[len(sweep.genomes) // 2]
        if view is None:
            view = choose_view(corresponding_points([middle], n_points)[0])
        drawn = _drawn(sweep, size, colouring, n_points, view)
        captions = [
            f"{value:.4f}" + (f"  at {scale:.0%}" if scale < 1.0 else "")
            for value, (_, scale) in zip(sweep.values, drawn, strict=True)
        ]
        captions[len(captions) // 2] += "  original"
        rows.append((sweep.label, [(picture, caption) for (picture, _), caption in zip(drawn, captions, strict=True)]))
    return labelled_rows(rows)


def _drawn(
    sweep: Sweep, size: int, colouring: str, n_points: int, view: FloatArray | None
) -> list[tuple[Image.Image, float]]:
    """The pictures of a row, and at which share of the common scale each is drawn."""
    if n_points < 100:
        raise InputError(f"points is {n_points}; draw at least 100")
    clouds = corresponding_points(sweep.genomes, n_points)
    rotation = choose_view(clouds[len(clouds) // 2]) if view is None else view
    extents = [float(np.ptp(rotation[:2] @ points.T, axis=1).max()) for points in clouds]
    common = min(max(extents), _MOST_GROWTH * extents[len(extents) // 2])
    pictures = [
        cloud_picture(points, size, legible(coloured(points, colouring)), view=rotation, extent=common)
        for points in clouds
    ]
    return [
        (Image.fromarray(picture), min(1.0, common / extent) if extent > 0.0 else 1.0)
        for picture, extent in zip(pictures, extents, strict=True)
    ]


def _with_gene(genome: Genome, row: int, column: int, value: float) -> Genome:
    genes = genome.genes.copy()
    genes[row, column] = value
    return replace(genome, genes=genes)
