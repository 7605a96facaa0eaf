"""Choosing among models: one scale for all of them, and differences that the held-out records can carry."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.identification.model_selection import Follows, error, lead, shared_bic


def test_every_criterion_counts_the_numbers_of_the_closest_model() -> None:
    poor, close = Follows(4.0, 20.0, 2), Follows(1.0, 100.0, 5)
    expected = [100 * np.log(4.0) + 2 * np.log(100.0), 5 * np.log(100.0)]
    assert shared_bic([poor, close]) == pytest.approx(expected)
    assert shared_bic([close, poor]) == pytest.approx(expected[::-1])


def test_a_parameter_that_buys_nothing_costs_the_logarithm_of_the_numbers() -> None:
    one, more = shared_bic([Follows(1.0, 50.0, 3), Follows(1.0, 50.0, 4)])
    assert more - one == pytest.approx(np.log(50.0))


def test_the_lead_is_the_difference_of_the_errors_and_its_doubt_falls_with_the_frames() -> None:
    rng = np.random.default_rng(0)
    doubts = []
    for frames in (400, 6400):
        one, other = {"r": rng.chisquare(2, frames) * 4.0}, {"r": rng.chisquare(2, frames)}
        gap, doubt = lead(one, other)
        assert gap == pytest.approx(error(one) - error(other))
        doubts.append(doubt)
    assert doubts[0] / doubts[1] == pytest.approx(4.0, rel=0.4)


def test_the_doubt_of_a_lead_is_what_repetition_shows() -> None:
    rng = np.random.default_rng(1)
    pairs = [lead({"r": rng.chisquare(2, 300) * 1.5}, {"r": rng.chisquare(2, 300)}) for _ in range(200)]
    gaps, doubts = np.array(pairs).T
    assert np.median(doubts) == pytest.approx(gaps.std(), rel=0.2)


def test_slow_differences_count_for_little() -> None:
    slow = np.repeat(np.random.default_rng(2).chisquare(2, 40), 10)
    fast = np.random.default_rng(2).permutation(slow)
    none = {"r": np.full(400, 1.0)}
    assert lead({"r": slow}, none)[1] > 2 * lead({"r": fast}, none)[1]


def test_models_are_compared_on_the_same_records() -> None:
    with pytest.raises(InputError, match="same records, got a and b"):
        lead({"a": np.ones(9)}, {"b": np.ones(9)})
