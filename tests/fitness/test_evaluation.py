import hashlib
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from fractal_farm.errors import InputError
from fractal_farm.fitness import (
    FitnessFormula,
    Refusal,
    capacity_dimension,
    correlation_dimension,
    evaluate,
    evaluate_batch,
    lyapunov_exponent,
    shape_descriptor,
)
from fractal_farm.fitness.evaluation import _evaluate_genomes
from fractal_farm.fitness.formula import EVALUATOR_VERSION
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.maps import resolved_maps, selection_probabilities
from fractal_farm.ifs.random_iteration import attractor_points
from tests.table1 import TABLE1

SIMILARITY = Phenotype()
AFFINE = Phenotype(family="affine")
COLUMNS = ("d0", "d2", "lle", "fitness", "d0_error", "d2_error")


def random_genomes(count, seed=0, sizes=(2, 3)):
    generator = np.random.default_rng(seed)
    return [
        np.column_stack(
            [
                generator.uniform(-np.pi, np.pi, (n, 3)),
                generator.uniform(0.05, 0.95, n),
                generator.uniform(-2, 2, (n, 3)),
            ]
        )
        for n in generator.choice(sizes, count)
    ]


def padded(genomes, rows=8):
    genes = np.zeros((len(genomes), rows, genomes[0].shape[1]))
    for table, genome in zip(genes, genomes, strict=True):
        table[: len(genome)] = genome
    return genes, np.array([len(genome) for genome in genomes])


def table(evaluation):
    return np.column_stack([getattr(evaluation, name) for name in COLUMNS])


def test_table_1_scores_as_the_paper_says():
    evaluation = evaluate(list(TABLE1.values()))
    for i, genome in enumerate(TABLE1.values()):
        rho = np.array(genome)[:, 3]
        assert evaluation.lle[i] == pytest.approx(math.fsum(selection_probabilities(genome) * np.log(rho)), abs=1e-12)
        assert 0.55 <= evaluation.fitness[i] <= 0.95
        assert evaluation.refusal[i] == Refusal.NONE


@pytest.mark.parametrize("n_points", [500, 5000])
def test_scores_are_those_of_the_single_functions(n_points):
    genomes = random_genomes(12, sizes=(2, 3, 5, 8))
    evaluation = evaluate(genomes, n_points)
    f = FitnessFormula()
    for i, genome in enumerate(genomes):
        points = attractor_points(genome, n_points)
        assert evaluation.d0[i] == capacity_dimension(points)
        assert evaluation.d2[i] == correlation_dimension(points)
        assert evaluation.lle[i] == lyapunov_exponent(genome)
        assert np.array_equal(evaluation.descriptor[i], shape_descriptor(points))
        distance = sum(
            (value - centre) ** 2 / (2 * width**2)
            for value, (centre, width) in (
                (evaluation.d0[i] / 3, f.d0),
                (evaluation.d2[i] / 3, f.d2),
                (evaluation.lle[i], f.lle),
            )
        )
        expected = min(1.0, max(0.0, f.amplitude * math.exp(-distance) + f.baseline))
        assert evaluation.fitness[i] == pytest.approx(expected, abs=1e-12)
    assert np.all(evaluation.d0_error > 0)
    assert np.all(evaluation.d2_error > 0)


def test_repeats_give_means_over_independent_clouds_and_their_standard_errors():
    genomes = [*random_genomes(6, seed=3), Genome(resolved_maps(TABLE1["06582"]).reshape(-1, 12), AFFINE)]
    repeats = 8
    evaluation = evaluate(genomes, 1000, repeats=repeats)
    for i, genome in enumerate(genomes):
        clouds = [attractor_points(genome, 1000)]
        clouds += [attractor_points(genome, 1000, "repeat", k) for k in range(1, repeats)]
        for name, function in (("d0", capacity_dimension), ("d2", correlation_dimension)):
            samples = [function(points) for points in clouds]
            assert getattr(evaluation, name)[i] == pytest.approx(np.mean(samples))
            error = np.std(samples, ddof=1) / np.sqrt(repeats)
            assert getattr(evaluation, f"{name}_error")[i] == pytest.approx(error)
        descriptors = [shape_descriptor(points) for points in clouds]
        assert np.allclose(evaluation.descriptor[i], np.mean(descriptors, axis=0), atol=1e-6)
        errors = np.std(descriptors, axis=0, ddof=1) / np.sqrt(repeats)
        assert np.allclose(evaluation.descriptor_error[i], errors, atol=1e-6)
        assert 0 < evaluation.fitness_error[i] < 0.05
    assert np.all(evaluation.lle_error[:-1] == 0)
    assert evaluation.lle_error[-1] < 1e-12  # similarities written as affine maps


