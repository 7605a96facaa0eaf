"""A chamber: the torque of one pressure over an interval, with rubber that swells or gives way."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from pliant.equations.chamber import (
    advance,
    advance_one,
    held_torques,
    inflated,
    inflated_interval,
    lever_growth,
    mean_inflated,
    mean_of_law,
    mean_swollen,
    secant,
    share_out,
    slow_interval,
    slow_rates,
    swollen_torque,
    torque,
    torque_now,
    wall_rate,
)
from pliant.equations.symbols import ActuationConstants, ChamberConstants, Interval
from pliant.model.actuation_input import rest_growth


@pytest.mark.parametrize("terms", [1, 2, 4])
def test_secant_is_the_divided_difference(rng, terms):
    a = rng.normal(size=terms)
    assert secant(1.3, 0.4, a, 0) == pytest.approx((torque(1.3, a) - torque(0.4, a)) / 0.9, rel=1e-12)
    slope = np.imag(torque(0.7 + 1e-30j, a)) / 1e-30
    assert secant(0.7, 0.7, a, 0) == pytest.approx(slope, rel=1e-12)


def test_mean_torque_is_exact_for_the_papers_law():
    """Whatever the pressure did within the interval: here it settles in a small part of it."""
    lag = 0.01
    end, half, mean = 1 - np.exp(-1 / lag), 1 - np.exp(-0.5 / lag), 1 - lag * (1 - np.exp(-1 / lag))
    assert mean_of_law(Interval(0.0, half, end, mean), np.array([2.0])) == pytest.approx(2 * mean, rel=1e-14)


@pytest.mark.parametrize("terms", [1, 2, 3])
def test_mean_torque_along_a_straight_pressure_is_exact_to_the_cubic_law(rng, terms):
    a = rng.normal(size=terms)
    p = np.linspace(0.2, 1.4, 100_001)
    expected = np.trapezoid(torque(p, a), p) / 1.2
    assert mean_of_law(Interval(0.2, 0.8, 1.4, 0.8), a) == pytest.approx(expected, rel=1e-8)


LAW = np.array([6e-7, 2e-12, 3e-18])
STRAIGHT = Interval(2e4, 5e4, 8e4, 5e4)


def chamber(share, law=LAW, limit=0.0, jm=0.0):
    return ChamberConstants(law, share, 0.3, limit, 0.05, jm, 0.0)


def test_a_chamber_that_has_swollen_follows_the_law():
    assert swollen_torque(1e5, 1e5, 0.7, LAW, 0.0) == pytest.approx(torque(1e5, LAW), rel=1e-15)
    assert swollen_torque(1e5, 2e4, 0.0, LAW, 0.0) == torque(1e5, LAW)
    assert swollen_torque(1e5, 2e4, 1.0, LAW, 0.0) == pytest.approx(1e5 * torque(2e4, LAW) / 2e4, rel=1e-15)
    assert swollen_torque(0.0, 2e5, 0.7, LAW, 0.0) == 0.0


def test_slow_pressure_behind_a_straight_one_is_exact():
    """time s' = p - s with p = p0 + rise t / h, at the middle and the end; small and large h / time."""
    p0, p1, s0 = 2e4, 9e4, 5e4
    for h, time in ((1e-3, 10.0), (0.3, 0.2), (5.0, 0.1)):
        slope = (p1 - p0) / h
        expected = [p0 + slope * (t - time) + (s0 - p0 + slope * time) * np.exp(-t / time) for t in (h / 2, h)]
        half = 0.5 * (p0 + p1)
        assert slow_interval(h, Interval(p0, half, p1, half), s0, time) == pytest.approx(expected, rel=1e-9)


def test_mean_torque_of_a_swelling_chamber(rng):
    """The plain rule at share 0; the mean of the law along straight pressures; the mean of p for a linear law."""
    p, s = rng.uniform(0, 1e5, 4), rng.uniform(0, 1e5, 3)
    assert mean_swollen(Interval(*p), s, chamber(0.0)) == pytest.approx(mean_of_law(Interval(*p), LAW), rel=1e-12)
    assert mean_swollen(Interval(*p), s, chamber(0.6, LAW[:1])) == pytest.approx(LAW[0] * p[3], rel=1e-12)
    t = np.linspace(0, 1, 20001)
    straight = swollen_torque(2e4 + 6e4 * t, 3e4 + 1e4 * t, 0.6, LAW[:2], 0.0)
    found = mean_swollen(STRAIGHT, (3e4, 3.5e4, 4e4), chamber(0.6, LAW[:2]))
    assert found == pytest.approx(np.trapezoid(straight, t), rel=1e-8)


