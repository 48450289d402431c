"""Bare lines: which they are, and that neither archives nor evaluations are spent on them."""

import numpy as np
import pytest

from fractal_farm.config import EvolutionConfig
from fractal_farm.evolution.designs import Operator
from fractal_farm.evolution.epoch import IslandState, founding_state, library_after
from fractal_farm.evolution.fullness import is_full
from fractal_farm.evolution.island import advance, drive
from fractal_farm.farm.work import evaluate_candidates
from fractal_farm.fitness import FitnessFormula, evaluate, foresee
from fractal_farm.ifs.genome import Genome, Phenotype
from tests.ifs.attractors import TETRAHEDRON
from tests.table1 import TABLE1

SEGMENT = np.array([[0, 0, 0, 0.5, -1, 0, 0], [0, 0, 0, 0.5, 1, 0, 0]])
# Arms from the origin along (±.2, 0, 1), and a cone about the same axis with a helix of small pieces on it.
NARROW_V = np.array([[0, 0, np.pi, 0.95, 0, 0, 0], [0, 0, 0, 0.05, 4, 0, 20]])
THIN_HELIX = np.array([[0, 0, 0.5, 0.96, 0, 0, 0], [0, 0, 0, 0.04, 2.5, 0, 25]])
FLAT_SPIRAL = np.array([[0, 0, 0.4, 0.95, 0.1, 0, 0], [0, 0, 0.4, 0.35, 2, 0, 0]])


DEFAULT = EvolutionConfig()
SMALL = {"offspring": 48, "generations_per_epoch": 2, "library": {"size": 60, "seeds": [SEGMENT.tolist()]}}


def measured(genome):
    scores = evaluate([Genome(np.asarray(genome))])
    return scores.d0, scores.descriptor


def expected(genome):
    genes = np.asarray(genome)[None]
    foreseen = foresee(genes, np.array([genes.shape[1]]), Phenotype(), FitnessFormula())
    return foreseen.d2, foreseen.descriptor


@pytest.mark.parametrize("found_out", [measured, expected])
@pytest.mark.parametrize("genome", [SEGMENT, NARROW_V, THIN_HELIX], ids=["segment", "narrow V", "thin helix"])
def test_lines_are_not_full(genome, found_out):
    assert not is_full(*found_out(genome), DEFAULT)[0]


@pytest.mark.parametrize("found_out", [measured, expected])
@pytest.mark.parametrize(
    "genome", [TETRAHEDRON, TABLE1["06425"], FLAT_SPIRAL], ids=["tetrahedron", "coral", "flat spiral"]
)
def test_what_branches_or_lies_flat_is_full(genome, found_out):
    assert is_full(*found_out(genome), DEFAULT)[0]


def test_a_number_that_is_unknown_is_not_full_unless_anything_will_do():
    unknown = np.array([np.nan, 2.0]), np.full((2, 14), [[0.5], [np.nan]], np.float32)
    assert is_full(*unknown, DEFAULT).tolist() == [False, False]
    anything = EvolutionConfig.model_validate({"niches": {"fullness": None}})
    assert is_full(*unknown, anything).tolist() == [True, True]


def grown(**niches):
    """What an island evaluated, as (d0, descriptors) of the qualified, and its archive."""
    config = EvolutionConfig.model_validate({**SMALL, "niches": niches})
    evaluated = []

    def evaluate_and_note(candidates):
        scores = evaluate_candidates(candidates, config)
        if candidates.wanted == "scores":
            known = np.isfinite(scores.descriptors[:, 0])
            evaluated.append((scores.values[known, 0], scores.descriptors[known]))
        return scores

    state = founding_state(config)
    for epoch in range(2):
        record = drive(advance(state, [], config, 0, epoch), evaluate_and_note)
        state = IslandState(epoch, library_after(state.library, record))
    d0, descriptors = (np.concatenate(column) for column in zip(*evaluated, strict=True))
    return d0, descriptors, state.library


def test_an_archive_holds_no_bare_lines_but_those_that_were_given_as_seeds():
    d0, descriptors, library = grown()
    bare = ~is_full(library["d0"], library["descriptor"], DEFAULT)
    assert len(library) > 40
    assert set(library["operator"][bare].tolist()) <= {Operator.SEED}
    assert np.mean(~is_full(d0, descriptors, DEFAULT)) < 0.04  # evaluations that were spent on them

    d0, descriptors, library = grown(fullness=None)
    assert np.mean(~is_full(library["d0"], library["descriptor"], DEFAULT)) > 0.1
    assert np.mean(~is_full(d0, descriptors, DEFAULT)) > 0.1
