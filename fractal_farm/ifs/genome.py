"""Genomes: what a design is made of, and its identity (NOTES, 'Genome'; DESIGN section 5, 'Identity').

A genome is N rows, one contraction each: seven numbers of a similarity (eq 3.2), or the twelve of a general affine
map (eq 2.1). `Phenotype` says how rows become maps. Nothing here imports numba: islands breed genomes without it.
"""

from __future__ import annotations

import enum
import hashlib
import math
import struct
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError
from fractal_farm.ifs.linear_algebra import largest_singular_value
from fractal_farm.ifs.symmetry import NO_SYMMETRY, symmetry_code

Family = Literal["similarity", "affine"]
MapForm = Literal["rho R (x + d)", "rho R x + d"]
FloatArray = npt.NDArray[np.float64]

MAX_MAPS = 8
ROW_LENGTH: dict[str, int] = {"similarity": 7, "affine": 12}
GENE_NAMES = ("alpha_p", "alpha_y", "alpha_r", "rho", "d1", "d2", "d3")
RHO = 3
_ID_BYTES = 16
_HASH_DIGITS = 15  # of 60 bits, which Python keeps
_SUM_TOLERANCE = 1e-9


class Refusal(enum.IntEnum):
    """Why a genome got no score."""

    NONE = 0
    NOT_FINITE = 1
    NOT_A_CONTRACTION = 2
    SET_ASIDE = 3
    """Its evaluation died, or exceeded its bound, each time that it ran alone."""


@dataclass(frozen=True)
class Phenotype:
    """How the rows of a genome become maps and probabilities.

    Attributes:
        family: "similarity" (eq 3.2, rows of 7) or "affine" (eq 2.1, rows of 12: row-major [A | d]).
        influence: alpha of eq 3.4, at least 1; no map is drawn less often than 1 / (alpha N).
        map_form: which reading of eq 3.2; the offset is added inside or outside of rho R.
        rotation_sign: +1 for the standard rotation matrices, -1 for all angles negated.
    """

    family: Family = "similarity"
    influence: float = 4.0
    map_form: MapForm = "rho R (x + d)"
    rotation_sign: Literal[1, -1] = 1

    def __post_init__(self) -> None:
        if self.family not in ROW_LENGTH:
            raise InputError(f"phenotype: family is {self.family!r}; choose one of {', '.join(ROW_LENGTH)}")
        if self.map_form not in get_args(MapForm):
            raise InputError(f"phenotype: map_form is {self.map_form!r}; choose one of {', '.join(get_args(MapForm))}")
        if self.rotation_sign not in (1, -1):
            raise InputError(f"phenotype: rotation_sign is {self.rotation_sign!r}; give 1 or -1")
        if not (math.isfinite(self.influence) and self.influence >= 1.0):
            raise InputError(f"phenotype: influence is {self.influence}; it must be at least 1")


@dataclass(frozen=True, eq=False)
class Genome:
    """An iterated function system, as it is bred and stored.

    Attributes:
        genes: (N, 7) float64, rows (alpha_p, alpha_y, alpha_r, rho, d1, d2, d3), angles in radians; or (N, 12) for
            the affine family, row-major [A | d]. Read-only. Not validated here: see `as_genome`.
        phenotype: how rows become maps.
        probabilities: (N,) selection probabilities set by hand (section 3.1.3), or None for eqs 3.3 and 3.4.
        symmetry: name of the symmetry that makes the shape out of the attractor, see `symmetry`.
    """

    genes: FloatArray
    phenotype: Phenotype = field(default_factory=Phenotype)
    probabilities: tuple[float, ...] | None = None
    symmetry: str = NO_SYMMETRY

    def __post_init__(self) -> None:
        genes = np.array(self.genes, dtype=np.float64, order="C")
        genes.setflags(write=False)
        object.__setattr__(self, "genes", genes)

    @property
    def n_maps(self) -> int:
        """Number of maps N."""
        return int(self.genes.shape[0])

    @property
    def design_id(self) -> str:
        """32 hex digits: blake2b-128 of the genome in canonical row order and of all that shapes it."""
        return design_id(self.genes, self.phenotype, self.probabilities, self.symmetry)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Genome) and self.design_id == other.design_id

    def __hash__(self) -> int:
        return int(self.design_id[:_HASH_DIGITS], base=16)