def test_one_cloud_has_no_error_but_that_of_its_slopes():
    evaluation = evaluate([*random_genomes(3), Genome(np.full((2, 12), 0.1), AFFINE)])
    assert np.all(np.isnan(evaluation.fitness_error))
    assert np.all(np.isnan(evaluation.descriptor_error))
    assert evaluation.lle_error.tolist()[:3] == [0, 0, 0]
    assert np.isnan(evaluation.lle_error[3])
    with pytest.raises(InputError, match="repeats is 0"):
        evaluate(random_genomes(1), repeats=0)


def test_standard_errors_shrink_with_the_root_of_the_repeats():
    genomes = random_genomes(20, seed=6)
    few, many = evaluate(genomes, 1000, repeats=6), evaluate(genomes, 1000, repeats=54)
    varies = few.fitness_error > 0  # those below the clip do not
    assert np.median(few.fitness_error[varies] / many.fitness_error[varies]) == pytest.approx(3, rel=0.35)
    assert np.all(np.abs(few.fitness - many.fitness) <= 6 * np.hypot(few.fitness_error, many.fitness_error))


def test_only_designs_of_the_fitness_asked_for_are_described():
    genes, n_maps = padded(random_genomes(40, seed=8))
    everything = evaluate_batch(genes, n_maps, SIMILARITY, 1000, FitnessFormula())
    some = evaluate_batch(genes, n_maps, SIMILARITY, 1000, FitnessFormula(), described_from=0.7)
    described = everything.fitness >= 0.7
    assert 0 < described.sum() < 40
    assert np.array_equal(some.descriptor[described], everything.descriptor[described])
    assert np.all(np.isnan(some.descriptor[~described]))
    assert np.array_equal(table(some), table(everything))


def test_a_score_does_not_depend_on_the_batch_or_the_order_of_the_maps():
    genomes = random_genomes(20, seed=1)
    together = table(evaluate(genomes))
    assert np.array_equal(together, np.concatenate([table(evaluate([genome])) for genome in genomes]))
    assert np.array_equal(together, table(evaluate([genome[::-1] for genome in genomes])))
    assert np.array_equal(together[::-1], table(evaluate(genomes[::-1])))
    genes, n_maps = padded(genomes, rows=3)
    assert np.array_equal(together, table(evaluate_batch(genes, n_maps, SIMILARITY, 5000, FitnessFormula())))


def test_batches_run_side_by_side_in_threads_and_agree():
    genes, n_maps = padded(random_genomes(40, seed=2))
    expected = table(evaluate_batch(genes, n_maps, SIMILARITY, 2000, FitnessFormula()))
    with ThreadPoolExecutor(4) as pool:
        jobs = [pool.submit(evaluate_batch, genes, n_maps, SIMILARITY, 2000, FitnessFormula()) for _ in range(8)]
        for job in jobs:
            assert np.array_equal(table(job.result()), expected)


def test_refused_genomes_have_no_scores_and_do_not_disturb_the_others():
    good = np.array(TABLE1["06425"])
    bad = {"not finite": good.copy(), "rho above 1": good.copy(), "rho of 1": good.copy(), "rho of 0": good.copy()}
    bad["not finite"][1, 5] = np.nan
    bad["rho above 1"][0, 3] = 1.2
    bad["rho of 1"][2, 3] = 1.0
    bad["rho of 0"][2, 3] = 0.0
    evaluation = evaluate([good, *bad.values(), good])
    codes = [Refusal.NONE, Refusal.NOT_FINITE, *[Refusal.NOT_A_CONTRACTION] * 3, Refusal.NONE]
    assert evaluation.refusal.tolist() == codes
    assert evaluation.refusal.dtype == np.uint8
    refused = table(evaluation)[1:-1]
    assert np.all(refused[:, 3] == 0)
    assert np.all(np.isnan(np.delete(refused, 3, axis=1)))
    assert np.all(np.isnan(evaluation.descriptor[1:-1]))
    assert np.array_equal(table(evaluation)[0], table(evaluation)[-1])
    assert np.all(np.isfinite(table(evaluation)[0]))


def test_an_affine_map_that_does_not_contract_is_refused():
    def rows(*norms):
        return np.array([np.column_stack([np.diag([n, 0.2, 0.1]), [i, 1, 0]]).ravel() for i, n in enumerate(norms)])

    evaluation = evaluate([Genome(rows(0.5, norm), AFFINE) for norm in (0.7, 1.0, 1.7, 0.999)])
    assert evaluation.refusal.tolist() == [0, Refusal.NOT_A_CONTRACTION, Refusal.NOT_A_CONTRACTION, 0]


