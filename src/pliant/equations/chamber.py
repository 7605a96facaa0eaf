"""One pressure -> one torque, over an interval of time: laws, chambers that swell, hyperelastic walls.

A chamber makes the torque of its law (`laws`), or, where its rubber takes time, one that depends on two slow
states: a pressure that lags (swelling) and the fourth power of the hoop stretch (inflation). `advance` averages the
torque over an interval and moves the slow states on, `share_out` gives it to the joints: whoever takes steps takes its
torques from here.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.laws import lever, lever_secant, secant
from pliant.equations.section import torque
from pliant.equations.symbols import ChamberConstants, Interval


def mean_of_law(p, a):
    """Mean torque of the law a in an `Interval` p of pressure; N m.

    Simpson's rule; what that rule misses of the mean pressure, where a valve settles within the interval, enters by
    the slope of the law's secant. Exact for a linear law.
    """
    simpson = (torque(p.start, a) + 4.0 * torque(p.middle, a) + torque(p.end, a)) / 6.0
    return simpson + (p.mean - (p.start + 4.0 * p.middle + p.end) / 6.0) * secant(p.start, p.end, a, 0)


def swollen_torque(p, slow, share, a, form):
    """Torque at the pressure p of a chamber that swells: its lever grows with a pressure that lags behind; N m.

    tau = p (a_1 + a_2 s + a_3 s^2 + ...),  s = p + share (slow - p); of another law p lever(s)

    At rest, where slow = p, and at share = 0 it is the law. Without pressure there is no torque, however swollen the
    chamber still is.
    """
    return lever(p + share * (slow - p), a, form) * p


def slow_interval(h, p, slow, time):
    """Slow pressure at the middle and the end of an `Interval` p of length h [s]: time slow' = p - slow; Pa.

    Exact for a pressure that runs straight from start to end; one that bends in between is taken as a straight line of
    the same mean and the same rise.
    """
    first = p.mean - 0.5 * (p.end - p.start)
    rise = p.end - p.start
    x = h / time
    gone = -np.expm1(-0.5 * x)  # share of the way that half the interval goes
    middle = slow + gone * (first - slow) + 0.5 * (1.0 - gone / (0.5 * x)) * rise
    gone = -np.expm1(-x)
    last = slow + gone * (first - slow) + (1.0 - gone / x) * rise
    return middle, last


def mean_swollen(p, slow, chamber):
    """Mean of `swollen_torque` over an `Interval` p, the slow pressure given at its start, middle and end; N m."""
    share = chamber.swell_share
    a = chamber.law
    simpson = (
        swollen_torque(p.start, slow[0], share, a, chamber.form)
        + 4.0 * swollen_torque(p.middle, slow[1], share, a, chamber.form)
        + swollen_torque(p.end, slow[2], share, a, chamber.form)
    ) / 6.0
    slope = swollen_slope(p.start, p.end, slow[1], share, a, chamber.form)
    return simpson + (p.mean - (p.start + 4.0 * p.middle + p.end) / 6.0) * slope


def swollen_slope(start, end, slow, share, a, form):
    """Slope of the chord of `swollen_torque` between two pressures [Pa], the slow one held; N m/Pa."""
    s0 = start + share * (slow - start)
    s1 = end + share * (slow - end)
    return lever(s1, a, form) + start * (1.0 - share) * lever_secant(s0, s1, a, form)


def gent_factor(y, jm):
    """Factor of Gent's rubber on the tension of the wall, and its slope by y, the fourth power of the hoop stretch.

    G = 1 / (1 - J / jm), J = stretch^2 + stretch^-2 - 2, the first invariant less 3 of a tube whose length is held.
    Above J = 0.9 jm the tangent there continues it, so that any step of time stays finite.

    Source: Gent, A new constitutive relation for rubber, Rubber Chem. Technol. 69 (1996) 59
    """
    root = np.sqrt(y)
    left = 1.0 - (root + 1.0 / root - 2.0) / jm
    factor = 20.0 - 100.0 * left
    slope = 100.0 + 0.0 * y
    if left.real > 0.1:
        factor = 1.0 / left
        slope = factor * factor
    return factor, slope * 0.5 * (1.0 - 1.0 / y) / (root * jm)


def wall_rate(p, y, chamber):
    """Rate y' [1/s] of the fourth power of the hoop stretch at the pressure p [Pa], and its slope by y.

    time y' = p / limit y - (y - 1) G(y)

    A thin tube of viscous rubber whose length fibres hold; `limit` [Pa] is the shear modulus times wall over radius.
    Of a neo-Hookean rubber, `inflation_jm` = 0, G = 1: p = limit (1 - stretch^-4) at rest, and it grows without end at
    the limit, ever more slowly towards it. Gent's rubber stiffens towards J = jm: `gent_factor`.

    Source: Rivlin (1949) for the tube; the rate is work done by p less work stored, taken by the wall's viscosity.
    """
    push = p / chamber.inflation_limit
    if chamber.inflation_jm.real > 0.0:
        factor, slope = gent_factor(y, chamber.inflation_jm)
        rate = push * y - (y - 1.0) * factor
        return rate / chamber.inflation_time, (push - factor - (y - 1.0) * slope) / chamber.inflation_time
    return (1.0 - (1.0 - push) * y) / chamber.inflation_time, (push - 1.0) / chamber.inflation_time


def inflated_interval(h, p, y, chamber):
    """Fourth power y of a chamber's hoop stretch at the middle and the end of an `Interval` p of length h [s]."""
    first = 2.0 * p.mean - 0.5 * (p.middle + p.end)
    return inflated(0.5 * h, first, y, chamber), inflated(h, p.mean, y, chamber)


