"""Choosing among models: one scale for all of them, and differences that the held-out records can carry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.actuators import chen2018
from pliant.errors import InputError
from pliant.identification import FitResult, Parameter
from pliant.identification.model_selection import Follows, error, lead, shared_bic, undetermined
from pliant.identification.stage_fit import StageResult
from pliant.identification.stages import Stage
from pliant.identification.stepwise import chosen


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
    with pytest.raises(InputError, match="same recordings, got a and b"):
        lead({"a": np.ones(9)}, {"b": np.ones(9)})


def fitted(*parameters: Parameter) -> FitResult:
    return FitResult(chen2018.model(), parameters, "", {"p": 1e-3}, 1, 0.0, converged=True)


def stage(name: str, missed: float, *parameters: Parameter, added: set[str] | None = None) -> StageResult:
    """A stage whose held-out record is missed by so much, % of travel, on every frame."""
    result = fitted(*parameters)
    square = missed**2 * np.random.default_rng(3).uniform(0.9, 1.1, 400)
    return StageResult(
        Stage(name, name), result, held_out={"h": missed}, missed={"h": square}, follows=Follows(missed, 100.0, 2),
        open=", ".join(undetermined(result, added or set()).values()),
    )


def test_a_parameter_is_determined_to_half_of_its_value() -> None:
    sure, vague = Parameter("stiffness", 1.0, std=0.4), Parameter("creep_time_2", 359.0, std=19813.0)
    assert not undetermined(fitted(sure), set())
    assert undetermined(fitted(sure, vague), set()) == {"creep_time_2": "creep_time_2 is known as 359 +- 2e+04 s"}
    assert not undetermined(fitted(Parameter("torque_2", 1e-13)), set()), "of any sign, and not what the stage adds"
    unseen = undetermined(fitted(Parameter("torque_2", 1e-13)), {"torque_2"})
    assert unseen == {"torque_2": "torque_2 is not shown by the recordings"}
    bound = undetermined(fitted(Parameter("slip_share_1", 0.0, std=0.1)), {"slip_share_1"})
    assert "ends at its bound of 0" in bound["slip_share_1"]
    assert not undetermined(fitted(Parameter("damping", 0.0, std=0.1)), set()), "a lower stage's, at its bound"
    for other in (Parameter("mass", 0.3, std=0.2, prior_std=0.2), Parameter("p.release_time", 0.02, std=0.1)):
        assert not undetermined(fitted(other), {other.name})


def test_the_best_stage_stands_back_where_it_is_not_determined_and_every_stage_says_why() -> None:
    vague = Parameter("creep_time_2", 359.0, std=19813.0)
    two = stage("two", 0.5, vague, added={"creep_time_2"})
    found = chosen([stage("low", 3.0), stage("good", 1.0), stage("more", 0.99), two])
    assert found.chosen == "good"
    low, good, more, two = (s.reason for s in found.stages)
    assert low.startswith("its error on held-out recordings is 2 % of travel higher")
    assert not good
    assert more.startswith("its error on held-out recordings is 0.01 % of travel lower, less than 5 %")
    assert two == "not determined by the recordings (standard error over 50 %): creep_time_2 is known as 359 +- 2e+04 s"
    assert two in str(found)
    assert found.to_dict()["stages"]["two"]["not_determined"]
    assert chosen([stage("two", 0.5, vague, added={"creep_time_2"})]).chosen == "two", "no other is there"


def test_by_training_the_lowest_bic_is_chosen_whatever_the_held_out_records_say() -> None:
    results = [replace(stage(name, missed), follows=Follows(square, 100.0, free)) for name, missed, square, free in (
        ("poor", 0.5, 9.0, 2), ("close", 2.0, 1.0, 4), ("more", 0.6, 0.99, 8))]  # fmt: skip
    vague = Stage("vague", "vague")
    results.append(replace(results[1], stage=vague, follows=Follows(0.5, 100.0, 5), open="creep_time_2"))
    found = chosen(results, "training")
    assert found.chosen == "close"
    assert found.reason == "close: lowest BIC of the training recordings; held-out recordings had no part in it."
    said = {s.stage.name: s.reason for s in found.stages}
    assert said["poor"] == said["more"] == "its BIC is higher"
    assert said["vague"].startswith("not determined by the recordings")
    assert chosen(results).chosen == "poor"


def test_records_that_scatter_widen_the_doubt() -> None:
    noise = np.random.default_rng(4).uniform(0.99, 1.01, 400)
    better, worse = {"a": 1.0 * noise, "b": 9.0 * noise}, {"a": 4.0 * noise, "b": 4.0 * noise}
    gap, doubt = lead(better, worse)
    assert abs(gap) < 0.05
    assert doubt == pytest.approx(1.0, rel=0.02)