def as_genome(value: Genome | npt.ArrayLike, name: str = "genome") -> Genome:
    """A validated genome from a `Genome` or an (N, 7) array.

    Args:
        value: genome, or (N, 7) array-like in the order of `GENE_NAMES`.
        name: how messages call it.

    Raises:
        InputError: wrong shape, a gene that is not finite, a map that does not contract, bad probabilities, or an
            unknown symmetry.
    """
    if not isinstance(value, Genome):
        try:
            value = Genome(np.asarray(value, dtype=np.float64))
        except (TypeError, ValueError):
            raise InputError(f"{name}: not a table of numbers; give N rows of 7 genes {GENE_NAMES}") from None
    genes, family = value.genes, value.phenotype.family
    width = ROW_LENGTH[family]
    if genes.ndim != 2 or genes.shape[1] != width or not 2 <= genes.shape[0] <= MAX_MAPS:
        raise InputError(f"{name}: shape {genes.shape}; a {family} genome has 2 to {MAX_MAPS} rows of {width} numbers")
    for row, gene in enumerate(genes.tolist(), start=1):
        refusal, remark = check_row(gene, family)
        if refusal:
            raise InputError(f"{name} map {row}: {remark}")
    if value.probabilities is not None:
        check_probabilities(value.probabilities, value.n_maps, name)
    symmetry_code(value.symmetry, name)
    return value


def check_row(gene: list[float], family: Family) -> tuple[Refusal, str]:
    """Whether one row is a finite contraction; the reason in words if not."""
    if not all(map(math.isfinite, gene)):
        column = next(i for i, allele in enumerate(gene) if not math.isfinite(allele))
        label = GENE_NAMES[column] if family == "similarity" else f"number {column + 1}"
        return Refusal.NOT_FINITE, f"{label} is {gene[column]}; every gene must be a finite number"
    if family == "similarity":
        if not 0.0 < gene[RHO] < 1.0:
            return Refusal.NOT_A_CONTRACTION, f"rho is {gene[RHO]:g}; it must lie between 0 and 1, exclusive"
    else:
        norm = largest_singular_value(*gene[0:3], *gene[4:7], *gene[8:11])
        if not 0.0 < norm < 1.0:
            return (
                Refusal.NOT_A_CONTRACTION,
                f"the spectral norm of A is {norm:g}; it must lie between 0 and 1, exclusive",
            )
    return Refusal.NONE, ""


def canonical_rows(genes: FloatArray) -> list[tuple[float, ...]]:
    """The rows in canonical order (lexicographic), with -0.0 written as 0.0."""
    return sorted(map(tuple, (genes + 0.0).tolist()))


def design_id(
    genes: FloatArray,
    phenotype: Phenotype,
    probabilities: tuple[float, ...] | None = None,
    symmetry: str = NO_SYMMETRY,
) -> str:
    """Identity of a design: the same for any order of its maps, different for anything that changes its points."""
    rows = canonical_rows(genes)
    if probabilities is not None:
        order = sorted(range(len(rows)), key=lambda i: tuple(a + 0.0 for a in genes[i].tolist()))
        rows = [(*row, probabilities[i]) for row, i in zip(rows, order, strict=True)]
    head = (
        f"{phenotype.family}|{float(phenotype.influence)!r}|{phenotype.map_form}|{phenotype.rotation_sign}"
        f"|{len(rows)}x{len(rows[0])}|{probabilities is not None}|"
    )
    if symmetry != NO_SYMMETRY:
        head += f"{symmetry}|"
    body = b"".join(struct.pack(f"<{len(row)}d", *row) for row in rows)
    return hashlib.blake2b(head.encode() + body, digest_size=_ID_BYTES, person=b"farm-design-1").hexdigest()


def check_probabilities(probabilities: tuple[float, ...], n_maps: int, name: str) -> None:
    """Refuse selection probabilities that are not `n_maps` numbers above 0 of sum 1, with an `InputError`."""
    if not all(isinstance(p, (int, float)) for p in probabilities):
        raise InputError(f"{name}: probabilities {probabilities!r}; give numbers")
    if len(probabilities) != n_maps:
        raise InputError(f"{name}: {len(probabilities)} probabilities for {n_maps} maps; give one for each map")
    if not all(math.isfinite(p) and p > 0.0 for p in probabilities) or abs(sum(probabilities) - 1.0) > _SUM_TOLERANCE:
        raise InputError(f"{name}: probabilities {probabilities}; each must be above 0 and their sum 1")
