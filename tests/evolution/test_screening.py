"""Which candidates are evaluated: what they promise, that they differ, and that it depends on nothing else."""

import numpy as np

from fractal_farm.config import EvolutionConfig
from fractal_farm.distinctness import signatures
from fractal_farm.evolution.designs import design_dtype
from fractal_farm.evolution.epoch import Candidates
from fractal_farm.evolution.screening import ForeseenShapes, screened_founders, screened_offspring
from fractal_farm.farm.work import evaluate_candidates
from fractal_farm.ifs.gap import gap
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.similarity_dimension import similarity_dimension

NOBODY = np.zeros(0, design_dtype(3, 7))


def config(**niches):
    return EvolutionConfig.model_validate({"seed": 3, "library": {"size": 40}, "niches": niches})


def driven(steps, settings):
    try:
        candidates = next(steps)
        while True:
            candidates = steps.send(evaluate_candidates(candidates, settings))
    except StopIteration as stop:
        return stop.value


def bred(library, settings, generation, known=None):
    """A block of 64 slots, and its scores; `known` are shapes foreseen elsewhere."""
    marks = library["foreseen"] if known is None else known
    shapes = ForeseenShapes(marks, settings)
    return driven(screened_offspring(library, settings, 0, generation, 0, 64, shapes), settings)


def genomes_of(brood):
    return [Genome(genes[:n]) for genes, n in zip(brood.genes, brood.n_maps, strict=True)]


def test_candidates_are_crisp_print_and_are_foreseen_to_differ():
    settings = config()
    brood, scores = bred(NOBODY, settings, 1)
    assert len(brood.slots) > 10
    assert np.all(np.diff(brood.slots) > 0)
    assert all(gap(genome) <= settings.niches.gap for genome in genomes_of(brood))
    assert all(1 <= similarity_dimension(genome) <= 3 for genome in genomes_of(brood))
    assert np.mean(scores.values[:, 3] > 0.85) > 0.9
    marks = brood.foreseen.astype(float)
    apart = np.linalg.norm(marks[:, None] - marks[None], axis=2)[np.triu_indices(len(marks), 1)]
    assert apart.min() >= 1.0


def test_what_is_like_a_member_is_not_evaluated():
    settings = config()
    brood, _ = bred(NOBODY, settings, 1)
    library = np.zeros(len(brood.slots), NOBODY.dtype)
    for name in ("genes", "n_maps", "foreseen"):
        library[name] = getattr(brood, name)
    library["design_id"] = [genome.design_id.encode() for genome in genomes_of(brood)]
    children, _ = bred(library, settings, 2)
    apart = np.linalg.norm(children.foreseen[:, None].astype(float) - library["foreseen"][None], axis=2)
    assert len(children.slots) > 10
    assert apart.min() >= 1.0 - 1e-6


def test_what_is_like_a_shape_found_elsewhere_is_not_evaluated():
    settings = config()
    alone, _ = bred(NOBODY, settings, 1)
    told, _ = bred(NOBODY, settings, 2, known=alone.foreseen)
    apart = np.linalg.norm(told.foreseen[:, None].astype(float) - alone.foreseen[None], axis=2)
    assert len(told.slots) > 10
    assert apart.min() >= 1.0 - 1e-6


def test_candidates_of_earlier_generations_are_forgotten_unless_they_became_members():
    settings = config()
    marks = np.arange(12, dtype=np.float32)[:, None] * np.full(6, 10, np.float32)
    shapes = ForeseenShapes(marks[:4], settings)
    assert shapes.are_new(marks).tolist() == [False] * 4 + [True] * 8
    assert shapes.enter(marks[4:9]).all()
    assert not shapes.enter(marks[4:9]).any()
    shapes.forget_candidates(marks[4:6])
    assert shapes.enter(marks[4:]).tolist() == [False] * 2 + [True] * 6


def test_any_shape_and_any_gap_will_do_when_so_configured():
    settings = config(foreseen_distance=None, gap_attempts=0, fullness=None)
    brood, _ = bred(NOBODY, settings, 1)
    assert len(brood.slots) > 60
    assert max(gap(genome) for genome in genomes_of(brood)) > settings.niches.gap


def test_what_was_foreseen_is_near_what_comes():
    settings = config(gap_attempts=0)
    brood, scores = bred(NOBODY, settings, 1)
    marks = signatures(scores.descriptors, scores.values[:, 0], scores.values[:, 1])
    known = np.isfinite(marks).all(axis=1)
    assert np.median(np.linalg.norm(marks - brood.foreseen, axis=1)[known]) < 1.5


def test_founders_promise_to_qualify_and_seeds_come_first():
    seed = [[0.1, 0.2, 0.3, 0.5, 1.0, 0.0, 0.0], [0.0, 0.1, 0.0, 0.6, -1.0, 0.5, 0.0]]
    settings = EvolutionConfig.model_validate({"library": {"size": 40, "seeds": [seed]}})
    brood = driven(screened_founders(settings, 0), settings)
    assert brood.genes[0, :2].tolist() == seed
    assert np.isfinite(brood.foreseen[1:]).all()
    fitness = evaluate_candidates(Candidates(brood.genes, brood.n_maps), settings).values[1:, 3]
    assert np.mean(fitness > 0.85) > 0.9