def test_an_orbit_that_leaves_the_numbers_is_refused():
    genome = np.array(TABLE1["06582"])
    genome[:, 4:] = 1e308
    assert evaluate([genome]).refusal.tolist() == [Refusal.NOT_FINITE]


def test_similarities_written_as_affine_maps_score_alike():
    for genome in TABLE1.values():
        rows = resolved_maps(genome).reshape(-1, 12)
        evaluation = evaluate([genome, Genome(rows, AFFINE)])
        assert evaluation.lle[1] == pytest.approx(evaluation.lle[0], abs=1e-12)
        assert evaluation.d2[1] == pytest.approx(evaluation.d2[0], abs=0.1)
        assert evaluation.fitness[1] == pytest.approx(evaluation.fitness[0], abs=0.05)


def test_phenotypes_and_probabilities_may_be_mixed_in_one_call():
    genes = np.array(TABLE1["06582"])
    genomes = [
        Genome(genes),
        Genome(resolved_maps(genes).reshape(-1, 12), AFFINE),
        Genome(genes, Phenotype(influence=1.0)),
        Genome(genes, probabilities=(0.4, 0.6)),
        Genome(genes, Phenotype(map_form="rho R x + d")),
    ]
    evaluation = evaluate(genomes)
    assert np.array_equal(table(evaluation), np.concatenate([table(evaluate([genome])) for genome in genomes]))
    rho = np.log(genes[:, 3])
    assert evaluation.lle[2] == pytest.approx(0.5 * rho.sum(), abs=1e-12)
    assert evaluation.lle[3] == pytest.approx(0.4 * rho[0] + 0.6 * rho[1], abs=1e-12)
    assert evaluation.d0[4] != evaluation.d0[0]


def test_all_maps_with_one_fixed_point_make_a_single_point_of_dimension_zero():
    genome = [[0.1, 0.2, 0.3, 0.5, 0, 0, 0], [0.3, 0.2, 0.1, 0.6, 0, 0, 0]]
    evaluation = evaluate([genome])
    assert (evaluation.d0[0], evaluation.d2[0], evaluation.refusal[0]) == (0.0, 0.0, 0)
    assert np.all(evaluation.descriptor == 0)
    assert evaluation.lle[0] == pytest.approx(lyapunov_exponent(genome))


@pytest.mark.parametrize("n_points", [2, 3, 10, 63, 64, 65, 20_000])
def test_any_number_of_points_from_two_on_will_do(n_points):
    evaluation = evaluate(random_genomes(3), n_points)
    assert np.all((evaluation.d0 >= 0) & (evaluation.d0 <= 3))
    assert np.all((evaluation.d2 >= 0) & (evaluation.d2 <= 3))


def test_nothing_to_score_gives_nothing():
    evaluation = evaluate([])
    assert all(getattr(evaluation, name).shape == (0,) for name in (*COLUMNS, "refusal"))


def test_read_only_input_and_other_types_are_not_compiled_for_again():
    genes, n_maps = padded(random_genomes(2))
    evaluate_batch(genes, n_maps, SIMILARITY, 100, FitnessFormula())
    before = len(_evaluate_genomes.signatures)
    genes.setflags(write=False)
    n_maps.setflags(write=False)
    evaluate_batch(genes, n_maps, SIMILARITY, 100, FitnessFormula(1, 0, (0, 1), (0, 1), (0, 1)))
    evaluate_batch(np.asfortranarray(genes), n_maps.astype(np.int32), Phenotype(influence=4), 100, FitnessFormula())
    evaluate_batch(np.full((2, 2, 12), 0.1), np.array([2, 2]), AFFINE, 100, FitnessFormula())
    assert len(_evaluate_genomes.signatures) == before


