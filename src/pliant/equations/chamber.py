"""A pressure chamber, Sec. III-C: its cross-section, and its mean torque over a time interval for polynomial and other
torque laws, viscoelastic lag and hyperelastic walls.

A chamber gives the torque of its law (`laws`). A chamber of slow rubber gives a torque which also depends on two slow
states: a lagged pressure (viscoelastic lag) and the fourth power of the hoop stretch of the wall (inflation). `advance`
computes the mean torque over an interval and updates the slow states. `share_out` adds this torque to the joints. Every
integrator of this package takes its torques from these two functions.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.laws import lever, lever_secant, secant
from pliant.equations.symbols import ChamberConstants, Interval


def bladder_area(r2):
    """Return the area A = pi r2^2 / 2 [m^2] of the half-round chamber of inner radius r2 [m].

    A = pi r2^2 / 2

    The paper calls it the cross-section area of the actuator; the formula is that of the chamber.  # D6
    Paper: Sec. III-C
    """
    return 0.5 * np.pi * r2 * r2


def lever_arm(r2):
    """Return the lever arm d = 4 r2 / (3 pi) [m] of a half-round chamber: the distance of its centroid from the flat
    face, for inner radius r2 [m].

    d = 4 r2 / (3 pi)

    Paper: Sec. III-C
    """
    return 4.0 * r2 / (3.0 * np.pi)


def torque(p, a):
    """Return the torque [N m] which a chamber at the gauge pressure p [Pa] exerts on every joint, for polynomial
    coefficients `a`.

    tau = a_1 p + a_2 p^2 + ... with a = (a_1, a_2, ...) in N m/Pa^k. The paper's law tau = p A d is a = (A d,).
    The torque is the same on every joint: the flat face does not stretch, so V(q) = A L + A d sum(q), p dV/dq_i = p A
    d.

    Paper: Sec. III-C
    """
    value = 0.0 * p
    for k in range(len(a) - 1, -1, -1):
        value = (value + a[k]) * p
    return value


def mean_of_law(p, a):
    """Return the mean torque [N m] of a polynomial law with coefficients `a` while the pressure varies over the
    `Interval` p.

    Simpson's rule. The mean pressure may differ from Simpson's mean where a valve settles within the interval. This
    difference enters with the secant slope of the law. The result is exact for a linear law.
    """
    simpson = (torque(p.start, a) + 4.0 * torque(p.middle, a) + torque(p.end, a)) / 6.0
    return simpson + (p.mean - (p.start + 4.0 * p.middle + p.end) / 6.0) * secant(p.start, p.end, a, 0)


def swollen_torque(p, slow, share, a, form):
    """Return the torque [N m] of a chamber of viscoelastic rubber, whose lever arm grows with the lagged pressure
    `slow` [Pa].

    tau = p (a_1 + a_2 s + a_3 s^2 + ...),  s = p + share (slow - p); for other laws tau = p lever(s)

    `slow` is the lagged pressure [Pa]. In equilibrium (slow = p) and for share = 0 the torque is that of the law.
    Without pressure the torque is zero, whatever the lagged pressure is.
    """
    return lever(p + share * (slow - p), a, form) * p


def slow_interval(h, p, slow, time):
    """Return the lagged pressure [Pa] of a chamber at the middle and the end of a pressure `Interval` p of length h
    [s].

    The lagged pressure obeys time slow' = p - slow, with the time constant `time` [s] and its value `slow` [Pa] at the
    start. The result is exact for a pressure that changes linearly from start to end. A pressure that curves in between
    is replaced by a straight line with the same mean and the same rise.
    """
    first = p.mean - 0.5 * (p.end - p.start)
    rise = p.end - p.start
    x = h / time
    gone = -np.expm1(-0.5 * x)  # fraction of the way after half the interval
    middle = slow + gone * (first - slow) + 0.5 * (1.0 - gone / (0.5 * x)) * rise
    gone = -np.expm1(-x)
    last = slow + gone * (first - slow) + (1.0 - gone / x) * rise
    return middle, last


def mean_swollen(p, slow, chamber):
    """Return the mean torque [N m] of a chamber with viscoelastic lag while its pressure varies over the `Interval` p.

    The torque at each instant is that of `swollen_torque`.

    `slow` (3,) is the lagged pressure [Pa] at the start, middle and end of the interval.
    """
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
    """Return the secant slope [N m/Pa] of the torque between two pressures [Pa], with the lagged pressure held at
    `slow`.

    The torque is that of `swollen_torque`.
    """
    s0 = start + share * (slow - start)
    s1 = end + share * (slow - end)
    return lever(s1, a, form) + start * (1.0 - share) * lever_secant(s0, s1, a, form)


def gent_factor(y, jm):
    """Return Gent's strain-stiffening factor G of a rubber wall and its derivative dG/dy, where y is the hoop stretch
    to the fourth power.

    G = 1 / (1 - J / jm), J = stretch^2 + stretch^-2 - 2, the first invariant less 3 of a tube of constant length.
    Above J = 0.9 jm, G continues along its tangent, so that the result of any time step is finite.

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
    """Return the rate y' [1/s] of a viscous rubber wall at pressure p [Pa], and dy'/dy [1/s]. y is the hoop stretch to
    the fourth power.

    time y' = p / limit y - (y - 1) G(y)

    The wall is a thin tube of viscous rubber, whose length is kept by fibres. `limit` [Pa] is the shear modulus times
    the wall thickness over the radius. For neo-Hookean rubber (`inflation_jm` = 0) G = 1: the equilibrium is
    p = limit (1 - stretch^-4), so that the stretch grows without bound as p approaches the limit, and the approach to
    equilibrium becomes slower and slower. Gent's rubber stiffens as J approaches jm, see `gent_factor`.

    Source: Rivlin (1949) for the tube. The viscosity of the wall dissipates the work of p less the energy stored.
    """
    push = p / chamber.inflation_limit
    if chamber.inflation_jm.real > 0.0:
        factor, slope = gent_factor(y, chamber.inflation_jm)
        rate = push * y - (y - 1.0) * factor
        return rate / chamber.inflation_time, (push - factor - (y - 1.0) * slope) / chamber.inflation_time
    return (1.0 - (1.0 - push) * y) / chamber.inflation_time, (push - 1.0) / chamber.inflation_time


