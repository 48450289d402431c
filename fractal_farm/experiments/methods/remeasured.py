"""What a run found, measured again after it, so that luck does not count.

A run keeps what came out well, and the best of many noisy numbers are too good. Scores and signatures here come from a
cloud that no run has seen; it depends on the genome alone, not on the run's seed. Gaps are searched anew, to their end.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.config import EvolutionConfig
from fractal_farm.distinctness import first_of_each_shape, signatures
from fractal_farm.evolution.designs import SCORE_FIELDS
from fractal_farm.evolution.epoch import Candidates
from fractal_farm.experiments.methods.course import Finds
from fractal_farm.farm.work import evaluate_candidates
from fractal_farm.ifs.gap import gap
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.similarity_dimension import similarity_dimension

WALL_MM, SIZE_MM = 0.8, 30.0
PRINTS = WALL_MM / SIZE_MM  # the widest gap that a wall of that thickness closes
CRISP = 3.0  # similarity dimension up to which an attractor has visible structure
FRESH = 1  # number of the cloud

FloatArray = npt.NDArray[np.float64]


class Measured(NamedTuple):
    """Designs that qualify again, in the order in which they were found.

    Attributes:
        number: (n,) int64 number of the evaluation that found it, from 0.
        design_id: (n,) 32 hex digits as bytes.
        genes: (n, M, K) float64, padded with 0.
        n_maps: (n,) int64.
        fitness: (n,) float64, of the fresh cloud.
        marks: (n, 6) float64, its signature.
        similarity_dimension: (n,) float64.
    """

    number: npt.NDArray[np.int64]
    design_id: npt.NDArray[np.bytes_]
    genes: FloatArray
    n_maps: npt.NDArray[np.int64]
    fitness: FloatArray
    marks: FloatArray
    similarity_dimension: FloatArray

    def rows(self, chosen: npt.NDArray[Any]) -> Measured:
        """Some of them, by index or mask."""
        return Measured(*(column[chosen] for column in self))


def measured_again(finds: Finds, config: EvolutionConfig) -> Measured:
    """Those of a run's finds that qualify with a fresh cloud."""
    scores = evaluate_candidates(Candidates(finds.genes, finds.n_maps), config, FRESH)
    values = dict(zip(SCORE_FIELDS, scores.values.T, strict=True))
    still = np.flatnonzero(values["fitness"] > config.qualified)
    phenotype = config.phenotype.phenotype()
    genomes = [Genome(finds.genes[k, : finds.n_maps[k]], phenotype) for k in still.tolist()]
    return Measured(
        finds.number[still],
        np.array([genome.design_id for genome in genomes], "S32"),
        finds.genes[still],
        finds.n_maps[still],
        values["fitness"][still],
        signatures(scores.descriptors, values["d0"], values["d2"])[still],
        np.array([similarity_dimension(genome) for genome in genomes], np.float64),
    )


def joined(parts: list[Measured]) -> Measured:
    """Designs of a run that follow each other, each once."""
    columns: Any = zip(*parts, strict=True)
    whole = Measured(*(np.concatenate(column) for column in columns))
    _, first = np.unique(whole.design_id, return_index=True)
    return whole.rows(np.sort(first))


class Counter:
    """Counts designs of one run; a gap is searched only where it decides, and once.

    Attributes:
        gaps: the gaps that were searched, by the number of the evaluation.
    """

    def __init__(self, designs: Measured, phenotype: Phenotype) -> None:
        self._designs = designs
        self._phenotype = phenotype
        self.gaps: dict[int, float] = {}

    def figures(self, evaluations: int) -> tuple[dict[str, float | None], Measured]:
        """What the run had found after so many evaluations, and of it the distinct designs that print.

        Returns:
            qualified: different designs that qualify; distinct: shapes of them; printable: shapes of those that print
            in one piece; crisp: shapes of those that moreover have a similarity dimension up to `CRISP`; three_maps:
            share of these with three maps, None if there are none.
        """
        designs = self._designs.rows(self._designs.number < evaluations)
        printable = self.distinct(designs, printing=True)
        crisp = self.distinct(designs.rows(designs.similarity_dimension <= CRISP), printing=True)
        return {
            "qualified": len(designs.number),
            "distinct": len(self.distinct(designs).number),
            "printable": len(printable.number),
            "crisp": len(crisp.number),
            "three_maps": float(np.mean(crisp.n_maps == 3)) if len(crisp.number) else None,
        }, printable

    def distinct(self, designs: Measured, printing: bool = False) -> Measured:
        """One design of each shape, the best of it: greedily by (-fitness, design_id), at least 1 apart.

        Args:
            designs: some of the run's.
            printing: only those that print in one piece; what does not covers nothing.
        """
        left = np.lexsort((designs.design_id, -designs.fitness))
        while True:
            kept = left[first_of_each_shape(designs.marks[left])]
            wide = [row for row in kept.tolist() if not self._prints(designs, row)] if printing else []
            if not wide:
                return designs.rows(kept)
            # Those in its stead may be wide, too; a wide one that is not kept changes nothing.
            left = left[~np.isin(left, wide)]

    def _prints(self, designs: Measured, row: int) -> bool:
        number = int(designs.number[row])
        if number not in self.gaps:
            self.gaps[number] = gap(Genome(designs.genes[row, : designs.n_maps[row]], self._phenotype))
        return self.gaps[number] <= PRINTS
