"""The answer does not depend on how the edges of the input, the output times and the steps align."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.errors import InputError
from pliant.model import Valve
from pliant.simulation import Chirp, Pulse, Step, Trace, simulate, triangle
from pliant.simulation.drive import drive, merge, subdivide

TIMES = np.linspace(0, 1, 101)
VALVES = [
    Valve(), Valve(rise_time=0.02, fall_time=0.035, dead_time=0.0123), Valve(rise_time=2e-4, fall_time=2e-4),
    Valve(natural_frequency=12.0, damping_ratio=0.6),
]


def node_times(plan, start):
    return start + np.concatenate([[0.0], np.cumsum(plan.h)])


def test_steps_end_at_every_output_time_and_every_jump(paper):
    times = np.array([0.05, 0.0731, 0.2, 0.20001, 0.9])
    plan = drive(paper.with_(valve=Valve(dead_time=0.011)), Pulse(1e5, 0.12345, 0.3), times, 4e-3)
    nodes = node_times(plan, times[0])
    for due in (*times, 0.12345 + 0.011, 0.42345 + 0.011):
        assert np.abs(nodes - due).min() < 1e-12
    assert plan.h.max() <= 4e-3 * (1 + 1e-9)
    assert nodes[np.flatnonzero(plan.keep >= 0) + 1] == pytest.approx(times[1:])
    assert plan.keep[plan.keep >= 0].tolist() == [1, 2, 3, 4]


def test_a_bend_of_the_input_does_not_end_a_step(paper):
    trace = Trace(np.arange(0, 1, 1 / 750), np.sin(np.arange(0, 1, 1 / 750)) * 1e5)
    assert drive(paper, trace, np.array([0.0, 0.5]), 2e-3).h.size == 250


@pytest.mark.parametrize("valve", VALVES)
@pytest.mark.parametrize("h", [7e-3, 1.3e-3])
def test_impulse_is_conserved(paper, valve, h):
    model = paper.with_(valve=valve)
    plan = drive(model, Pulse(1e5, 0.1234, 0.2711), np.array([0.0, 3.0]), h)
    if valve.natural_frequency or valve.rise_time == valve.fall_time:  # a linear valve loses nothing
        assert (plan.h * plan.torque[:, 0]).sum() == pytest.approx(model.torque_at(1e5) * 0.2711, rel=1e-9)
    fine = drive(model, Pulse(1e5, 0.1234, 0.2711), np.array([0.0, 3.0]), h / 100)
    assert (plan.h * plan.torque[:, 0]).sum() == pytest.approx((fine.h * fine.torque[:, 0]).sum(), rel=1e-9)


def test_impulse_of_a_law_that_is_not_a_line(awkward):
    saw = triangle(1e5, 0.37, 2, start=0.0111)
    plan = drive(awkward, saw, np.array([0.0, 1.0]), 3e-3)
    a1, a2 = awkward.torque
    assert (plan.h * plan.torque[:, 0]).sum() == pytest.approx((a1 * 1e5 / 2 + a2 * 1e10 / 3) * 0.74, rel=1e-12)


@pytest.mark.parametrize("lag", [5e-5, 1e-3, 0.02])
def test_mean_torque_of_a_fast_valve_in_a_square_law(awkward, lag):
    model = awkward.with_(torque=[0.0, 1e-12], valve=Valve(rise_time=lag, fall_time=lag))
    plan = drive(model, Step(1e5), np.array([0.0, 0.3]), 2e-3)
    want = 1e-2 * (0.3 - 2 * lag + lag / 2 - lag * (0 if lag < 0.01 else -2 * np.exp(-0.3 / lag)))
    assert (plan.h * plan.torque[:, 0]).sum() == pytest.approx(want, abs=1e-2 * 0.6 * min(lag, 2e-3**5 / lag**4))


@pytest.mark.parametrize("valve", VALVES)
def test_edges_may_fall_anywhere_in_a_step(paper, errors_mm, valve):
    model = paper.with_(valve=valve)
    steps = [4e-3, 2e-3, 1e-3]
    errors = np.array([
        errors_mm(model, Pulse(119e3, start, 0.3123), TIMES, steps) for start in (0.1, 0.1001, 0.1005, 0.10073, 0.10199)
    ])
    assert np.all(errors.max(axis=0) < [0.2, 0.07, 0.018])  # mm
    assert np.all(np.ptp(errors, axis=0) < 0.03 * errors.min(axis=0))


def test_moving_pulse_and_clock_together_changes_nothing(paper):
    here = simulate(paper, Pulse(119e3, 0.1, 0.3), times=TIMES).tip_position.values
    for shift in (0.1234567, 17.0, 1234.5):
        there = simulate(paper, Pulse(119e3, 0.1 + shift, 0.3), times=TIMES + shift).tip_position.values
        assert np.abs(there - here).max() < 1e-9


@pytest.mark.parametrize("ulps", [-9, -2, -1, 1, 2, 9])
@pytest.mark.parametrize("valve", VALVES)
def test_an_output_time_that_is_the_edge_but_for_rounding(paper, valve, ulps):
    model = paper.with_(valve=valve)
    pulse = Pulse(119e3, 0.12 - valve.dead_time)
    near = simulate(model, pulse, times=np.array([0.0, 0.12 + ulps * np.spacing(0.12), 0.2]))
    exact = simulate(model, pulse, times=np.array([0.0, 0.12, 0.2]))
    assert near.pressure.values[[0, 2]] == pytest.approx(exact.pressure.values[[0, 2]])
    assert -1e-6 <= near.pressure[1] <= 119e3
    assert np.abs(near.tip_position - exact.tip_position).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("valve", VALVES[:2])
def test_measured_trace_at_750_hz(paper, errors_mm, valve):
    t = np.arange(0, 0.6, 1 / 750)
    noise = np.random.default_rng(3).normal(0, 300.0, t.size)
    trace = Trace(t, 1e5 * np.clip((t - 0.1) / 0.02, 0, 1) + noise)
    errors = errors_mm(paper.with_(valve=valve), trace, np.linspace(0.0, 0.6, 61), [4e-3, 2e-3, 1e-3])
    assert np.all(np.array(errors) < [0.12, 0.05, 0.015])


def test_chirp_converges_at_second_order(paper, errors_mm):
    chirp = Chirp(3e4, 6e4, 0.5, 12.0, 0.9, start=0.0501)
    errors = errors_mm(paper, chirp, TIMES, [2e-3, 1e-3, 5e-4])
    assert errors[1] < 0.02
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.15)


@pytest.mark.parametrize("method", ["midpoint", "LSODA"])
def test_a_step_at_the_first_time_moves_the_chain(paper, method):
    run = simulate(paper, Step(119e3), duration=0.2, method=method)
    assert run.joint_angle[0].values == pytest.approx(np.zeros(5))
    assert run.pressure[0] == 119e3
    later = simulate(paper, Step(119e3, 0.1), times=np.linspace(0.0, 0.3, 301), method=method)
    assert np.abs(run.tip_position.values - later.tip_position.values[100:]).max() < 1e-7


def test_a_constant_pressure_from_before_the_first_time_holds_the_chain_still(paper):
    held = simulate(paper, Trace([0.0], [119e3]), duration=0.5)
    assert np.abs(held.joint_rate).max() < 1e-12
    started = simulate(paper, Step(119e3, -1.0), duration=0.5)
    assert np.abs(started.joint_rate).max() < 1e-12


def test_pressure_shown_is_what_lies_behind_the_valve(paper):
    times = np.linspace(0, 1, 201)
    shown = simulate(paper.with_(valve=Valve(rise_time=0.05, dead_time=0.1)), Step(1e5, 0.1), times=times).pressure
    assert shown.values[:, 0] == pytest.approx(1e5 * (1 - np.exp(-np.maximum(times - 0.2, 0) / 0.05)), rel=1e-10)


def test_subdivide_keeps_corners_and_cuts_gaps_in_equal_parts():
    nodes = subdivide(np.array([0.0, 0.1, 0.125, 0.1251]), 0.03)
    assert nodes == pytest.approx([0, 0.025, 0.05, 0.075, 0.1, 0.125, 0.1251])


def test_merge_drops_what_is_outside_or_already_there():
    times = np.array([0.0, 1.0, 2.0])
    moments = np.array([-1.0, 0.0, 0.5, 0.5 + 1e-12, 1.0 + 1e-12, 1.7, 2.0, np.inf])
    assert merge(times, moments, 1e-9).tolist() == [0.0, 0.5, 1.0, 1.7, 2.0]


@pytest.mark.parametrize("times", [[0.0], [0.0, 0.0], [1.0, 0.5], [0.0, np.nan], [[0.0, 1.0]]])
def test_times_that_do_not_increase_are_refused(paper, times):
    with pytest.raises(InputError, match="strictly increasing"):
        simulate(paper, Pulse(1e5), times=times)
