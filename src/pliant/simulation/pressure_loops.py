"""Compiled loops over time intervals for the pressure behind valves, lagged pressure, and chamber torque.

The functions are plain Python; `pliant.compiler.choose.twin` compiles them.

Pressure of a chamber that fills and vents through an opening, in closed form: choked and subsonic flow (ISO 6358).

The absolute pressure P of a rigid chamber follows P' = (U / T) psi(P / U) while the command U lies above it, and P' =
-(P / T) psi(U / P) while it lies below, with psi(r) = 1 for r < b, else sqrt(1 - ((r - b) / (1 - b))^2), and b = 1/2. T
is volume over conductance and standard pressure, for gas of constant temperature. The pressure reaches the command in
finite time.

Source: ISO 6358-1:2013; b lies between 0.2 and 0.5 for most valves and tubes.

The functions are plain Python; `pliant.compiler.choose.twin` compiles them.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.chamber import advance, mean_of_law, slow_interval
from pliant.equations.symbols import Interval

UNLIMITED = 1e30  # Pa/s; not infinite, whose product with a lag of 0 is NaN


def past_dead_band(band, p):
    """Replace commands p (m, 4) [Pa] by those that a pressure regulator with a dead band [Pa] follows, in place.
    The columns of p are the values at start, middle and end of m intervals, and the mean.

    The result is exact except for intervals in which the command crosses the band.
    """
    for k in range(len(p)):
        for j in range(4):
            if p[k, j].real > band.real:
                p[k, j] = p[k, j] - band
            elif p[k, j].real < -band.real:
                p[k, j] = p[k, j] + band
            else:
                p[k, j] = 0.0 * p[k, j]


def first_order_valve(h, rise, fall, before, p):
    """Replace commanded pressures p (m, 4) [Pa] by those behind a valve with first-order lag, in place.
    The columns of p are the values at start, middle and end of m intervals, and the mean.

    The intervals have the lengths h (m,) [s]. The pressure starts at `before` [Pa]. `rise` and `fall` [s] are the time
    constants while the command lies above or below the pressure. The result is exact for a command that is linear in
    each interval.
    """
    for k in range(len(h)):
        p[k, 0], p[k, 1], p[k, 2], p[k, 3] = first_order_interval(h[k], p[k, 0], p[k, 2], rise, fall, before)
        before = p[k, 2]


def first_order_interval(h, u0, u1, rise, fall, p):
    """Return the pressure [Pa] behind a first-order valve at start, middle and end of an interval, and its mean.
    The command goes from u0 to u1 [Pa] in h [s].
    """
    command = 0.5 * (u0 + u1)
    lag = rise
    if command.real < p.real:
        lag = fall
    if lag.real == 0.0:
        return u0, command, u1, command
    slope = (u1 - u0) / h
    gap = p - u0 + lag * slope
    middle = command - lag * slope + gap * np.exp(-0.5 * h / lag)
    end = u1 - lag * slope + gap * np.exp(-h / lag)
    return p, middle, end, command + lag / h * (p - end)  # the mean from lag p' = u - p


def rate_limited_valve(h, lag, before, p):
    """Replace commanded pressures p (m, 4) [Pa] by those behind a valve with lag and limited rates, in place.
    The columns of p are the values at start, middle and end of m intervals, and the mean.

    `lag` is a `symbols.Lag`.
    """
    for k in range(len(h)):
        p[k, 0], p[k, 1], p[k, 2], p[k, 3] = rate_limited_interval(h[k], p[k, 0], p[k, 2], lag, before)
        before = p[k, 2]


def rate_limited_interval(h, u0, u1, valve, p):
    """Return the pressure [Pa] behind a rate-limited valve at start, middle and end of an interval, and its mean.
    The command goes from u0 to u1 [Pa] in h [s].
    """
    slope = (u1 - u0) / h
    lag = valve.rise
    rate = valve.rise_rate
    if (0.5 * (u0 + u1)).real < p.real:
        lag = valve.fall
        rate = -valve.fall_rate
    gap = u0 - p
    limited = 0.0  # time until the lag alone would be slower than the limit
    if ((gap - rate * lag) * rate).real > 0.0:
        limited = h
        if ((rate - slope) * rate).real > 0.0:
            limited = min(h, (gap - rate * lag) / (rate - slope))
    middle, area = limited_then_lagged(0.5 * h, limited, rate, lag, u0, slope, p)
    end, area = limited_then_lagged(h, limited, rate, lag, u0, slope, p)
    return p, middle, end, area / h


def limited_then_lagged(t, limited, rate, lag, u0, slope, p):
    """Return the pressure [Pa] behind a valve after t [s], and its integral over this time. For the first `limited` [s]
    the pressure changes at `rate` [Pa/s]. Afterwards it follows the command with a first-order lag.

    It starts at p [Pa].
    """
    first = min(t, limited)
    value = p + rate * first
    area = first * (p + 0.5 * rate * first)
    if t.real > limited.real:
        u = u0 + slope * limited
        _, _, after, mean = first_order_interval(t - limited, u, u0 + slope * t, lag, lag, value)
        value = after
        area = area + (t - limited) * mean
    return value, area


def held_interval(h, command, valve, p):
    """Return the pressure behind a valve at start, middle and end of h [s] under a constant `command` [Pa], and its
    mean.
    """
    if valve.rise_rate.real >= UNLIMITED and valve.fall_rate.real >= UNLIMITED:
        start, middle, end, mean = first_order_interval(h, command, command, valve.rise, valve.fall, p)
    else:
        start, middle, end, mean = rate_limited_interval(h, command, command, valve, p)
    return Interval(start, middle, end, mean)


def second_order_valve(h, omega, zeta, before, p):
    """Replace commanded pressures p (m, 4) [Pa] by those behind a second-order valve, in place.
    The columns of p are the values at start, middle and end of m intervals, and the mean.

    p'' + 2 zeta omega p' + omega^2 p = omega^2 u

    As `first_order_valve`, with natural frequency omega [rad/s] and damping ratio zeta. The rate at the start is 0.
    Exact for a command that is linear in each interval.
    """
    rate = 0.0 * before
    damped = zeta * zeta - 1.0
    for k in range(len(h)):
        u0 = p[k, 0]
        u1 = p[k, 2]
        slope = (u1 - u0) / h[k]
        offset = u0 - 2.0 * zeta / omega * slope  # the steady response is offset + slope t
        p[k, 0] = before
        first = rate
        x = before - offset
        v = rate - slope
        for j in range(1, 3):
            t = 0.5 * j * h[k]
            c = np.exp(-zeta * omega * t)  # c and s include the decay, without which they could overflow
            s = c * t
            if damped.real < -1e-9:
                root = omega * np.sqrt(-damped)
                s = c * np.sin(root * t) / root
                c = c * np.cos(root * t)
            elif damped.real > 1e-9:
                root = omega * np.sqrt(damped)
                slow = np.exp((root - zeta * omega) * t)
                fast = np.exp(-(root + zeta * omega) * t)
                c = 0.5 * (slow + fast)
                s = 0.5 * (slow - fast) / root
            p[k, j] = offset + slope * t + x * c + (v + zeta * omega * x) * s
            rate = slope + v * c - (omega * omega * x + zeta * omega * v) * s
        change = (rate - first) / omega + 2.0 * zeta * (p[k, 2] - before)
        p[k, 3] = 0.5 * (u0 + u1) - change / (omega * h[k])  # from the equation itself, integrated
        before = p[k, 2]


def settle(h, share, time, before, p):
    """Replace pressures p (m, 4) [Pa] by ones whose fraction `share` lags with the time constant `time` [s], in place.
    The columns of p are the values at start, middle and end of m intervals, and the mean.

    The lag starts in equilibrium at `before`. The result is exact for a pressure that is linear in each interval.
    """
    slow = before
    for k in range(len(h)):
        first = slow
        half, slow = slow_interval(h[k], Interval(p[k, 0], p[k, 1], p[k, 2], p[k, 3]), first, time)
        mean = p[k, 3] - time * (slow - first) / h[k]  # of the lagged pressure, from its equation
        p[k, 0] = p[k, 0] + share * (first - p[k, 0])
        p[k, 1] = p[k, 1] + share * (half - p[k, 1])
        p[k, 2] = p[k, 2] + share * (slow - p[k, 2])
        p[k, 3] = p[k, 3] + share * (mean - p[k, 3])


def law_torques(h, lengths, first, p, law, torque):
    """Write the mean torque of each time step to torque (steps,) [N m], by a polynomial law of the pressures p (m, 4)
    [Pa]. The columns of p are the values at start, middle and end of m intervals, and the mean.

    Step k of length h[k] [s] consists of the intervals first[k] ... first[k + 1] - 1, of `lengths` (m,) [s].
    """
    for k in range(len(h)):
        total = 0.0 * h[k]
        for j in range(first[k], first[k + 1]):
            total = total + lengths[j] * mean_of_law(Interval(p[j, 0], p[j, 1], p[j, 2], p[j, 3]), law)
        torque[k] = total / h[k]


def slow_torques(h, lengths, first, p, chamber, state, torque, grown):
    """Write the mean torque of each time step to torque (steps,) [N m], for a chamber with lagging pressure or wall.
    The columns of p (m, 4) [Pa] are the pressures at start, middle and end of m intervals, and the mean.

    The slow `state` (2,) is updated in place. grown (m + 1,) receives the fourth power of the hoop stretch between the
    intervals.
    """
    grown[0] = state[1]
    for k in range(len(h)):
        total = 0.0 * h[k]
        for j in range(first[k], first[k + 1]):
            chamber_torque = advance(lengths[j], Interval(p[j, 0], p[j, 1], p[j, 2], p[j, 3]), chamber, state)
            total = total + lengths[j] * chamber_torque
            grown[j + 1] = state[1]
        torque[k] = total / h[k]


ATMOSPHERE = 101325.0  # Pa
ARRIVED = 1e-12  # of the absolute command: within this distance the pressure has reached it
LEAST = 1.0  # Pa, smallest absolute command


def through_opening(h, time, before, p):
    """Replace pressures p (m, 4) [Pa gauge] upstream of an opening by those in the chamber behind it, in place.
    The columns of p are the values at start, middle and end of m intervals, and the mean.

    The intervals have the lengths h (m,) [s]. Only the mean of the pressure before the opening is used, so that the
    result is exact where it is constant in each interval. The chamber starts at `before` [Pa]. `time` is T [s].
    """
    for k in range(len(h)):
        command = p[k, 3]
        p[k, 0] = before + 0.0 * command
        p[k, 1], _ = opening_interval(0.5 * h[k], command, time, before)
        p[k, 2], p[k, 3] = opening_interval(h[k], command, time, before)
        before = p[k, 2]


def opening_interval(h, command, time, p):
    """Return the pressure [Pa gauge] of a chamber behind an opening after h [s] under a constant command, and its mean
    over this time. The chamber starts at p [Pa gauge].
    """
    supply = command + ATMOSPHERE
    if supply.real < LEAST:
        supply = LEAST + 0.0 * command
    level = supply - ATMOSPHERE
    near = ARRIVED * supply.real
    s = 2.0 * h / time
    if p.real < level.real - near:
        x, area = filled(s, 2.0 * (p + ATMOSPHERE) / supply - 1.0)
        return 0.5 * supply * (1.0 + x) - ATMOSPHERE, 0.5 * supply * (1.0 + area / s) - ATMOSPHERE
    if p.real > level.real + near:
        x, area = vented(s, (p - level) / supply)
        return level + supply * x, level + supply * area / s
    return level + 0.0 * p, level + 0.0 * p


def filled(s, x):
    """Return the normalised pressure x in a chamber after filling for the normalised time s, and the integral of x over
    s. The argument `x` is the initial value. The rate x' is 1 while x < 0, and then sqrt(1 - x^2) until x = 1.

    x = 2 P / U - 1, with the absolute pressures P in the chamber and U before the opening.
    """
    area = 0.0 * s
    if x.real < 0.0:
        choked = min(s, -x)
        area = choked * (x + 0.5 * choked)
        x = x + choked
        s = s - choked
    y = np.sqrt(1.0 - x * x)
    arrival = 2.0 * np.arctan(y / (1.0 + x))
    if s.real >= arrival.real:
        return 1.0 + 0.0 * x, area + y + s - arrival
    cos, sin = np.cos(s), np.sin(s)
    return x * cos + y * sin, area + y - y * cos + x * sin


def vented(s, x):
    """Return the normalised pressure x in a chamber after venting for the normalised time s, and the integral of x over
    s. The argument `x` is the initial value. The rate x' is -(1 + x) / 2 while x > 1, and then -sqrt(x) until x = 0.

    x = (P - U) / U, with the absolute pressures P in the chamber and U before the opening.
    """
    area = 0.0 * s
    if x.real > 1.0:
        choked = min(s, 2.0 * np.log(0.5 * (1.0 + x)))
        after = (1.0 + x) * np.exp(-0.5 * choked) - 1.0
        area = 2.0 * (x - after) - choked
        x = after
        s = s - choked
    w = np.sqrt(x)
    end = w - 0.5 * s
    if end.real <= 0.0:
        return 0.0 * x, area + 2.0 / 3.0 * w * w * w
    return end * end, area + 2.0 / 3.0 * (w * w * w - end * end * end)
