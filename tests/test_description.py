"""Descriptions: shapes that were constructed as stars, ribbons, conches and balls are found as such."""

from __future__ import annotations

import numpy as np
import pytest

from fractal_farm.description import DESCRIPTIONS, checked_description, features_of, likeness
from fractal_farm.errors import InputError
from tests.constructed import ball, conch, ribbon, star

SHAPES = {
    "star": [star(5), star(7, 1.0)],
    "snowflake": [star(6), star(6, 2.0)],
    "ribbon": [ribbon(), ribbon(1.0)],
    "conch": [conch(), conch(2.0)],
    "ball": [ball()],
}


@pytest.mark.parametrize("word", SHAPES)
def test_a_word_ranks_what_was_made_for_it_above_everything_else(word):
    own = [likeness(features_of(genome), word).score for genome in SHAPES[word]]
    also = {"star": "snowflake"}.get(word)
    other = [
        likeness(features_of(genome), word).score
        for name, genomes in SHAPES.items()
        if name not in (word, also)
        for genome in genomes
    ]
    assert min(own) > 0.6
    assert min(own) > max(other)


@pytest.mark.parametrize("rays", [4, 5, 6, 7, 9])
def test_rays_are_counted(rays):
    found = features_of(star(rays, 0.7))
    assert found.fold == rays
    assert found.symmetry > 0.6
    assert found.rays > 0.5


def test_a_score_is_explained_by_its_parts():
    found = likeness(features_of(star(5)), "star")
    assert found.score == pytest.approx(np.prod(list(found.parts.values())) ** (1 / len(found.parts)))
    assert "5-fold symmetry" in found.explained()


def test_words_are_read_with_like_and_others_refused():
    assert checked_description("Star-like") == "star"
    assert {checked_description(word) for word in DESCRIPTIONS} == set(DESCRIPTIONS)
    with pytest.raises(InputError, match="ribbon"):
        checked_description("lovely")
