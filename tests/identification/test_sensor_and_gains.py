"""What is the sensor's and what is a joint's own: latency, and how much of the torque each joint feels."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pliant.errors import FitError, InputError
from pliant.identification import Parameter, fit, predict
from pliant.model import Model

LATENCY = 0.0137
HELD = Parameter("r.hold_force", 0.3, free=False)


def late(exp: Any, seconds: float = LATENCY) -> Any:
    """The experiment as a sensor stamps it that is so late."""
    return replace(exp, time=exp.time + seconds)


def test_the_latency_of_a_sensor_is_found(truth: Model, traced: Any) -> None:
    found = fit([late(traced(truth))], truth, ["stiffness", "torque_1", "latency"], time_step=2e-4, starts=1)
    assert found.values["latency"] == pytest.approx(LATENCY, abs=2e-5)
    assert found.values["stiffness"] == pytest.approx(0.9, rel=1e-3)


def test_a_shape_stamped_late_moves_as_one_on_time(truth: Model, traced: Any) -> None:
    exp = traced(truth)
    one, other = (predict(truth, e, v, 1e-3)["position"] for e, v in ((exp, {}), (late(exp, 0.25), {"latency": 0.25})))
    np.testing.assert_allclose(one, other, atol=1e-12)  # the stamps differ by rounding


def test_latency_is_known_of_one_record_or_shared(truth: Model, traced: Any) -> None:
    records = [traced(truth, "t"), late(traced(truth, "u"))]
    found = fit(records, truth, ["stiffness", "u.latency"], time_step=1e-3, starts=1)
    assert found.values["u.latency"] == pytest.approx(LATENCY, abs=1e-4)
    known = [records[0], replace(records[1], known={"latency": LATENCY})]
    found = fit(known, truth, ["stiffness"], time_step=1e-3, starts=1)
    assert max(found.rmse.values()) < 2e-5


def test_a_release_and_its_sensor_s_latency_are_one_unknown(truth: Model, released: Any) -> None:
    with pytest.raises(FitError, match=r"latency and r\.release|r\.release and latency"):
        fit([released(truth, force=0.3)], truth, [HELD, "stiffness", "latency"], time_step=2e-3, starts=1)


GAINS = np.array([1.3, 1.0, 0.7])


def test_gains_of_joints_are_found_and_their_mean_is_held(truth: Model, traced: Any) -> None:
    body = truth.with_(joint_gain=GAINS)
    free = ["joint_gain_*", "torque_1", "damping"]
    found = fit([traced(body)], truth, free, time_step=2e-4, starts=1)
    values = [found.values[f"joint_gain_{i}"] for i in (1, 2, 3)]
    assert np.mean(values) == pytest.approx(1.0, abs=1e-8)
    np.testing.assert_allclose(values, GAINS, rtol=2e-3)
    assert found.values["torque_1"] == pytest.approx(6e-7, rel=1e-3)
    np.testing.assert_array_equal(found.model.joint_gain, values)
    assert any("mean of the joints' gains is held" in note for note in found.notes)


def test_where_the_law_is_known_nothing_is_held(truth: Model, traced: Any) -> None:
    twice = truth.with_(joint_gain=2.0 * GAINS, torque=[3e-7])
    found = fit([traced(twice)], truth.with_(torque=[3e-7]), ["joint_gain_*"], time_step=2e-4, starts=1)
    np.testing.assert_allclose(found.model.joint_gain, 2.0 * GAINS, rtol=2e-3)
    assert not any("is held" in note for note in found.notes)


def test_the_law_s_factor_and_the_gains_of_joints_are_refused_together(truth: Model, traced: Any) -> None:
    with pytest.raises(InputError, match="leave one of them out"):
        fit([traced(truth)], truth, ["gain", "joint_gain_2"])
    with pytest.raises(InputError, match="joints 1 to 3"):
        fit([traced(truth)], truth, ["joint_gain_4"])


def test_the_angles_of_joints_alone_find_the_body(truth: Model, traced: Any) -> None:
    """Angles from the station before, one on each link; positions that are nonsense change nothing."""
    ends = truth.with_(stations=(), base_angle=0.07)
    exp = traced(ends)
    absolute = predict(ends, replace(exp, angle=exp.position[..., 0], angle_reference="base"), {}, 1e-4)["angle"]
    joints = np.diff(absolute, axis=1, prepend=0.0)
    seen = replace(
        exp, position=1e-2 * np.cumsum(np.ones_like(exp.position), axis=0), angle=joints, angle_reference="joint",
        angles_alone=True,
    )
    start = ends.with_(rest_angle=[0.12, 0.1, 0.1], stiffness=1.1)
    found = fit([seen], start, ["rest_angle_*", "stiffness", "damping", "torque_1"], time_step=1e-4, starts=1)
    np.testing.assert_allclose(found.model.rest_angle, ends.rest_angle, atol=1e-5)
    assert found.values["stiffness"] == pytest.approx(0.9, rel=1e-3)
    with pytest.raises(InputError, match="compares angles alone, but has none"):
        replace(exp, angles_alone=True)
