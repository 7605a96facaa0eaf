"""What recordings cannot tell is said before the fit, in words, with what would cure it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pliant.errors import FitError
from pliant.identification import Parameter, fit, identifiability
from pliant.identification.identifiability import combinations
from pliant.identification.problem import Problem
from pliant.identification.uncertainty import Covariance
from pliant.model import Model
from pliant.simulation import PointForce


def test_stiffness_damping_gain_and_mass_share_one_scale(truth: Model, pulse: Any) -> None:
    names = ["gain", "stiffness", "damping", "mass"]
    told = identifiability([pulse(truth)], truth, names, time_step=1e-3)
    assert not told.identifiable
    (null,) = told.directions
    assert set(null.names) == set(names)
    np.testing.assert_allclose(null.change, 1.0, rtol=1e-3)
    assert "share one scale" in null.sentence
    assert "fix mass or gain" in null.cure
    assert "a known load at the tip" in null.cure
    with pytest.raises(FitError, match=r"share one scale.*fix mass or gain.*regularise=True"):
        fit([pulse(truth)], truth, names, time_step=1e-3)


def test_two_blind_directions_are_told_one_by_one(truth: Model, pulse: Any) -> None:
    told = identifiability([pulse(truth)], truth, ["gain", "torque_1", "stiffness", "damping", "mass"], time_step=1e-3)
    sentences = [d.sentence for d in told.directions if d.kind == "null"]
    assert len(sentences) == 2
    assert str(told).count("fix") == 2


def test_a_product_and_a_parameter_that_is_not_shown_are_named(truth: Model, pulse: Any, traced: Any) -> None:
    told = identifiability([pulse(truth)], truth, ["gain", "torque_1", "stiffness"], time_step=1e-3)
    assert "gain and torque_1 act as one product" in str(told)
    whole = traced(truth)
    keep = whole.time < 0.45
    rising = replace(whole, time=whole.time[keep], position=whole.position[keep])
    told = identifiability([rising], truth, ["stiffness", "valve_fall_time"], time_step=1e-3)
    assert "do not show valve_fall_time" in str(told)
    assert "record the fall of the pressure" in str(told)
    assert told.expected_std[1] is None


def test_what_shows_is_not_complained_of(truth: Model, pulse: Any) -> None:
    told = identifiability([pulse(truth)], truth, ["stiffness", "damping", "gain", "valve_rise_time"], time_step=1e-3)
    assert told.identifiable
    assert not told.directions
    assert np.isclose(told.information.sum(), len(told.names))


def test_a_torque_of_zero_at_the_start_is_no_blindness(truth: Model, pulse: Any) -> None:
    started = [Parameter("torque_1", 0.0), Parameter("damping", 0.0), "stiffness"]
    assert identifiability([pulse(truth)], truth, started, time_step=1e-3).identifiable


def test_a_weak_direction_says_how_weak(truth: Model, pulse: Any) -> None:
    exp = pulse(truth)
    blurred = replace(exp, noise={"mid": 0.02, "tip": 0.02})
    told = identifiability([blurred], truth, ["stiffness", "damping", "valve_rise_time"], time_step=1e-3)
    assert told.identifiable
    assert [d.kind for d in told.directions] == ["weak"]
    assert "% of its size at best" in str(told)


def test_expected_errors_are_those_of_a_fit_under_that_noise(truth: Model, pulse: Any) -> None:
    exp = pulse(truth)
    noise = 3e-4
    rng = np.random.default_rng(3)
    seen = replace(exp, position=exp.position + noise * rng.standard_normal(exp.position.shape),
                   noise={"mid": noise, "tip": noise})
    told = identifiability([seen], truth, ["stiffness", "damping"], time_step=1e-3)
    found = fit([seen], truth, ["stiffness", "damping"], time_step=1e-3, starts=1, weighting="noise")
    errors = {p.name: p.std for p in found.parameters if p.free}
    for name, expected in zip(told.names, told.expected_std, strict=True):
        assert errors[name] == pytest.approx(expected, rel=0.25)


SCALE = "are known as ratios"


def spread(names: list[str], values: list[float], scale: float, ratio: float) -> Covariance:
    """Covariance of parameters with a common relative error and independent ones."""
    count = len(names)
    matrix = (scale**2 * np.ones((count, count)) + ratio**2 * np.eye(count)) * np.outer(values, values)
    return Covariance(tuple(names), matrix, matrix, np.zeros(count, bool), 0.0, 100.0)


@pytest.mark.parametrize(("scale", "ratio", "gravity", "known"), [
    (0.3, 0.02, (0.0, 0.0), True), (0.3, 0.2, (0.0, 0.0), False), (0.02, 0.001, (0.0, 0.0), False),
    (0.3, 0.02, (0.0, -9.81), False),
])  # fmt: skip
def test_stiffness_and_gains_without_weight_are_known_as_ratios(
    truth: Model, pulse: Any, scale: float, ratio: float, gravity: tuple[float, float], known: bool,
) -> None:
    names, values = ["stiffness", "torque_1"], [0.9, 6e-7]
    problem = Problem([pulse(truth)], truth.with_(gravity=gravity),
                      [Parameter(n, v) for n, v in zip(names, values, strict=True)], 2e-3, "travel")  # fmt: skip
    said = combinations(problem, np.array(values) / problem.scale, spread(names, values, scale, ratio))
    assert any(SCALE in s for s in said) == known
    if known:
        assert "to 2.8 %; their common scale only to 30 %" in said[0]


def test_the_pull_of_a_thread_shows_the_common_scale(truth: Model, pulse: Any) -> None:
    names, values = ["stiffness", "torque_1"], [0.9, 6e-7]
    pull = PointForce(np.array([0.0, 1.0]), np.array([[0.0, 0.1], [0.0, 0.1]]), "tip")
    pulled = replace(pulse(truth), forces=(pull,))
    problem = Problem([pulled], truth, [Parameter(n, v) for n, v in zip(names, values, strict=True)], 2e-3, "travel")
    assert not combinations(problem, np.array(values) / problem.scale, spread(names, values, 0.3, 0.02))
