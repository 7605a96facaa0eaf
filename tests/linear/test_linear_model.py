"""The linearised model: poles against numbers of another derivation, and against the stepped model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.equations import extension
from pliant.errors import InputError
from pliant.linear import linearise
from pliant.linear.sampled import hold, sample
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, Memory, Valve, chain_model
from pliant.simulation import Stepper, equilibrium, modes


def frequency_and_damping(root: complex) -> tuple[float, float]:
    """Return the frequency [Hz] and damping ratio of a pole or zero [1/s]."""
    return abs(root) / (2 * np.pi), -root.real / abs(root)


@pytest.fixture
def arm():
    """The paper's actuator, its mass at the link tips."""
    return chain_model(length=0.17, mass=0.069, mass_at="tip", stiffness=1.6067, damping=8e-3, torque=[6.6667e-7])


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


def test_two_pressures_are_sampled_behind_their_dead_times(arm):
    """Commands held over 4 ms, one late by 1.5 and one by half a period, against steps of 0.1 ms that wait for them."""
    body, period, fine = segments(arm), 4e-3, 40
    low, high = body.chambers
    body = body.with_(chambers=(replace(low, valve=replace(low.valve, dead_time=6e-3)),
                                replace(high, valve=Valve(dead_time=2e-3))))  # fmt: skip
    linear = linearise(body, np.array([8e4, 3e4]))
    plant, commands = sample(linear, period), np.random.default_rng(2).normal(0.0, 1e3, (50, 2))
    assert (plant.waiting, plant.B.shape) == ((2, 1), (14, 2))
    move, drive = hold(linear.A, linear.B, period / fine)
    x, z, late = np.zeros(14), np.zeros(11), np.array([60, 20])
    for k, command in enumerate(commands):
        x = plant.A @ x + plant.B @ command
        for j in range(k * fine, (k + 1) * fine):
            at = (j - late) // fine
            z = move @ z + drive @ np.where(at < 0, 0.0, commands[at, [0, 1]])
        np.testing.assert_allclose(x[:11], z, rtol=1e-8, atol=1e-9 * np.abs(z).max())


LEVELS = np.array([3e4, 1e4, 2e4])  # Pa


@pytest.fixture
def lengthening():
    """Two segments that lengthen, three chambers, one behind a lagging valve, bent at rest by slanted gravity."""
    left = Chamber.at_offset(2e-4, 0.02, [1, 1, 0, 0], name="left", valve=Valve(rise_time=0.02, fall_time=0.02))
    right, far = (
        Chamber.at_offset(2e-4, r, j, name=name)
        for r, j, name in ((-0.02, [1, 1, 0, 0], "right"), (0.02, [0, 0, 1, 1], "far"))
    )
    return chain_model(
        length=0.2, mass=0.3, links=4, joint_placement="midsegment", stiffness=1.0, damping=0.01,
        chambers=(left, right, far), gravity=[3.0, -9.0], rest_angle=0.05, base_angle=0.2,
        extensions=(Extension(150.0, 0.5, 0.0, 0.1, "near"), Extension(120.0, 0.3, 0.1, None, "far")),
    )


def test_a_body_that_lengthens_is_the_step_about_its_rest(lengthening):
    """The step's Jacobian at rest, by complex steps, is the midpoint rule of A: (1 - hA/2)^-1 (1 + hA/2)."""
    linear, N, h = linearise(lengthening, LEVELS), 6, 1e-3
    assert linear.states[3:7] == ("phi_4", "strain_near", "strain_far", "w_1")
    assert linear.states[-2:] == ("strain_rate_far", "pressure_left")
    start = np.concatenate([linear.angle, linear.strain, np.zeros(N)])
    work = mechanics_of(lengthening).workspace(complex)
    J = np.empty((2 * N, 2 * N))
    for k in range(2 * N):
        x = start.astype(complex)
        x[k] += 1e-20j
        drive = lengthening.actuation.joint_torques(LEVELS)
        extension.step(x[:N], x[N:], h, drive, mechanics_of(lengthening).body, mechanics_of(lengthening).joints, work)
        J[:, k] = x.imag / 1e-20
        np.testing.assert_allclose(x.real, start, atol=1e-12)
    half = 0.5 * h * linear.A[: 2 * N, : 2 * N]
    np.testing.assert_allclose(J, np.linalg.solve(np.eye(2 * N) - half, np.eye(2 * N) + half), atol=1e-11)


@pytest.mark.parametrize("memory", [Memory(), Memory(creep_share=(0.2,), creep_time=(0.3,))], ids=["none", "creep"])
def test_poles_of_a_body_that_lengthens_are_its_modes(lengthening, memory):
    free = lengthening.with_(
        damping=0.0, memory=memory,
        extensions=(Extension(150.0, 0.0, 0.0, 0.1, "near"), Extension(120.0, 0.0, 0.1, None, "far")),
    )
    own = np.linalg.eigvals(linearise(free, LEVELS).A[:12, :12])
    hertz = modes(free, equilibrium(free, LEVELS))[0]
    np.testing.assert_allclose(np.sort(own.imag)[6:] / (2 * np.pi), hertz, rtol=1e-9)
    assert np.abs(own.real).max() < 1e-8 * np.abs(own).max()


def test_static_gains_of_a_body_that_lengthens(lengthening):
    """Every output, the tip and the strains among them, against differences of rests."""
    linear = linearise(lengthening, LEVELS)
    assert linear.B.shape == (13, 3)
    assert linear.outputs[-2:] == ("strain_near", "strain_far")
    for c, up in enumerate(50.0 * np.eye(3)):
        q = [equilibrium(lengthening, LEVELS + side * up) for side in (1, -1)]
        tip = [mechanics_of(lengthening).tips(mechanics_of(lengthening).coordinates(at))[-1] for at in q]
        slope = np.concatenate([tip[0] - tip[1], [(q[0] - q[1])[:4].sum()], q[0] - q[1]]) / 100.0
        found = [linear.static_gain(name, c) for name in linear.outputs]
        np.testing.assert_allclose(found, slope, atol=1e-7 * np.abs(slope).max())


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
        x = plant.A @ x + plant.B @ [100.0]
        for j in range(40):
            stepper.step(100.0 if (k - 1) * 40 + j >= late else 0.0)
        assert x[:5] == pytest.approx(stepper.angle - start, rel=2e-3, abs=2e-8)


def test_refusals(arm):
    with pytest.raises(InputError, match="unknown output"):
        linearise(arm).row("tip_z")
    with pytest.raises(InputError, match="period"):
        sample(linearise(arm), 0.0)
    with pytest.raises(InputError, match="finite"):
        linearise(arm, np.nan)
