"""A recording whose log begins late starts where the body was left, and creep carries that on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.identification import Experiment
from pliant.identification.prediction import predict
from pliant.identification.sensitivity import sensitivities
from pliant.identification.starts import AtPose, AtRest, start_note
from pliant.model import Memory, Model, Station, chain_model
from pliant.simulation import Trace

TIME = np.arange(0.0, 4.0, 0.02)
HELD = 3e4  # Pa, for long before the recording
PUSH = np.interp(TIME, [1.0, 1.3], [HELD, 5e3])
LOGGED = np.where(TIME < 0.1, 0.0, PUSH)  # a log whose first rows are empty


def body(space: bool) -> Model:
    model = chain_model(length=0.3, mass=0.1, damping=0.01, stiffness=0.1, links=2, torque=[1e-6], space=space)
    return model.with_(stations=(Station("tip", 1, float(model.link_length[1])),),
                       memory=Memory(creep_share=(0.5,), creep_time=(20.0,)))  # fmt: skip


def recorded(model: Model) -> tuple[Experiment, np.ndarray]:
    """A recording of a body that crept under a pressure before its log began, and its positions without noise."""
    blank = np.random.default_rng(0).normal(size=(TIME.size, 1, 3 if model.space else 2))
    whole = Experiment("late", TIME, blank, ("tip",), "trace", Trace(TIME, PUSH))
    true = predict(model, whole, {}, 2e-3)["position"]
    noisy = true + 2e-5 * np.random.default_rng(1).normal(size=true.shape)
    return Experiment("late", TIME, noisy, ("tip",), "trace", Trace(TIME, LOGGED), warm_up=0.9), true


@pytest.mark.parametrize("space", [False, True])
def test_creep_from_before_the_recording_is_predicted_from_its_first_pose(space: bool) -> None:
    model = body(space)
    exp, true = recorded(model)
    errors = {}
    for start in (AtRest(), AtPose()):
        off = np.linalg.norm(predict(model, replace(exp, start=start), {}, 2e-3)["position"] - true, axis=2)
        errors[start.from_rest] = float(np.sqrt(np.mean(off[exp.warm_up < TIME] ** 2)))
    assert errors[False] < 0.1 * errors[True]


def test_derivatives_include_those_of_the_pose() -> None:
    exp, _ = recorded(body(False))
    exp, values = replace(exp, start=AtPose()), {"stiffness": 0.1, "torque_1": 1e-6, "creep_share_1": 0.5}
    slopes = sensitivities(body(False), exp, values, values, 2e-3)[1]
    for (name, value), slope in zip(values.items(), slopes, strict=True):
        step = 1e-4 * value
        ends = [sensitivities(body(False), exp, values | {name: value + side * step}, {}, 2e-3)[0] for side in (1, -1)]
        by_differences = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(slope, by_differences, atol=1e-4 * float(np.abs(by_differences).max()))


def test_a_pose_of_late_frames_is_refused_and_compared_frames_are_named() -> None:
    exp, _ = recorded(body(False))
    assert "count in its error too" in start_note(replace(exp, start=AtPose(), warm_up=0.0))
    late = exp.position.copy()
    late[TIME < 2.5] = np.nan
    with pytest.raises(InputError, match=r"first seen 2\.5 s after the start, too late"):
        replace(exp, start=AtPose(), position=late)


def test_the_pose_of_a_start_is_that_of_its_first_frames() -> None:
    exp, _ = recorded(body(False))
    text = start_note(replace(exp, start=AtPose()))
    assert text.startswith("its simulation starts where the body was left")
    assert "a warm-up" in text


def test_the_first_pose_needs_no_different_frames() -> None:
    exp, true = recorded(body(False))
    still = true.copy()
    still[TIME < 1.0] = true[0]
    (place,) = AtPose().shown(replace(exp, position=still)).position
    np.testing.assert_allclose(place, true[0, 0], atol=1e-12)