def inflated(h, p, y, chamber):
    """Fourth power of the hoop stretch after h [s] at the pressure p [Pa], by the exponential of `wall_rate`'s slope.

    Exact of a neo-Hookean wall, of second order in h of Gent's.
    """
    rate, slope = wall_rate(p, y, chamber)
    x = -slope * h
    late = 1.0 - 0.5 * x  # mean of the decay: its series where the difference below would lose its digits
    if abs(x.real) > 1e-8:
        late = -np.expm1(-x) / x
    return y + h * late * rate


def lever_growth(y):
    """Factor stretch^3 on the torque: V = A L + A d sum(q) and A d = 2/3 r2^3 grows with the cube of the radius.

    Paper: Sec. III-C, with a radius that grows
    """
    return y**0.75


def mean_inflated(p, slow, y, chamber):
    """Mean of `swollen_torque` times `lever_growth` over an `Interval` p, y at its three times as slow is; N m."""
    share = chamber.swell_share
    a = chamber.law
    simpson = (
        lever_growth(y[0]) * swollen_torque(p.start, slow[0], share, a, chamber.form)
        + 4.0 * lever_growth(y[1]) * swollen_torque(p.middle, slow[1], share, a, chamber.form)
        + lever_growth(y[2]) * swollen_torque(p.end, slow[2], share, a, chamber.form)
    ) / 6.0
    slope = lever_growth(y[1]) * swollen_slope(p.start, p.end, slow[1], share, a, chamber.form)
    return simpson + (p.mean - (p.start + 4.0 * p.middle + p.end) / 6.0) * slope


def torque_now(p, slow, y, chamber):
    """Torque [N m] of a chamber at the pressure p [Pa] and its slow states."""
    made = swollen_torque(p, slow, chamber.swell_share, chamber.law, chamber.form)
    if chamber.inflation_limit.real > 0.0:
        return made * lever_growth(y)
    return made


def slow_rates(p, slow, y, chamber):
    """Rates of the slow states at the pressure p [Pa]: of the slow pressure, Pa/s, and of y, 1/s."""
    growing = 0.0 * y
    if chamber.inflation_limit.real > 0.0:
        growing, _ = wall_rate(p, y, chamber)
    return (p - slow) / chamber.swell_time, growing


def advance(h, p, chamber, state):
    """Mean torque [N m] of a chamber over an `Interval` p of length h [s]; its slow `state` (2,) moves on in place.

    The state is the slow pressure [Pa] and the fourth power of the hoop stretch; a chamber without rubber that takes
    time leaves it as it is.
    """
    if not (chamber.swell_share.real > 0.0 or chamber.inflation_limit.real > 0.0):
        if chamber.form.real == 0.0:
            return mean_of_law(p, chamber.law)
        return mean_swollen(p, (p.start, p.middle, p.end), chamber)  # of a share of 0
    before = state[0]
    half, last = slow_interval(h, p, before, chamber.swell_time)
    state[0] = last
    if not chamber.inflation_limit.real > 0.0:
        return mean_swollen(p, (before, half, last), chamber)
    y = state[1]
    y_half, y_last = inflated_interval(h, p, y, chamber)
    state[1] = y_last
    return mean_inflated(p, (before, half, last), (y, y_half, y_last), chamber)


def advance_one(c, h, p, actuation, state):
    """As `advance`, of chamber c of an `ActuationConstants`; its slow states are row c of `state` (C, 2)."""
    rubber = actuation.rubber
    chamber = ChamberConstants(
        actuation.law[c], rubber[c, 0], rubber[c, 1], rubber[c, 2], rubber[c, 3], rubber[c, 4], rubber[c, 5],
    )
    return advance(h, p, chamber, state[c])


def share_out(c, torque, gain, tau):
    """Add the torque [N m] of chamber c to those of the joints, tau (n,): tau_i = sum_c gain_ci torque_c.

    The first chamber writes over what was there.
    """
    for i in range(len(tau)):
        if c == 0:
            tau[i] = gain[c, i] * torque
        else:
            tau[i] = tau[i] + gain[c, i] * torque


def held_torques(h, pressure, actuation, state, tau):
    """Mean torques tau (n,) [N m] of the joints over h [s] under pressures (C,) [Pa] that are held.

    The slow states (C, 2) of the chambers move on in place.
    """
    for c in range(len(pressure)):
        p = pressure[c]
        made = advance_one(c, h, Interval(p, p, p, p), actuation, state)
        share_out(c, made, actuation.gain, tau)
