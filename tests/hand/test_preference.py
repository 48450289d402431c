"""Preferences learned from synthetic people: of known taste, and of none."""

import shutil

import numpy as np
import pytest

from fractal_farm.catalogue import Catalogue, design_table, judge
from fractal_farm.errors import InputError
from fractal_farm.fitness import evaluate
from fractal_farm.hand.features import NAMED, features_of
from fractal_farm.hand.preference import fit_preference, preference_of
from fractal_farm.ifs.gap import gap
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.similarity_dimension import similarity_dimension

N = 240
THICKNESS, MAPS, FITNESS = (NAMED.index(name) for name in ("thickness", "number of maps", "fitness"))


@pytest.fixture(scope="module")
def table():
    """Random genomes of two and three maps with all that a model sees of them."""
    rng = np.random.default_rng(5)
    genomes = []
    for number in range(N):
        maps = 2 + number % 2
        angles, rho = rng.uniform(-np.pi, np.pi, (maps, 3)), rng.uniform(0.3, 0.75, (maps, 1))
        genomes.append(Genome(np.hstack([angles, rho, rng.uniform(-2, 2, (maps, 3))])))
    scores = evaluate(genomes, n_points=1000)
    columns = {name: getattr(scores, name) for name in ("d0", "d2", "lle", "fitness", "descriptor")}
    columns["gap"] = [gap(genome) for genome in genomes]
    columns["similarity_dimension"] = [similarity_dimension(genome) for genome in genomes]
    return design_table(genomes, columns)


@pytest.fixture(scope="module")
def features(table):
    return features_of(table)


def grades(liking):
    """Six grades of equal size, from 0 to 5, as somebody gives who likes what has a high value."""
    return np.floor(6.0 * np.argsort(np.argsort(liking)) / len(liking))


def standardised(values):
    return (values - values.mean()) / values.std()


def test_features_are_what_their_names_say(table, features):
    row = table.slice(7, 1).to_pylist()[0]
    ratios = sorted(
        abs(np.linalg.det(np.reshape(one, (3, 4))[:, :3])) ** (1 / 3)
        for one in np.split(np.array(row["maps"]), row["n_maps"])
    )
    seen = dict(zip(NAMED, features[7], strict=False))
    assert seen["number of maps"] == row["n_maps"] == 3
    assert (seen["smallest ratio"], seen["largest ratio"]) == pytest.approx((ratios[0], ratios[-1]))
    assert (seen["thickness"], seen["breadth"]) == pytest.approx(tuple(row["descriptor"][-2:]))
    assert 10 ** seen["gap"] == pytest.approx(max(row["gap"], 1e-4))
    assert np.isfinite(features).all()


@pytest.mark.parametrize("judged", [40, 200])
def test_a_taste_for_flat_designs_of_three_maps_is_learned_and_named(features, judged):
    rng = np.random.default_rng(judged)
    chosen = rng.permutation(N)[:judged]
    liking = standardised(features[:, MAPS]) - standardised(features[:, THICKNESS]) + 0.3 * rng.standard_normal(N)
    model = fit_preference(features[chosen], grades(liking[chosen]), features[chosen, FITNESS])
    assert model.useful
    assert model.accuracy.value > 0.8
    assert {name for name, _ in model.looks_at[:5]} >= {"number of maps", "thickness"}
    assert dict(model.looks_at)["number of maps"] > 0 > dict(model.looks_at)["thickness"]
    if judged < N:
        others = np.setdiff1d(np.arange(N), chosen)
        assert np.corrcoef(model.predict(features[others]), liking[others])[0, 1] > 0.7


def test_the_accuracy_that_is_claimed_is_reached_with_designs_that_nobody_has_judged(features):
    rng = np.random.default_rng(1)
    liking = standardised(features[:, FITNESS]) + standardised(features[:, MAPS]) + 0.8 * rng.standard_normal(N)
    order = rng.permutation(N)
    chosen, others = order[:120], order[120:]
    model = fit_preference(features[chosen], grades(liking[chosen]), features[chosen, FITNESS])
    predicted, truth = model.predict(features[others]), grades(liking[others])
    differs = np.sign(truth[:, None] - truth[None])
    right = (np.sign(predicted[:, None] - predicted[None]) == differs)[differs != 0].mean()
    assert model.accuracy.low <= right <= model.accuracy.high


def test_coins_are_found_out(features):
    useful = better = 0
    for toss in range(40):
        rng = np.random.default_rng([9, toss])
        chosen = rng.permutation(N)[:60]
        model = fit_preference(features[chosen], rng.integers(0, 6, 60).astype(float), features[chosen, FITNESS])
        useful += model.useful
        better += model.accuracy.low > 0.5
        assert model.accuracy.low > 0.5 or "no better than chance" in model.verdict
    assert better <= 3
    assert useful <= 2


def test_somebody_who_likes_fitness_gets_no_promise_beyond_it(features):
    liking = features[:, FITNESS] + 0.01 * np.random.default_rng(2).standard_normal(N)
    model = fit_preference(features, grades(liking), features[:, FITNESS])
    assert model.fitness_accuracy.value > 0.9
    assert model.verdict == "better than chance, and no better than fitness alone"


def test_the_same_judgements_give_the_same_model(features):
    marks = grades(features[:, THICKNESS])
    one, two = (fit_preference(features, marks, features[:, FITNESS]) for _ in range(2))
    assert (one.accuracy, one.looks_at) == (two.accuracy, two.looks_at)
    np.testing.assert_array_equal(one.weights, two.weights)


@pytest.mark.parametrize(
    ("count", "stars", "words"), [(29, range(29), "29 judged designs, 1 short of the 30"), (31, [4] * 31, "4 stars")]
)
def test_too_few_or_equal_judgements_are_refused_with_what_is_missing(grown, ids, tmp_path, count, stars, words):
    path = tmp_path / "run"
    shutil.copytree(grown, path)
    for number, value in enumerate(stars):
        judge(path, [ids[number]], stars=value % 6)
    with pytest.raises(InputError, match=words):
        preference_of(path)


def test_favourites_and_rejected_designs_are_judgements_and_withdrawn_ones_are_not(grown, ids, tmp_path):
    path = tmp_path / "run"
    shutil.copytree(grown, path)
    judge(path, ids[:20], stars=0)
    judge(path, ids[20:40], favourite=True)
    judge(path, ids[40:50], favourite=False)
    assert preference_of(path).judged == 40
    assert Catalogue.open(path).designs().num_rows > 50
