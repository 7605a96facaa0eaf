"""The linearised model: zeros and poles against numbers of another derivation, and against the stepped model."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.linear import linearise
from pliant.linear.linearisation import frequency_and_damping
from pliant.linear.sampled import hold, sample
from pliant.model import Chamber, Memory, Valve, chain_model
from pliant.simulation import Stepper, equilibrium, modes


@pytest.fixture
def arm():
    """The paper's actuator, its mass at the link tips."""
    return chain_model(length=0.17, mass=0.069, mass_at="tip", stiffness=1.6067, damping=8e-3, torque=[6.6667e-7])


@pytest.mark.parametrize(("output", "hertz", "damping"), [("angle_sum", 9.28, 0.146), ("tip_x", 16.9, 0.264)])
def test_slowest_zeros(arm, output, hertz, damping):
    found = frequency_and_damping(linearise(arm).zeros(output)[0])
    assert found == pytest.approx((hertz, damping), rel=0.01)


def test_the_first_joint_answers_in_the_wrong_sense(arm):
    right = [z for z in linearise(arm).zeros("q_1") if z.real > 0]
    assert min(abs(z) for z in right) / (2 * np.pi) == pytest.approx(9.79, rel=1e-3)
    assert max(abs(z) for z in right) / (2 * np.pi) == pytest.approx(337.0, rel=1e-2)


def test_poles_are_the_modes(arm):
    frequency, damping = modes(arm)
    assert frequency_and_damping(linearise(arm).poles()[0]) == pytest.approx((frequency[0], damping[0]), rel=1e-9)
    sticking = arm.with_(memory=Memory(creep_share=(0.1,), creep_time=(1.0,), slip_share=(0.2,), slip_angle=(0.1,)))
    frequency, damping = modes(sticking)
    assert frequency_and_damping(linearise(sticking).poles()[0]) == pytest.approx((frequency[0], damping[0]), rel=1e-9)


def test_static_gain_is_the_slope_of_the_rests(arm):
    arm = arm.with_(torque=[6.67e-7, 1e-12], gravity=[0.5, 2.0], valve=Valve(rise_time=0.03, fall_time=0.03))
    linear = linearise(arm, 8e4)
    slope = (equilibrium(arm, 8.05e4) - equilibrium(arm, 7.95e4)).sum() / 1e3
    assert linear.static_gain("angle_sum") == pytest.approx(slope, rel=1e-5)
    assert linear.states[-1] == "pressure"


def test_a_second_order_valve_has_two_states(arm):
    linear = linearise(arm.with_(valve=Valve(natural_frequency=9.0, damping_ratio=0.75, dead_time=0.008)))
    assert linear.states[-2:] == ("pressure", "pressure_rate")
    lags = [frequency_and_damping(p) for p in linear.poles()]
    assert any(np.allclose(lag, (9.0, 0.75)) for lag in lags)
    assert linear.dead_time == 0.008


def segments(arm):
    """The arm with a chamber for each half, one behind a slow valve."""
    valve = Valve(rise_time=0.03, fall_time=0.03)
    first = Chamber([6.67e-7, 1e-12], joint_gain=[1, 1, 1, 0, 0], valve=valve, name="low")
    return arm.with_(chambers=(first, Chamber([-5e-7], joint_gain=[0, 0, 0, 1, 0.8], name="high")), gravity=[0.5, 2.0])


def test_every_chamber_has_its_column(arm):
    """Static gains against differences of rests; a step of one pressure alone against the stepped model."""
    body, at = segments(arm), np.array([8e4, 3e4])
    linear = linearise(body, at)
    assert linear.B.shape == (11, 2)
    assert linear.D.shape == (8, 2)
    assert linear.states[-1] == "pressure_low"
    for c, up in enumerate(50.0 * np.eye(2)):
        slope = (equilibrium(body, at + up) - equilibrium(body, at - up)) / 100.0
        found = [linear.static_gain(f"q_{i + 1}", c) for i in range(5)]
        np.testing.assert_allclose(found, slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max())
    h, stepper = 1e-4, Stepper(body, 1e-4, at)
    start = stepper.angle.copy()
    move, fresh = hold(linear.A, linear.B[:, 1], h)
    x = np.zeros(11)
    for _ in range(1500):
        x = move @ x + fresh * 100.0
        stepper.step(at + np.array([0.0, 100.0]))
    np.testing.assert_allclose(stepper.angle - start, x[:5], atol=2e-4 * np.abs(x[:5]).max())
    with pytest.raises(InputError, match="linear model of one pressure, and it has 2"):
        sample(linear, 4e-3)


@pytest.mark.parametrize("dead", [0.0, 0.004, 0.006, 0.0091])
def test_sampling_with_dead_time(arm, dead):
    """A small step of the stepped model, against powers of the sampled matrices."""
    period, h = 4e-3, 1e-4
    arm = arm.with_(valve=Valve(rise_time=0.02, fall_time=0.02))
    stepper = Stepper(arm, h)
    late = round(dead / h)
    start = stepper.angle.copy()
    plant = sample(linearise(arm), period, dead)
    x = np.zeros(plant.A.shape[0])
    for k in range(1, 26):
        x = plant.A @ x + plant.B * 100.0
        for j in range(40):
            stepper.step(100.0 if (k - 1) * 40 + j >= late else 0.0)
        assert x[:5] == pytest.approx(stepper.angle - start, rel=2e-3, abs=2e-8)


def test_refusals(arm):
    with pytest.raises(InputError, match="unknown output"):
        linearise(arm).zeros("tip_z")
    with pytest.raises(InputError, match="period"):
        sample(linearise(arm), 0.0)
    with pytest.raises(InputError, match="finite"):
        linearise(arm, np.nan)
