import numpy as np
import pytest

from fractal_farm.distinctness import signatures
from fractal_farm.errors import InputError
from fractal_farm.fitness import FitnessFormula, evaluate, evaluate_batch, foresee
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.symmetry import SYMMETRIES, symmetry_codes
from tests.ifs.attractors import lattice, random_genome

NAMES = ["none", "rotation:4", "mirror", "dihedral:3", "helix:6"]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("genes", "dimension"), [(lattice(0.25, 3.0, axes=2), 1.0), (lattice(0.25, 3.0), 1.5)])
def test_copies_of_an_attractor_have_its_dimensions_and_its_exponent(genes, dimension, name):
    scores = evaluate([Genome(genes, symmetry=name), genes], 20_000, repeats=4)
    # At the coarse scales of a cloud copies fill the space between each other: the estimates rise.
    assert dimension - 0.05 <= scores.d0[0] <= dimension + 0.25
    assert dimension - 0.05 <= scores.d2[0] <= dimension + 0.2
    assert scores.lle[0] == scores.lle[1]


def test_a_batch_scores_each_genome_with_its_own_symmetry():
    genes = np.zeros((len(SYMMETRIES), 3, 7))
    genomes = []
    for number, symmetry in enumerate(SYMMETRIES):
        rows = random_genome(number)
        genes[number, : len(rows)] = rows
        genomes.append(Genome(rows, symmetry=symmetry.name))
    n_maps = np.array([genome.n_maps for genome in genomes])
    codes = symmetry_codes(genome.symmetry for genome in genomes)
    together = evaluate_batch(genes, n_maps, Phenotype(), 1000, FitnessFormula(), symmetries=codes)
    alone = [evaluate([genome], 1000) for genome in genomes]
    np.testing.assert_array_equal(together.d2, [scores.d2[0] for scores in alone])
    np.testing.assert_array_equal(together.descriptor, [scores.descriptor[0] for scores in alone])


@pytest.mark.parametrize("codes", [[25], [-1], [0, 0], [0.5], "a"])
def test_codes_of_no_symmetry_are_refused(codes):
    genes, n_maps = np.array([random_genome(0)]), np.array([len(random_genome(0))])
    for score in (evaluate_batch, foresee):
        points = () if score is foresee else (1000,)
        with pytest.raises(InputError, match="give 1 codes from 0 to 24"):
            score(genes, n_maps, Phenotype(), *points, FitnessFormula(), symmetries=codes)


@pytest.mark.parametrize("name", ["rotation:3", "rotation:12", "mirror", "dihedral:6", "helix:8"])
def test_shapes_are_foreseen_with_a_symmetry_to_half_of_what_makes_designs_distinct(name):
    genomes = [random_genome(seed, (1.0, 2.0)) for seed in range(60)]
    genes = np.zeros((60, 3, 7))
    for row, rows in zip(genes, genomes, strict=True):
        row[: len(rows)] = rows
    n_maps = np.array([len(rows) for rows in genomes])

    foreseen = foresee(genes, n_maps, Phenotype(), FitnessFormula(), symmetries=symmetry_codes([name] * 60))
    found = evaluate([Genome(rows, symmetry=name) for rows in genomes])
    marks = [signatures(descriptor, found.d0, found.d2) for descriptor in (foreseen.descriptor, found.descriptor)]
    assert np.median(np.linalg.norm(marks[0] - marks[1], axis=1)) < 0.5
