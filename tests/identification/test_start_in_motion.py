"""A recording that begins in mid-motion starts from the pose and the rates of its first frames."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.identification import Experiment, fit
from pliant.identification.prediction import predict
from pliant.identification.sensitivity import sensitivities
from pliant.identification.starts import AtRest, Moving, begins_in_motion, first_motion, start_note
from pliant.identification.torque_start import grown
from pliant.model import Extension, Model, Station, chain_model
from pliant.simulation import Trace

BODIES = [(False, False), (False, True), (True, False), (True, True)]
STATIONS = ("mid", "tip")
NOISE = 2e-5  # m
TIME = np.arange(0.0, 2.5, 0.01)
PUSH = Trace(TIME, 3e4 * (1 + np.sin(4.4 * TIME)) * np.minimum(TIME / 0.3, 1.0))


def body(space: bool, lengthens: bool) -> Model:
    model = chain_model(length=0.3, mass=0.1, damping=4e-3, stiffness=0.1, links=3, torque=[1e-6], space=space)
    ends = [float(length) for length in model.link_length]
    return model.with_(extensions=(Extension(50.0, 1.0),) if lengthens else (),
                       stations=(Station("mid", 1, ends[1]), Station("tip", 2, ends[2])))  # fmt: skip


def recorded(model: Model, first: int, noise: float = NOISE) -> tuple[Experiment, np.ndarray]:
    """A recording of a motion from frame `first` on, and its true positions."""
    blank = np.random.default_rng(0).normal(size=(TIME.size, 2, 3 if model.space else 2))
    whole = Experiment("late", TIME, blank, STATIONS, "trace", PUSH)
    true = predict(model, whole, {}, 1e-3)["position"][first:]
    noisy = true + noise * np.random.default_rng(1).normal(size=true.shape)
    return Experiment("late", TIME[first:], noisy, STATIONS, "trace", PUSH), true


@pytest.mark.parametrize(("space", "lengthens"), BODIES)
def test_a_motion_is_predicted_from_the_state_of_its_first_frames(space: bool, lengthens: bool) -> None:
    model = body(space, lengthens)
    exp, true = recorded(model, 110)
    assert begins_in_motion(exp)
    errors = {}
    for start in (AtRest(), Moving()):
        off = np.linalg.norm(predict(model, replace(exp, start=start), {}, 1e-3)["position"] - true, axis=2)
        errors[start.from_rest] = float(np.sqrt(np.mean(off**2)))
    assert errors[False] < 0.05 * errors[True]


@pytest.mark.parametrize(("space", "lengthens"), BODIES)
def test_derivatives_include_those_of_the_start(space: bool, lengthens: bool) -> None:
    model = body(space, lengthens)
    exp = replace(recorded(model, 110)[0], start=Moving())
    values = {"stiffness": 0.1, "damping": 4e-3} | ({} if space else {"torque_1": 1e-6})
    slopes = sensitivities(model, exp, values, values, 1e-3)[1]
    for (name, value), slope in zip(values.items(), slopes, strict=True):
        step = 1e-4 * value
        ends = [sensitivities(model, exp, values | {name: value + side * step}, {}, 1e-3)[0] for side in (1, -1)]
        by_differences = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(slope, by_differences, atol=1e-5 * float(np.abs(by_differences).max()))


def test_a_fit_finds_the_parameters_of_a_recording_that_begins_in_motion() -> None:
    model = body(False, False)
    exp = recorded(model, 110)[0]
    wrong = {}
    for start in (AtRest(), Moving()):
        result = fit([replace(exp, start=start)], model, ["damping", "torque_1"], starts=1, time_step=2e-3, rng=0)
        wrong[start.from_rest] = abs(result.values["damping"] / 4e-3 - 1.0)
    assert wrong[False] < 0.03 < wrong[True]


def test_a_recording_that_begins_at_rest_is_not_taken_for_a_motion() -> None:
    model = body(False, False)
    exp = recorded(model, 0)[0]
    still = replace(exp, position=np.concatenate([np.repeat(exp.position[:1], 40, axis=0), exp.position[:-40]]))
    rng = np.random.default_rng(2)
    noises = NOISE * rng.normal(size=(50, *still.position.shape))
    assert not any(begins_in_motion(replace(still, position=still.position + noise)) for noise in (0.0, *noises))
    assert start_note(still) == ""
    begun = replace(exp, position=np.roll(still.position, -37, axis=0)[:-40], time=exp.time[:-40])  # 3 frames at rest
    assert not begins_in_motion(begun)


def test_repeated_frames_of_a_slow_tracker_and_gaps_do_not_change_the_first_motion() -> None:
    exp = recorded(body(False, False), 110, noise=0.0)[0]
    position = np.repeat(exp.position[::2], 2, axis=0)
    position[:2] = np.nan
    slow = replace(exp, position=position)
    assert begins_in_motion(slow)
    speed = first_motion(exp).velocity
    np.testing.assert_allclose(first_motion(slow).velocity, speed, atol=0.2 * float(np.abs(speed).max()))


def test_a_start_in_motion_needs_positions_under_measured_inputs() -> None:
    exp = recorded(body(False, False), 110)[0]
    with pytest.raises(InputError, match="own_places"):
        replace(exp, start=Moving(), own_places=True)
    with pytest.raises(InputError, match="different positions"):
        replace(exp, start=Moving(), position=np.repeat(exp.position[:5], 28, axis=0))


def test_a_warm_up_is_simulated_but_has_no_weight() -> None:
    model = body(True, False)
    exp, true = recorded(model, 0, noise=0.0)
    spoiled = exp.position + 0.05 * (exp.time < 0.5)[:, None, None]
    late = replace(exp, position=spoiled, warm_up=0.5)
    assert np.isnan(late.compared).all(axis=(1, 2)).sum() == 50
    result = fit([late], model, ["damping"], starts=1, time_step=1e-3, rng=0)
    assert result.values["damping"] == pytest.approx(4e-3, rel=1e-4)
    assert result.rmse["late"] < 1e-6
    assert grown(late) == grown(replace(exp, position=spoiled)), "from all frames"
    assert start_note(late).startswith("the first 0.5 s, 50 of 250 frames")
    np.testing.assert_array_equal(predict(model, late, {}, 1e-3)["position"], true)


@pytest.mark.parametrize(("changes", "message"), [
    ({"warm_up": 10.0}, "shorter than the recording"),
    ({"warm_up": -1.0}, "not negative"),
    ({"warm_up": 0.5, "excitation": "step", "pressure": None, "level": 1e4}, "measured inputs"),
])  # fmt: skip
def test_a_warm_up_is_part_of_a_motion_under_measured_inputs(changes: dict[str, Any], message: str) -> None:
    exp = recorded(body(False, False), 0)[0]
    with pytest.raises(InputError, match=message):
        replace(exp, **changes)
