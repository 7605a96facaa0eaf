"""Batches at their edges: whose pressures are kept, chambers with slow states."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.actuators import chen2018
from pliant.batch import simd as schedule
from pliant.batch.batch import initial_state
from pliant.batch.one_by_one import expanded, sets_of
from pliant.batch.samples import gather
from pliant.batch.simd import Schedule
from pliant.batch.stepper import batch_stepper
from pliant.compiler import WIDTH
from pliant.compiler.simd import aligned
from pliant.errors import InputError
from pliant.model import Chamber, Memory, Valve
from pliant.simulation import Pulse, Stepper, equilibrium

TIMES = np.arange(9) / 100


def test_pressures_behind_valves_are_worked_out_once_where_samples_share_them(paper, monkeypatch):
    """Of one input for all; those of own inputs would fill the memory and are not kept."""
    calls, through = [], schedule.through_valve
    monkeypatch.setattr(schedule, "through_valve", lambda *given: calls.append(1) or through(*given))
    samples = gather([paper, paper.with_(valve=Valve(rise_time=0.02)), paper], None, 1)
    members = [0, 1, 2] + [2] * (WIDTH - 3)
    plan = Schedule(samples, (Pulse(1e4, 0.02),), TIMES, 2e-3)
    assert not plan.alike
    for _ in range(2):
        plan.group(members)
    assert len(calls) == 2  # valves
    calls.clear()
    own = Schedule(samples, tuple(Pulse(1e4, 0.02) for _ in range(3)), TIMES, 2e-3)
    for _ in range(2):
        own.group(members)
    assert len(calls) == 2 * WIDTH
    calls.clear()
    alike = Schedule(gather([paper] * 3, None, 1), (Pulse(1e4, 0.02),), TIMES, 2e-3)
    assert alike.alike
    first = alike.group(members)
    assert len(calls) == 1
    buffer = aligned(first[1].shape)
    buffer[:] = 7.0
    again = alike.group(members, buffer)
    assert len(calls) == 1
    assert again[1] is buffer
    np.testing.assert_array_equal(buffer, first[1])
    assert alike.group(members, aligned((3, WIDTH)))[1].shape == first[1].shape


def test_each_sample_rests_under_its_own_pressure(paper):
    """Whether the pressures differ, or only what valves have let through at the first time."""
    late = paper.with_(valve=Valve(dead_time=0.5))
    step = Pulse(3e4, -0.1, 9.0)
    for models, pulses, levels in (
        ([paper, paper], (Pulse(1e4, -9.0, 99.0), step), (1e4, 3e4)),
        ([paper, late], (step,), (3e4, 0.0)),
        ([paper, paper], (step,), (3e4, 3e4)),
    ):
        samples = gather(models, None, 1)
        found = initial_state(samples, Schedule(samples, pulses, TIMES, 1e-3), None, None)
        expected = [np.cumsum(equilibrium(paper, level) + paper.rest_angle) + paper.base_angle for level in levels]
        np.testing.assert_allclose(found[0].T, expected, atol=1e-12)
        assert not found[1].any()


def test_variables_in_space_are_those_about_each_axis():
    known = ("joint_angle_x", "joint_angle_y", "joint_rate_x", "joint_rate_y", "axial_strain", "axial_strain_rate",
             "tip_position")  # fmt: skip
    assert expanded(["tip_position", "joint_angle"], known) == ["tip_position", "joint_angle_x", "joint_angle_y"]
    assert expanded(["joint_rate", "axial_strain"], known) == ["joint_rate_x", "joint_rate_y", "axial_strain"]
    assert expanded(["joint_angle", "joint_rate"], ("joint_angle", "joint_rate")) == ["joint_angle", "joint_rate"]


def test_inputs_of_no_model_are_one_for_each_sample():
    pulses = [Pulse(1e4), Pulse(2e4)]
    assert sets_of([], pulses) == [(pulses[0],), (pulses[1],)]


@pytest.mark.parametrize("slow", [{"swell_share": 0.5, "swell_time": 0.05}, {"inflation_limit": 2e5}], ids=str)
def test_slow_states_go_on_under_a_pressure_that_is_held(slow):
    """No valve lags, so the pressure is there at once: the torque grows nevertheless, as of one chain alone."""
    quiet = chen2018.model(torque=[3e-7, 5e-12])
    model = chen2018.model(torque=[3e-7, 5e-12], **slow)
    batch, alone = batch_stepper([quiet, model], WIDTH + 1, 1e-3), Stepper(model, 1e-3)
    assert batch._state.shape[0] == 2  # groups
    batch.reset(np.array([2, WIDTH]), np.array([1, 1]))
    for _ in range(2):
        batch.hold(np.full((WIDTH + 1, 1), 6e4), 40)
        alone.step(6e4, 40)
    for k in (2, WIDTH):
        np.testing.assert_allclose(batch.position[k], alone.angle, atol=1e-13)
    assert abs(batch.position[2, -1] - batch.position[3, -1]) > 1e-3


def test_one_of_two_chambers_may_be_slow():
    """Both orders: a step is not held still while any of its torques changes."""
    swelling = Chamber([3e-7, 5e-12], joint_gain=[1.0, 1.0, 0, 0, 0], swell_share=0.5, swell_time=0.05, name="slow")
    plain = Chamber([-5e-7], joint_gain=[0, 0, 1.0, 1.0, 1.0], name="far")
    late = Chamber([-5e-7], joint_gain=[0, 0, 1.0, 1.0, 1.0], valve=Valve(rise_time=0.02), name="far")
    for inputs in ((swelling, plain), (plain, swelling), (late, swelling)):
        model = chen2018.model().with_(chambers=inputs)
        batch, alone = batch_stepper([model], 1, 1e-3), Stepper(model, 1e-3, np.zeros(2))
        batch.hold(np.array([[6e4, 4e4]]), 60)
        alone.step(np.array([6e4, 4e4]), 60)
        np.testing.assert_allclose(batch.position[0], alone.angle, atol=1e-13)


def test_every_chain_of_a_stepper_needs_its_pressure(paper):
    for body in (paper, paper.with_(memory=Memory(slip_share=(0.3,), slip_angle=(0.02,)))):
        batch = batch_stepper([body], 2, 1e-3)
        for pressure in (np.full((1, 1), 1e4), np.full((2, 2), 1e4), 1e4):
            with pytest.raises(InputError, match="2 chains and 1 chambers"):
                batch.hold(pressure, 1)
