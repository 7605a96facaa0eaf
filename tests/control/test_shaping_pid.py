"""Shaped set-points against known residuals and the model itself; PI-D at its limits; the feedforward's inverse."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.control import (
    Feedforward,
    Limits,
    Pid,
    PidTuning,
    SupplyValve,
    ValveRun,
    equilibria,
    identify_valve,
    valve_response,
)
from pliant.control.design import check_reference
from pliant.control.pid import impulses
from pliant.control.plan import SetPoint
from pliant.errors import InputError
from pliant.linear import linearise
from pliant.mechanics import mechanics_of
from pliant.model import Memory, chain_model
from pliant.simulation import Trace, modes, simulate


@pytest.fixture
def arm():
    return chain_model(length=0.17, mass=0.069, mass_at="tip", stiffness=1.6067, damping=8e-3, torque=[6.6667e-7])


def residual(frequency, damping):
    """Vibration of a mode of 5 Hz and damping 0.078, as a fraction of that without shaping, by Singer and Seering."""
    omega = 2 * np.pi * frequency
    pole = (damping + 1j * np.sqrt(1 - damping**2)) * omega
    shaped = impulses(5.0, 0.078)
    return np.exp(-damping * omega * shaped[-1][1]) * abs(sum(a * np.exp(pole * t) for a, t in shaped))


def test_residual_at_ten_per_cent():
    assert residual(5.0, 0.078) < 1e-12
    assert residual(5.5, 0.078) == pytest.approx(0.02, abs=0.005)
    assert impulses(5.0, 0.078)[-1][1] == pytest.approx(0.2, rel=0.01)
    assert sum(a for a, _ in impulses(5.0, 0.078)) == pytest.approx(1.0, abs=1e-15)


def test_the_shaped_step_does_not_ring(arm):
    frequency, damping = modes(arm)
    shaped, ringing = impulses(frequency[0], damping[0]), []
    for parts in ([(1.0, 0.0)], shaped):
        levels = 5e4 * np.cumsum([a for a, _ in parts])
        times = 0.1 + np.array([t for _, t in parts])
        run = simulate(arm, Trace(np.repeat(times, 2), np.append(0.0, np.repeat(levels, 2)[:-1])), duration=1.2)
        tip = run.tip_position.values[:, -1, 0]
        ringing.append(np.ptp(tip[run.time.values > 0.1 + shaped[-1][1] + 0.1]))
    assert ringing[1] < 0.08 * ringing[0]


def test_an_overdamped_mode_is_not_shaped():
    with pytest.raises(InputError, match="set planned = false"):
        impulses(5.0, 1.2)


def test_feedforward_inverts_creep_and_slip(arm):
    """Held at 20 mm by the feedforward for 3 s, the tip stays there; without the inverse it would creep away."""
    memory = Memory(creep_share=(0.08, 0.1), creep_time=(0.1, 1.0), slip_share=(0.1,), slip_angle=(0.02,))
    arm = arm.with_(memory=memory)
    forward = Feedforward(arm, 2.5e5)
    period = 0.01
    time = np.arange(0.0, 4.0, period)
    wanted = 0.02 * np.clip(time / 0.8, 0, 1)
    pressure = np.array([forward.pressure(d, period) for d in wanted])
    naive = np.array([forward.equilibria.pressure_for(d) for d in wanted])
    held = time > 1.2
    errors = []
    for command in (pressure, naive):
        run = simulate(arm, Trace(time + period, command), times=time)
        tip = np.linalg.norm(run.tip_position.values[:, -1] - run.tip_position.values[0, -1], axis=1)
        errors.append(np.abs(tip - wanted)[held].max())
    assert errors[0] < 4e-4
    assert errors[1] > 1.5e-3


def test_equilibria_say_what_is_out_of_reach(arm):
    family = equilibria(arm, 1.19e5)
    assert family.pressure_for(0.0) == 0.0
    assert family.reach == pytest.approx(0.02513, rel=1e-3)
    with pytest.raises(InputError, match="out of reach"):
        family.pressure_for(0.04)


def test_pid_starts_without_a_bump_and_does_not_wind_up():
    limits = Limits(1e5, slew=5e6)
    pid = Pid(PidTuning(1e6, 4e6, 1e4), limits, 4e-3)
    pid.start(3e4, target=0.01, measured=0.008)
    first = pid.step(0.01, 0.008)
    assert first == pytest.approx(3e4, abs=1e2)
    for _ in range(500):
        command = pid.step(1.0, 0.008)  # far out of reach
    assert command == 1e5
    assert pid.integral < 2e5
    assert pid.step(0.0, 0.008) < 1e5  # leaves the limit at once
    assert pid.saturated > 400


def test_limits():
    limits = Limits(1e5, slew=1e6)
    assert limits(5e4, 0.0, 0.01) == pytest.approx(1e4)
    assert limits(-1.0, 5e3, 0.01) == 0.0
    assert limits(2e5, 9.9e4, 0.01) == 1e5
    with pytest.raises(InputError, match="positive"):
        Limits(0.0)


def test_pid_on_the_linear_model_settles(arm):
    """Feedforward and PI-D bring the model's tip to 20 mm."""
    from pliant.simulation import Stepper

    period = 4e-3
    gain = abs(linearise(arm).static_gain("tip_x"))
    pid = Pid(PidTuning(0.15 / gain, 3.0 / gain, 0.01 / gain), Limits(2e5), period)
    family = equilibria(arm, 2e5)
    stepper = Stepper(arm, period / 4)
    start = mechanics_of(arm).tips(stepper.angle)[-1]
    command = 0.0
    for _ in range(500):
        for _ in range(4):
            stepper.step(command)
        tip = float(np.linalg.norm(mechanics_of(arm).tips(stepper.angle)[-1] - start))
        command = pid.step(0.02, tip, family.pressure_for(0.02))
    assert tip == pytest.approx(0.02, abs=2e-5)


