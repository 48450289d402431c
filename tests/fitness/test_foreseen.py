"""What is foreseen of genomes, against independent solutions and against what is measured."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fractal_farm.bench.genomes import random_genomes
from fractal_farm.bench.truth import Fractal
from fractal_farm.distinctness import signatures
from fractal_farm.errors import InputError
from fractal_farm.fitness import FitnessFormula, evaluate, foresee
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.maps import selection_probabilities
from fractal_farm.ifs.similarity_dimension import similarity_dimension
from tests.table1 import TABLE1

FORMULA = FitnessFormula()


def foreseen(genomes):
    most = max(len(genome) for genome in genomes)
    genes = np.zeros((len(genomes), most, 7))
    for index, genome in enumerate(genomes):
        genes[index, : len(genome)] = genome
    return foresee(genes, np.array([len(genome) for genome in genomes]), Phenotype(), FORMULA)


@pytest.fixture(scope="module")
def crisp():
    genes, n_maps = random_genomes(1500, seed=41)
    genomes = [table[:n] for table, n in zip(genes, n_maps, strict=True)]
    return [genome for genome in genomes if 1 <= similarity_dimension(genome) <= 3]


@given(st.lists(st.floats(0.01, 0.95), min_size=2, max_size=8))
def test_dimensions_and_fitness_are_the_closed_forms(ratios):
    rows = np.array([[0, 0, 0, rho, index, 0, 0] for index, rho in enumerate(ratios)], float)
    n = len(ratios)
    probabilities = selection_probabilities(Genome(rows))
    truth = Fractal("", np.array(ratios), np.repeat(np.eye(3)[None], n, 0), np.zeros((n, 3)), probabilities)
    terms = ((truth.d0 / 3, FORMULA.d0), (truth.d2 / 3, FORMULA.d2), (truth.lle, FORMULA.lle))
    distance = sum((value - centre) ** 2 / (2 * width**2) for value, (centre, width) in terms)
    found = foreseen([rows])
    assert min(found.d0[0], 3.0) == pytest.approx(truth.d0, abs=1e-6)
    assert min(found.d2[0], 3.0) == pytest.approx(truth.d2, abs=1e-6)
    expected = min(1.0, max(0.0, FORMULA.amplitude * math.exp(-distance) + FORMULA.baseline))
    assert found.fitness[0] == pytest.approx(expected, abs=1e-6)


def test_what_is_promised_is_kept(crisp):
    fitness = evaluate(crisp).fitness
    promised = foreseen(crisp).fitness >= 0.85
    assert np.mean(fitness[promised] > 0.85) > 0.97
    assert np.mean(promised[fitness > 0.85]) > 0.7


def test_the_shape_that_is_foreseen_is_near_the_one_that_comes(crisp):
    measured = evaluate(crisp)
    good = measured.fitness > 0.85
    found = foreseen(crisp)
    marks = signatures(measured.descriptor, measured.d0, measured.d2)[good]
    expected = signatures(found.descriptor, np.minimum(found.d0, 3), np.minimum(found.d2, 3))[good]
    assert np.median(np.linalg.norm(expected - marks, axis=1)) < 0.25 * np.median(
        np.linalg.norm(marks - np.roll(marks, 1, axis=0), axis=1)
    )


def test_a_uniform_measure_on_a_segment_has_the_descriptor_of_a_segment():
    halves = np.array([[0, 0, 0, 0.5, 0, 0, 0], [0, 0, 0, 0.5, 1, 0, 0]])
    descriptor = foreseen([halves]).descriptor[0]
    # The distance t of two points of [0, 1] has the distribution 2 t - t^2 and the mean square 1 / 6.
    ends = 1 - np.sqrt(1 - np.arange(13) / 12)
    means = 12 * np.diff(ends**2 - 2 * ends**3 / 3) * math.sqrt(6)
    assert descriptor[:12] == pytest.approx(means, abs=0.02)
    assert descriptor[12:] == pytest.approx([0, 0], abs=1e-6)


def test_motion_size_and_order_of_maps_do_not_matter():
    maps = np.array(TABLE1[0] if not isinstance(TABLE1, dict) else next(iter(TABLE1.values())), float)
    bigger = maps.copy()
    bigger[:, 4:] *= 3.0
    found = foreseen([maps, maps[::-1], bigger])
    assert found.descriptor[1] == pytest.approx(found.descriptor[0], abs=1e-6)
    assert found.descriptor[2] == pytest.approx(found.descriptor[0], abs=1e-6)
    assert found.d0.tolist() == [found.d0[0]] * 3


def test_a_point_has_no_extent():
    point = np.array([[0, 0, 0, 0.5, 0, 0, 0], [0, 0, 0, 0.25, 0, 0, 0]])
    assert foreseen([point]).descriptor[0].tolist() == [0.0] * 14


def test_affine_maps_cannot_be_foreseen():
    with pytest.raises(InputError, match=r"phenotype\.family"):
        foresee(np.zeros((1, 2, 12)), np.array([2]), Phenotype(family="affine"), FORMULA)
