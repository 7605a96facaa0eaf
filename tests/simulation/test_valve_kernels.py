"""Valves: exact for straight commands, held to SciPy's DOP853 and to closed forms."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pliant.actuators import chen2018
from pliant.batch import simulate_batch
from pliant.errors import InputError
from pliant.model import Valve
from pliant.simulation import Pulse, Step, Stepper, Trace, simulate
from pliant.simulation.drive import through_valve


def behind(valve, command, nodes, before=0.0):
    """Pressure at the ends of the intervals and its mean over each."""
    out = through_valve(valve, command, nodes, before)
    return np.append(out[0, 0], out[:, 2]), out[:, 3], out


def reference(slope, state, command, nodes, dead=0.0):
    """The same by DOP853, restarted at every node; the last state is the running integral of the pressure."""
    states = [np.append(state, 0.0)]
    for a, b in pairwise(nodes):
        u0, u1 = (float(command(0.5 * (a + b) - dead + s * (b - a) / 4)) for s in (-1, 1))

        def rhs(t, y, a=a, b=b, u0=u0, u1=u1):
            u = u0 + (u1 - u0) * ((t - a) / (b - a) * 2 - 0.5)
            return np.append(slope(y[:-1], u), y[0])

        states.append(solve_ivp(rhs, (a, b), states[-1], method="DOP853", rtol=1e-12, atol=1e-9).y[:, -1])
    return np.array(states)[:, 0], np.diff(np.array(states)[:, -1]) / np.diff(nodes)


COMMAND = Trace([0.0, 0.1, 0.1, 0.3, 0.45, 0.45, 0.8], [0.0, 0.0, 1.0, 1.5, 1.5, 0.2, 0.4])
NODES = np.unique(np.concatenate([COMMAND.breakpoints, np.linspace(0, 1.2, 14)]))


def test_first_order_has_its_own_rise_and_fall():
    rise, fall = 0.03, 0.11
    p, mean, _ = behind(Valve(rise_time=rise, fall_time=fall), COMMAND, NODES)
    want, area = reference(lambda y, u: (u - y) / (rise if u >= y[0] else fall), np.zeros(1), COMMAND, NODES)
    crossed = 2e-3  # the command crosses the pressure within one interval, which is given to one side
    assert p == pytest.approx(want, abs=crossed)
    equal, _, _ = behind(Valve(rise_time=0.05, fall_time=0.05), COMMAND, NODES)
    want, _ = reference(lambda y, u: (u - y) / 0.05, np.zeros(1), COMMAND, NODES)
    assert equal == pytest.approx(want, abs=1e-10)
    assert mean == pytest.approx(area, abs=crossed)


def test_first_order_step_and_release_are_exponentials():
    nodes = np.array([0.0, 0.2, 0.23, 0.4, 1.0, 1.05, 1.3])
    p, mean, out = behind(Valve(rise_time=0.04, fall_time=0.09), Pulse(1e5, 0.2, 0.8), nodes)
    top = 1e5 * (1 - np.exp(-0.8 / 0.04))
    assert p[:5] == pytest.approx(1e5 * (1 - np.exp(-np.maximum(nodes[:5] - 0.2, 0) / 0.04)), rel=1e-12)
    assert p[4:] == pytest.approx(top * np.exp(-(nodes[4:] - 1.0) / 0.09), rel=1e-12)
    assert out[1, 1] == pytest.approx(1e5 * (1 - np.exp(-0.015 / 0.04)))  # the middle of an interval
    decay = np.exp(-0.03 / 0.04)
    assert mean[1] == pytest.approx(1e5 * (1 - 0.04 * (1 - decay) / 0.03), rel=1e-12)


def test_no_fall_time_means_that_the_pressure_falls_at_once():
    p, _, out = behind(Valve(rise_time=0.05), Pulse(1e5, 0.1, 0.5), np.array([0.0, 0.1, 0.6, 0.7]))
    assert p[2] == pytest.approx(1e5 * (1 - np.exp(-10)))
    assert out[2].tolist() == [0.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("zeta", [0.05, 0.7, 1 - 1e-12, 1.0, 1 + 1e-7, 3.0])
def test_second_order_under_critically_and_over_damped(zeta):
    omega = 2 * np.pi * 6.0
    p, mean, _ = behind(Valve(natural_frequency=6.0, damping_ratio=zeta), COMMAND, NODES)
    want, area = reference(
        lambda y, u: np.array([y[1], omega**2 * (u - y[0]) - 2 * zeta * omega * y[1]]), np.zeros(2), COMMAND, NODES
    )
    assert p == pytest.approx(want, abs=1e-8)
    assert mean == pytest.approx(area, abs=1e-8)


def test_second_order_overshoots_as_the_closed_form_says():
    zeta, f = 0.3, 8.0
    damped = 2 * np.pi * f * np.sqrt(1 - zeta**2)
    p, _, _ = behind(Valve(natural_frequency=f, damping_ratio=zeta), Step(1.0), np.array([0.0, np.pi / damped]))
    assert p[-1] - 1 == pytest.approx(np.exp(-np.pi * zeta / np.sqrt(1 - zeta**2)), rel=1e-12)


def test_a_very_fast_overdamped_valve_stays_finite():
    p, mean, _ = behind(Valve(natural_frequency=5e4, damping_ratio=40.0), Step(1.0), np.array([0.0, 0.5, 1.0]))
    assert p[1:] == pytest.approx([1.0, 1.0])
    assert np.isfinite(mean).all()


@pytest.mark.parametrize("valve", [{}, {"rise_time": 0.03, "fall_time": 0.05}, {"natural_frequency": 7.0}])
def test_dead_time_only_shifts_the_pressure(valve):
    nodes = np.linspace(0, 1, 41)
    late = behind(Valve(dead_time=0.075, **valve), Pulse(1e5, 0.2, 0.4), nodes)[0]
    prompt = behind(Valve(**valve), Pulse(1e5, 0.275, 0.4), nodes)[0]
    assert late == pytest.approx(prompt, abs=1e-6)


@pytest.mark.parametrize("valve", [{"rise_time": 0.03, "fall_time": 0.05}, {"natural_frequency": 7.0}])
def test_a_valve_starts_at_rest_at_the_pressure_before(valve):
    nodes = np.linspace(0, 0.5, 6)
    assert behind(Valve(**valve), Trace([0.0], [4e4]), nodes, 4e4)[0] == pytest.approx(np.full(6, 4e4), rel=1e-14)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"rise_time": -0.01}, "rise_time must be finite and not negative"),
        ({"dead_time": np.nan}, "dead_time must be finite"),
        ({"fall_time": np.inf}, "fall_time must be finite"),
        ({"natural_frequency": 5.0, "rise_time": 0.1}, "set only one"),
        ({"natural_frequency": 5.0, "damping_ratio": 0.0}, "damping_ratio must be positive"),
    ],
)
def test_bad_valves_get_one_clear_sentence(values, words):
    with pytest.raises(InputError, match=words):
        Valve(**values)


@pytest.mark.parametrize(
    ("first", "then", "until"),
    [(0.0, 4e4, 0.036), (0.0, 2.5e5, 0.066), (4e4, 0.0, 0.04), (3e5, 0.0, 0.11), (3e5, -9e4, 0.22)],
)
def test_flow_through_an_opening_is_that_of_iso_6358(first, then, until):
    """Filled and vented, choked and not, until shortly before the pressures are equal."""
    lag, nodes = 0.07, np.linspace(0.0, until, 7)

    def flow(y, u):
        high, low = max(y[0], u) + 101325.0, min(y[0], u) + 101325.0
        psi = np.sqrt(max(1.0 - max(2.0 * low / high - 1.0, 0.0) ** 2, 0.0))
        return np.array([np.sign(u - y[0]) * high * psi / lag])

    p, mean, out = behind(Valve(opening_time=lag), Trace([0.0, 0.0, 1.0], [first, then, then]), nodes, first)
    want, area = reference(flow, np.array([first]), Step(then, -1.0), nodes)
    assert p == pytest.approx(want, abs=0.01)
    assert mean == pytest.approx(area, abs=0.01)
    halves, _, _ = behind(Valve(opening_time=lag), Step(then, 0.0), np.linspace(0.0, until, 13), first)
    assert out[:, 1] == pytest.approx(halves[1::2], abs=1e-6)


def test_a_chamber_behind_an_opening_is_full_after_a_finite_time():
    """Below twice its absolute pressure the flow is never choked: full after T/2 arccos(2 p0 / u - 1)."""
    full = 0.05 * np.arccos(2.0 * 101325.0 / (101325.0 + 4e4) - 1.0)
    p, _, _ = behind(Valve(opening_time=0.1), Step(4e4), np.array([0.0, 0.99 * full, 1.0001 * full, 0.5]))
    assert p[1] < 4e4 - 1.0
    assert p[2:] == pytest.approx(4e4, abs=1e-6)
    still, mean, _ = behind(Valve(opening_time=0.1), Step(4e4, -1.0), np.linspace(0.0, 0.5, 3), 4e4)
    assert np.array([*still, *mean]) == pytest.approx(4e4, rel=1e-12)
    slower, _, _ = behind(Valve(opening_time=0.1, rise_time=0.05), Step(4e4), np.linspace(0.0, 0.5, 201))
    assert np.all(np.diff(slower) >= 0.0)
    assert slower[-1] == pytest.approx(4e4, rel=1e-3)


def test_a_dead_band_is_taken_off_the_command_before_the_lag():
    """By hand: a step of 10 kPa settles at 8.5 kPa, with the lag's course; what lies within the band moves nothing."""
    nodes = np.linspace(0.0, 1.0, 101)
    seen, _, _ = behind(Valve(rise_time=0.1, fall_time=0.1, dead_band=1.5e3), Pulse(1e4, 0.0, 2.0), nodes)
    assert seen == pytest.approx(8.5e3 * (1.0 - np.exp(-nodes / 0.1)), abs=1e-6)
    ideal, mean, _ = behind(Valve(dead_band=1.5e3), Trace([0.0, 1.0], [-3e3, 3e3]), nodes)
    command = 6e3 * nodes - 3e3
    assert ideal == pytest.approx(np.sign(command) * np.maximum(np.abs(command) - 1.5e3, 0.0), abs=1e-9)
    assert mean.sum() == pytest.approx(0.0, abs=1e-6)
    held, _, _ = behind(Valve(dead_band=1.5e3), Pulse(1e3, 0.0, 2.0), nodes)
    assert not held.any()