def inflated_interval(h, p, y, chamber):
    """Return y, the hoop stretch of the wall to the fourth power, at the middle and the end of a pressure `Interval` p
    of h [s].

    The argument `y` is the value at the start.
    """
    first = 2.0 * p.mean - 0.5 * (p.middle + p.end)
    return inflated(0.5 * h, first, y, chamber), inflated(h, p.mean, y, chamber)


def inflated(h, p, y, chamber):
    """Return the hoop stretch of the wall to the fourth power after h [s] at constant pressure p [Pa], from its value y
    at the start.

    An exponential Euler step with the slope of `wall_rate`: exact for a neo-Hookean wall, of second order in h for a
    Gent wall.
    """
    rate, slope = wall_rate(p, y, chamber)
    x = -slope * h
    late = 1.0 - 0.5 * x  # mean of the decay: its series where the difference below would lose its digits
    if abs(x.real) > 1e-8:
        late = -np.expm1(-x) / x
    return y + h * late * rate


def lever_growth(y):
    """Return the factor by which inflation increases a chamber's torque: the cube of the hoop stretch, from its fourth
    power y.

    V = A L + A d sum(q), and A d = 2/3 r2^3 grows with the cube of the radius.

    Paper: Sec. III-C, with a radius that grows
    """
    return y**0.75


def mean_inflated(p, slow, y, chamber):
    """Return the mean torque [N m] of a chamber with inflating wall and viscoelastic lag while its pressure varies over
    `Interval` p.

    The torque is `swollen_torque` times `lever_growth`. `slow` (3,) [Pa] and `y` (3,) are the lagged pressure and the
    fourth power of the hoop stretch at the start, middle and end of the interval.
    """
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
    """Return the torque [N m] of a chamber at the pressure p [Pa], for given lagged pressure and wall stretch.

    `slow` [Pa] is its lagged pressure, `y` the fourth power of its hoop stretch.
    """
    torque = swollen_torque(p, slow, chamber.swell_share, chamber.law, chamber.form)
    if chamber.inflation_limit.real > 0.0:
        return torque * lever_growth(y)
    return torque


def slow_rates(p, slow, y, chamber):
    """Return the rates of a chamber's two slow states at the pressure p [Pa]: lagged pressure [Pa/s] and fourth power
    of the hoop stretch [1/s].
    """
    growing = 0.0 * y
    if chamber.inflation_limit.real > 0.0:
        growing, _ = wall_rate(p, y, chamber)
    return (p - slow) / chamber.swell_time, growing


def advance(h, p, chamber, state):
    """Return the mean torque [N m] of a chamber over a pressure `Interval` p of h [s], and update its lagged pressure
    and wall stretch in place.

    `state` (2,) holds the lagged pressure [Pa] and the fourth power of the hoop stretch, and is changed in place. A
    chamber without lag and inflation leaves it unchanged.
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
    """Return the mean torque [N m] of chamber number c over a pressure `Interval` p of h [s], and update its lagged
    pressure and wall stretch.

    `actuation` is an `ActuationConstants`. Row c of `state` (C, 2) holds the slow states, which `advance` describes.
    """
    rubber = actuation.rubber
    chamber = ChamberConstants(
        actuation.law[c], rubber[c, 0], rubber[c, 1], rubber[c, 2], rubber[c, 3], rubber[c, 4], rubber[c, 5],
    )
    return advance(h, p, chamber, state[c])


def share_out(c, torque, gain, tau):
    """Add the torque [N m] of chamber c, times the gain of the chamber at each joint, to the joint torques tau (n,) [N
    m].

    tau_i = sum_c gain_ci torque_c

    Chamber 0 overwrites the previous content of tau.
    """
    for i in range(len(tau)):
        if c == 0:
            tau[i] = gain[c, i] * torque
        else:
            tau[i] = tau[i] + gain[c, i] * torque


def held_torques(h, pressure, actuation, state, tau):
    """Write the mean joint torques tau (n,) [N m] over h [s] at constant pressures `pressure` (C,) [Pa] of the C
    chambers. The torques still vary, because a chamber's lagged pressure and wall stretch follow its pressure slowly.

    These two slow states of each chamber, `state` (C, 2), are updated in place.
    """
    for c in range(len(pressure)):
        p = pressure[c]
        torques = advance_one(c, h, Interval(p, p, p, p), actuation, state)
        share_out(c, torques, actuation.gain, tau)