LIMIT, WALL = 5e4, 0.05  # the time of `chamber`


def test_a_chamber_inflates_as_its_wall_lets_it():
    """At rest p = limit (1 - stretch^-4); the nearer the limit, the slower; nothing special at the limit itself."""
    for p in (0.0, 1e4, 4e4, -2e4):
        middle, end = inflated_interval(50.0, Interval(p, p, p, p), 1.0, chamber(0.0, limit=LIMIT))
        assert p == pytest.approx(LIMIT * (1.0 - 1.0 / end), abs=1e-9)
        assert middle == pytest.approx(end)
    for p in (2e4, 4e4, LIMIT, LIMIT * (1 + 1e-10), 6e4):
        t = np.linspace(0.0, 0.1, 200_001)
        rate = (1.0 - p / LIMIT) / WALL
        expected = np.exp(-rate * 0.1) * 1.2 + np.trapezoid(np.exp(-rate * t), t) / WALL
        assert inflated(0.1, p, 1.2, chamber(0.0, limit=LIMIT)) == pytest.approx(expected, rel=1e-9)
    left = [1.0 / (1.0 - p / LIMIT) - inflated(0.1, p, 1.0, chamber(0.0, limit=LIMIT)) for p in (2e4, 4e4)]
    assert left[1] > 10 * left[0]


def test_a_gent_wall_rests_where_its_rubber_holds_the_pressure():
    """Against the derivative of Gent's energy -jm / 2 ln(1 - J / jm); there is a rest at any pressure."""
    jm = 20.0
    for push in (-0.5, 0.3, 0.9, 1.0, 1.2, 4.0):
        y = rest_growth(np.array(push * LIMIT), LIMIT, jm)
        stretch = y**0.25

        def energy(x):  # of a ring of unit shear modulus, wall and radius
            return -0.5 * jm * np.log(1.0 - (x**2 + x**-2 - 2.0) / jm)

        slope = np.imag(energy(stretch + 1e-30j)) / 1e-30
        assert slope / stretch == pytest.approx(push, rel=1e-9)  # p = W' / (stretch radius) of a thin tube
        held = 1.0
        for _ in range(150):
            held = inflated(0.05, push, held, chamber(0.0, limit=1.0, jm=jm))
        assert held == pytest.approx(y, rel=1e-9)
    assert rest_growth(np.array([2e4, 9e4]), LIMIT, 0.0) == pytest.approx([1.0 / 0.6, np.inf])
    assert rest_growth(np.array([2e4, 4e4]), LIMIT, 1e9) == pytest.approx([1.0 / 0.6, 5.0], rel=1e-6)
    far = rest_growth(np.array([1e2 * LIMIT, 1e5 * LIMIT]), LIMIT, jm)
    assert np.isfinite(far).all()
    assert far[1] > far[0]


def test_a_gent_wall_moves_as_its_rate_says():
    """Second order in the interval, by an adaptive solver; the slope of the rate by a complex step, both branches."""
    own, p = chamber(0.0, limit=LIMIT, jm=4.0), 1.3 * LIMIT
    found = solve_ivp(lambda _, y: wall_rate(p, y, own)[0], (0.0, 0.1), [1.1], rtol=1e-11, atol=1e-12).y[0, -1]
    errors = []
    for count in (20, 40):
        y = 1.1
        for _ in range(count):
            y = inflated(0.1 / count, p, y, own)
        errors.append(abs(y - found))
    assert errors[1] < 2e-3 * found
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)
    for y in (0.6, 1.0, 3.0, 20.0, 33.0, 40.0, 300.0):
        rate, slope = wall_rate(p, y + 1e-30j, own)
        assert np.imag(rate) / 1e-30 == pytest.approx(slope.real, rel=1e-12, abs=1e-12)
    edge = brentq(lambda y: np.sqrt(y) + 1.0 / np.sqrt(y) - 2.0 - 0.9 * 4.0, 10.0, 100.0)
    below, above = (np.array(wall_rate(p, edge * x, own)) for x in (1.0 - 1e-9, 1.0 + 1e-9))
    assert below == pytest.approx(above, rel=1e-6)  # the tangent continues it without a step or a kink


