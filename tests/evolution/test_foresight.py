"""What the closed forms promise, against independent solutions and against what is measured."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fractal_farm.bench.genomes import random_genomes
from fractal_farm.bench.truth import Fractal
from fractal_farm.config import EvolutionConfig
from fractal_farm.evolution.foresight import expected_fitness, floored
from fractal_farm.fitness import evaluate
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.maps import selection_probabilities
from fractal_farm.ifs.similarity_dimension import similarity_dimension

CONFIG = EvolutionConfig()


def genome_of(ratios):
    return Genome(np.array([[0, 0, 0, rho, index, 0, 0] for index, rho in enumerate(ratios)], float))


@given(st.lists(st.floats(0.01, 0.95), min_size=2, max_size=8))
def test_the_promise_is_eq_3_7_of_the_closed_forms(ratios):
    probabilities = selection_probabilities(genome_of(ratios))
    assert floored(ratios, 4.0) == pytest.approx(probabilities.tolist(), abs=1e-12)
    n = len(ratios)
    truth = Fractal("", np.array(ratios), np.repeat(np.eye(3)[None], n, 0), np.zeros((n, 3)), probabilities)
    f = CONFIG.fitness
    terms = ((truth.d0 / 3, f.d0), (truth.d2 / 3, f.d2), (truth.lle, f.lle))
    distance = sum((value - centre) ** 2 / (2 * width**2) for value, (centre, width) in terms)
    expected = min(1.0, max(0.0, f.amplitude * math.exp(-distance) + f.baseline))
    assert expected_fitness(ratios, CONFIG) == pytest.approx(expected, abs=1e-6)


def test_what_is_promised_is_kept():
    genes, n_maps = random_genomes(1500, seed=41)
    genomes = [table[:n] for table, n in zip(genes, n_maps, strict=True)]
    crisp = [genome for genome in genomes if 1 <= similarity_dimension(genome) <= 3]
    fitness = evaluate(crisp).fitness
    promised = np.array([expected_fitness(genome[:, 3].tolist(), CONFIG) for genome in crisp]) >= 0.85
    assert np.mean(fitness[promised] > 0.85) > 0.97
    assert np.mean(promised[fitness > 0.85]) > 0.7