def test_the_kernel_allocates_nothing_for_a_genome():
    def allocations(count):
        genes, n_maps = padded(random_genomes(count))
        before = rtsys.get_allocation_stats().mi_alloc
        evaluate_batch(genes, n_maps, SIMILARITY, 200, FitnessFormula())
        return rtsys.get_allocation_stats().mi_alloc - before

    _nrt_python.memsys_enable_stats()
    assert allocations(200) == allocations(1)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ((np.zeros((2, 3, 6)), [2, 2], SIMILARITY, 100), r"shape \(2, 3, 6\)"),
        ((np.zeros((2, 9, 7)), [2, 2], SIMILARITY, 100), "M from 1 to 8"),
        ((np.zeros((2, 3, 7)), [2, 4], SIMILARITY, 100), "numbers from 1 to 3"),
        ((np.zeros((2, 3, 7)), [2], SIMILARITY, 100), "give 2 whole numbers"),
        ((np.zeros((2, 3, 7)), [2, 2], SIMILARITY, 1), "n_points is 1; it must be at least 2"),
        ((np.zeros((2, 3, 7)), [2, 2], AFFINE, 100), r"give \(B, M, 12\)"),
    ],
)
def test_a_batch_of_a_wrong_shape_is_refused_with_the_reason(arguments, complaint):
    genes, n_maps, phenotype, n_points = arguments
    with pytest.raises(InputError, match=complaint):
        evaluate_batch(genes, np.array(n_maps), phenotype, n_points, FitnessFormula())


def test_a_genome_of_a_wrong_shape_is_refused_by_number():
    with pytest.raises(InputError, match=r"genome 1: shape \(2, 6\)"):
        evaluate([TABLE1["06582"], np.zeros((2, 6))])
    with pytest.raises(InputError, match="genome 0: not a table"):
        evaluate([[["a"] * 7] * 2])


GOOD = np.array(TABLE1["06425"])


@pytest.mark.parametrize("probabilities", [(0.5, 0.5), "abc", (0, 0, 0), (2, 3, 4), (0.5, np.nan, 0.5), (-1, 1, 1)])
def test_probabilities_that_are_none_are_refused(probabilities):
    with pytest.raises(InputError, match=r"genome 0: .*probabilities"):
        evaluate([Genome(GOOD, probabilities=probabilities)], 500)


@pytest.mark.parametrize("row", [[0, 0, 0], [0.5, -0.5, 1], [np.nan, 0.5, 0.5], [0.2, 0.2, 0.2]])
def test_a_batch_with_probabilities_that_are_none_is_refused(row):
    with pytest.raises(InputError, match="probabilities: genome 0"):
        evaluate_batch(GOOD[None], np.array([3]), SIMILARITY, 500, FitnessFormula(), np.array([row]))


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda: evaluate([GOOD], 5000.0), "n_points is 5000.0; give a whole number"),
        (lambda: evaluate([GOOD], "500"), "n_points is '500'"),
        (lambda: evaluate([GOOD], repeats=None), "repeats is None"),
        (lambda: evaluate(Genome(GOOD)), "give a list of genomes"),
        (lambda: evaluate(None), "give a list of genomes"),
        (lambda: evaluate([np.zeros((9, 7))]), "1 to 8 rows of 7"),
        (lambda: evaluate([GOOD * 1j]), "not a table of numbers"),
        (lambda: evaluate_batch(GOOD[None], [2.7], SIMILARITY, 500, FitnessFormula()), "whole numbers from 1 to 3"),
        (lambda: evaluate_batch(GOOD[None], [3], SIMILARITY, 500, FitnessFormula(), repeat=10**20), "repeat is 1"),
        (lambda: FitnessFormula(d2=(0.5, 0.0)), "d2 is"),
        (lambda: FitnessFormula(amplitude=np.nan), "amplitude nan"),
        (lambda: Phenotype(influence=0.5), "influence is 0.5; it must be at least 1"),
        (lambda: Phenotype(family="foo"), "choose one of similarity, affine"),
        (lambda: Phenotype(rotation_sign=0), "give 1 or -1"),
    ],
)
def test_other_bad_input_is_refused_with_the_reason(call, complaint):
    with pytest.raises(InputError, match=complaint):
        call()


def test_genomes_of_any_size_are_scored_or_refused():
    for exponent in (-1000, -300, 300, 340, 600, 900, 1000):
        genome = GOOD.copy()
        genome[:, 4:] = np.ldexp(genome[:, 4:], exponent)
        evaluation = evaluate([genome])
        assert evaluation.refusal[0] == Refusal.NONE
        assert 0 < evaluation.d2[0] < 3
        assert np.isfinite(evaluation.descriptor).all()


SCORES = {"scores-1": "19e4d86697adc6bb"}


def test_other_scores_are_another_version():
    """If this fails because scores were changed on purpose, count `EVALUATOR_VERSION` up and add its digest."""
    found = evaluate([*TABLE1.values(), *random_genomes(60)], 1000)
    assert hashlib.blake2b(table(found).tobytes(), digest_size=8).hexdigest() == SCORES[EVALUATOR_VERSION]