def test_mean_torque_of_an_inflating_chamber(rng):
    """The rule of the rigid wall at no stretch; the mean of the law along straight pressures and stretches."""
    p, s = rng.uniform(0, 1e5, 4), rng.uniform(0, 1e5, 3)
    p, swells = Interval(*p), chamber(0.6)
    rigid = mean_swollen(p, s, swells)
    assert mean_inflated(p, s, (1.0, 1.0, 1.0), swells) == rigid
    assert mean_inflated(p, s, (16.0, 16.0, 16.0), swells) == pytest.approx(8.0 * rigid, rel=1e-14)
    t = np.linspace(0, 1, 20001)
    growing = lever_growth(1.2 + 0.1 * t) * swollen_torque(2e4 + 6e4 * t, 3e4 + 1e4 * t, 0.6, LAW[:2], 0.0)
    found = mean_inflated(STRAIGHT, (3e4, 3.5e4, 4e4), (1.2, 1.25, 1.3), chamber(0.6, LAW[:2]))
    assert found == pytest.approx(np.trapezoid(growing, t), rel=1e-6)


@pytest.mark.parametrize(("share", "limit"), [(0.0, 0.0), (0.6, 0.0), (0.0, 5e4), (0.6, 5e4)])
def test_a_step_advances_what_a_record_averages(rng, share, limit):
    """`advance` step by step, against the slow states laid out first and averaged after."""
    own, state = chamber(share, limit=limit), np.array([1e4, 1.1])
    slow, y, behind = 1e4, 1.1, rng.uniform(0.0, 4e4, (20, 4))
    for row in behind:
        p = Interval(*row)
        half, last = slow_interval(0.02, p, slow, own.swell_time)
        y1, y2 = inflated_interval(0.02, p, y, own) if limit else (1.0, 1.0)
        rigid = mean_swollen(p, (slow, half, last), own) if share else mean_of_law(p, own.law)
        expected = mean_inflated(p, (slow, half, last), (y, y1, y2), own) if limit else rigid
        assert advance(0.02, p, own, state) == pytest.approx(expected, rel=1e-14)
        slow, y = last, y2
    if share or limit:
        assert state[0] == pytest.approx(slow, rel=1e-14)
    if limit:
        assert state[1] == pytest.approx(y, rel=1e-14)


def test_slow_states_follow_their_rates():
    """The closed forms of an interval against their equations, by an adaptive solver; the torque at one moment."""
    own, p = chamber(0.6, limit=5e4), 3e4
    found = solve_ivp(lambda _, s: slow_rates(p, *s, own), (0.0, 0.2), [1e4, 1.1], rtol=1e-10, atol=1e-9).y[:, -1]
    state = np.array([1e4, 1.1])
    advance(0.2, Interval(p, p, p, p), own, state)
    assert state == pytest.approx(found, rel=1e-8)
    swollen = swollen_torque(p, state[0], 0.6, LAW, 0.0)
    assert torque_now(p, *state, own) == pytest.approx(lever_growth(state[1]) * swollen)
    assert slow_rates(p, 1e4, 1.1, chamber(0.0))[1] == 0.0


def test_joints_share_the_torques_of_chambers():
    """tau = gain^T t: antagonists take from each other what they give alone; one chamber leaves no trace of another."""
    gain, tau = np.array([[1.0, 1.0, 0.0], [-1.0, -1.0, 0.5]]), np.full(3, np.nan)
    for c, t in enumerate((0.3, 0.3)):
        share_out(c, t, gain, tau)
    assert tau == pytest.approx(gain.T @ [0.3, 0.3], abs=1e-16)
    rubber = np.array([[0.6, 0.3, 0.0, 0.05, 0.0, 0.0], [0.0, 1.0, 0.0, 0.1, 0.0, 0.0]])
    body = ActuationConstants(np.stack([LAW, 2 * LAW]), gain, rubber)
    state = np.array([[2e4, 1.0], [1e4, 1.0]])
    held_torques(0.02, np.array([4e4, 0.0]), body, state, tau)
    alone = np.array([2e4, 1.0])
    p = Interval(4e4, 4e4, 4e4, 4e4)
    assert tau == pytest.approx(gain[0] * advance_one(0, 0.02, p, body, alone[None]), rel=1e-15)
    assert state[0] == pytest.approx(alone)
    assert state[1] == pytest.approx([1e4, 1.0])  # a chamber without rubber that takes time has no slow state


def test_another_law_keeps_the_rubber():
    """Twice the law is twice the torque, the slow states alike: both rubbers take part."""
    own, double = chamber(0.4, limit=3e5), chamber(0.4, limit=3e5)._replace(law=2.0 * LAW)
    one, two = np.array([1e4, 1.2]), np.array([1e4, 1.2])
    made = advance(0.02, STRAIGHT, own, one)
    assert advance(0.02, STRAIGHT, double, two) == pytest.approx(2.0 * made, rel=1e-14)
    np.testing.assert_array_equal(one, two)