def test_a_body_behind_a_dead_band_rests_and_moves_as_under_less_pressure():
    model = chen2018.model(valve=Valve(rise_time=0.03, fall_time=0.05))
    banded = model.with_(valve=replace(model.valve, dead_band=2e3))
    times = np.linspace(0.0, 0.4, 41)
    pairs = [(9e4, 8.8e4), (-5e4, -4.8e4), (1.5e3, 0.0)]
    for command, left in pairs:  # loaded at first, then let go
        moved, plain = (simulate(m, Trace([0.0, 0.1, 0.1], [p, p, 0.0]), times=times) for m, p in
                        ((banded, command), (model, left)))
        assert moved["tip_position"].values == pytest.approx(plain["tip_position"].values, abs=1e-12)
    batch = simulate_batch(banded, [Trace([0.0, 0.1, 0.1], [p, p, 0.0]) for p, _ in pairs[:2]], times=times)
    alone = simulate(banded, Trace([0.0, 0.1, 0.1], [9e4, 9e4, 0.0]), times=times)
    np.testing.assert_allclose(batch["tip_position"].values[0, :, -1], alone["tip_position"].values[:, -1], atol=1e-12)
    with pytest.raises(InputError, match="dead_band"):
        simulate(banded, Pulse(9e4), times=times, method="LSODA")
    with pytest.raises(InputError, match="give the model an ideal or first-order valve"):
        Stepper(banded)
