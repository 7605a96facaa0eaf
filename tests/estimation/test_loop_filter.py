"""The filter of a control loop: a wrong torque becomes a factor, what is left a shift; other bodies take it plain."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pliant.estimation import KalmanFilter, Setting
from pliant.estimation.link_angles import joint_rows
from pliant.estimation.loop_filter import FACTOR_SD, LoopFilter, make
from pliant.model import Extension, chain_model
from pliant.simulation import Trace, simulate

PERIOD = 4e-3
CLOCK = PERIOD * np.arange(150)
PRESSURE = 8e4 * np.clip(CLOCK / 0.2, 0, 1)
BODY = chain_model(length=0.15, mass=0.06, links=3, stiffness=1.2, damping=6e-3, torque=[1.2e-6])


def followed(estimator, body):
    """State after the motion of a body, whose exact angles between links are the frames."""
    run = simulate(body, Trace(CLOCK, PRESSURE), times=CLOCK, time_step=1e-3)
    for time, pressure, angle in zip(CLOCK, PRESSURE, run.joint_angle.values, strict=True):
        estimator.push_pressure(time, pressure)
        estimator.push_frame(time, joint_rows(BODY), angle, np.full(3, 4e-6))
        state = estimator.state(time)
    return state


@pytest.mark.parametrize("factor", [0.85, 1.0, 1.15])
def test_a_stronger_body_is_a_factor_on_the_torque(factor):
    state = followed(make(Setting(BODY, PERIOD, 0)), BODY.with_(torque=factor * BODY.torque))
    assert state.torque_scale == pytest.approx(factor, abs=0.01)
    assert np.abs(state.rest_shift).max() < 2e-3  # rad
    assert np.abs(state.disturbance).max() < 2e-3 * 1.2


def test_factor_and_rest_together_are_the_disturbance_of_the_filter():
    """The same noise in a plain filter: its disturbance is the factor's part and the remainder."""
    loop = LoopFilter(Setting(BODY, PERIOD, 0))
    plain = KalmanFilter(BODY, loop.noise, time=-math.inf)
    strong = BODY.with_(torque=1.1 * BODY.torque)
    one, other = followed(loop, strong), followed(plain, strong)
    np.testing.assert_allclose(one.angle, other.angle, rtol=1e-12)
    push = BODY.torque_at(float(PRESSURE[-1])) * BODY.joint_gain
    np.testing.assert_allclose(one.disturbance + (one.torque_scale - 1.0) * push, other.disturbance, atol=1e-12)


def test_without_pressure_nothing_is_learnt_and_a_state_asked_twice_is_the_same():
    loop = make(Setting(BODY, PERIOD, 0))
    for k in range(20):
        loop.push_pressure(k * PERIOD, 0.0)
        loop.push_frame(k * PERIOD, joint_rows(BODY), np.full(3, 0.02), np.full(3, 4e-6))
        assert loop.state(k * PERIOD).torque_scale == 1.0
    assert loop._variance == pytest.approx(FACTOR_SD**2)
    loop.push_pressure(0.1, 5e4)
    first, again = loop.state(0.14), loop.state(0.14)
    for before, now in zip(first, again, strict=True):
        np.testing.assert_array_equal(before, now)


def test_bodies_that_lengthen_take_the_plain_filter():
    longer = chain_model(length=0.2, mass=0.1, links=2, stiffness=1.0, damping=0.01, torque=(1e-6,), axial_gain=50.0,
                         extensions=(Extension(150.0),))  # fmt: skip
    assert type(make(Setting(longer, PERIOD, 0))) is KalmanFilter