def test_a_valve_is_found_from_its_gauge():
    """Both frequencies, damping and dead time from noisy steps up and down, whatever the gauge's offset."""
    true = SupplyValve(9.0, 6.4, 0.75, 0.008)
    time, edges, levels = np.arange(0.0, 1.2, 1 / 750), np.array([0.1, 0.5, 0.9]), np.array([6e4, 1e4, 3e4])
    noise = np.random.default_rng(4).standard_normal(time.size)
    gauge = valve_response(true, edges, levels, time) + 100 + 300 * noise
    found = identify_valve([ValveRun(edges, levels, time, gauge)])
    assert found.rmse == pytest.approx(300, rel=0.1)
    for name, value in vars(true).items():
        assert abs(getattr(found.valve, name) - value) < max(5 * found.standard_error[name], 1e-3 * value)
    with pytest.raises(InputError, match="as many edges"):
        identify_valve([ValveRun(edges, levels[:2], time, time)])
    with pytest.raises(InputError, match="pressure of a run for a valve must be finite"):
        identify_valve([ValveRun(edges, levels, time, np.full(time.size, np.nan))])
    with pytest.raises(InputError, match="at least one level of a run for a valve must be > 0 Pa"):
        identify_valve([ValveRun(edges, 0.0 * levels, time, time)])
    with pytest.raises(InputError, match="edge_time of a run for a valve must increase"):
        identify_valve([ValveRun(edges[::-1], levels, time, time)])
    with pytest.raises(InputError, match="at least one run"):
        identify_valve([])


@pytest.mark.parametrize(("time", "far", "ramp", "said"), [
    ([0.0, 1.0], [0.01], 0.0, r"got displacements of shape \(1,\) and times of shape \(2,\)"),
    ([1.0, 1.0], [0.01, 0.02], 0.0, "the times of a set-point must increase"),
    ([0.0], [np.nan], 0.0, "the displacements of a set-point must be finite"),
    ([np.nan], [0.01], 0.0, "the times of a set-point must increase"),
    ([0.0], [0.01], np.nan, "the ramp of a set-point must be >= 0 s, got nan"),
    ([0.0], [0.01], -1.0, "the ramp of a set-point must be >= 0 s, got -1"),
])
def test_what_is_no_set_point_is_refused(time, far, ramp, said):
    with pytest.raises(InputError, match=said):
        SetPoint(np.array(time), np.array(far), ramp)


def test_what_is_no_reference_is_refused():
    with pytest.raises(InputError, match=r"must have the shape \(K, 2\), .* got shape \(3, 1\)"):
        check_reference(np.zeros((3, 1)), 2)
    with pytest.raises(InputError, match="the reference must be finite, but 1 of its 2 numbers are not"):
        check_reference(np.array([[0.0, np.inf]]), 2)
