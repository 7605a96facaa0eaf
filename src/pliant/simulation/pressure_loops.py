"""The loops between a command and what a chamber makes of it: valves and slow pressure, interval by interval.

Plain text here; `pliant.compiler.choose.twin` makes what runs.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.chamber import advance, mean_of_law, slow_interval
from pliant.equations.symbols import Interval

UNLIMITED = 1e30  # Pa/s; not infinite, whose product with no lag is not a number


def past_dead_band(band, p):
    """Take the dead band [Pa] of a regulator off the commands p (m, 4) [Pa], in place.

    p holds the command at the start, middle and end of each interval, and its mean; exact but for intervals in which
    the command crosses the band.
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
    """Pressure behind a first-order lag, exact for a command that is straight in each interval; Pa.

    p (m, 4) holds the command at the start, the middle and the end of each interval of lengths h (m,) [s], and its
    mean; the pressure, which begins at `before`, takes its place. `rise` and `fall` are the time constants [s] while
    the command lies above or below the pressure.
    """
    for k in range(len(h)):
        p[k, 0], p[k, 1], p[k, 2], p[k, 3] = first_order_interval(h[k], p[k, 0], p[k, 2], rise, fall, before)
        before = p[k, 2]


def first_order_interval(h, u0, u1, rise, fall, p):
    """Pressure at the start, the middle and the end of one interval of `first_order_valve`, and its mean; Pa."""
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
    """As `first_order_valve`, with the limits of a `symbols.Lag`."""
    for k in range(len(h)):
        p[k, 0], p[k, 1], p[k, 2], p[k, 3] = rate_limited_interval(h[k], p[k, 0], p[k, 2], lag, before)
        before = p[k, 2]


def rate_limited_interval(h, u0, u1, valve, p):
    """Pressure at the start, the middle and the end of one interval of `rate_limited_valve`, and its mean; Pa."""
    slope = (u1 - u0) / h
    lag = valve.rise
    rate = valve.rise_rate
    if (0.5 * (u0 + u1)).real < p.real:
        lag = valve.fall
        rate = -valve.fall_rate
    gap = u0 - p
    limited = 0.0  # how long the limit holds: until the gap is down to what the lag alone would make of it
    if ((gap - rate * lag) * rate).real > 0.0:
        limited = h
        if ((rate - slope) * rate).real > 0.0:
            limited = min(h, (gap - rate * lag) / (rate - slope))
    middle, area = limited_then_lagged(0.5 * h, limited, rate, lag, u0, slope, p)
    end, area = limited_then_lagged(h, limited, rate, lag, u0, slope, p)
    return p, middle, end, area / h


def limited_then_lagged(t, limited, rate, lag, u0, slope, p):
    """Pressure [Pa] at the time t [s] after p, and its integral, at a `rate` for the time `limited`, then lagging."""
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
    """`Interval` of pressure behind a valve (`symbols.Lag`) over h [s] under a `command` [Pa] held constant."""
    if valve.rise_rate.real >= UNLIMITED and valve.fall_rate.real >= UNLIMITED:
        start, middle, end, mean = first_order_interval(h, command, command, valve.rise, valve.fall, p)
    else:
        start, middle, end, mean = rate_limited_interval(h, command, command, valve, p)
    return Interval(start, middle, end, mean)


def second_order_valve(h, omega, zeta, before, p):
    """Pressure behind p'' + 2 zeta omega p' + omega^2 p = omega^2 u, exact for a command straight in each interval.

    As `first_order_valve`, with natural frequency omega [rad/s] and damping ratio zeta; starts at rest.
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
            c = np.exp(-zeta * omega * t)  # the decay goes into c and s: apart they would overflow
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
    """Let a share of the pressures p (m, 4) [Pa] come late, in place, behind a further lag of a time constant [s].

    p holds them at the start, middle and end of each interval, and their mean; they were `before` long before. Exact
    for a pressure straight in each interval.
    """
    slow = before
    for k in range(len(h)):
        first = slow
        half, slow = slow_interval(h[k], Interval(p[k, 0], p[k, 1], p[k, 2], p[k, 3]), first, time)
        mean = p[k, 3] - time * (slow - first) / h[k]  # of the late one, from its own equation
        p[k, 0] = p[k, 0] + share * (first - p[k, 0])
        p[k, 1] = p[k, 1] + share * (half - p[k, 1])
        p[k, 2] = p[k, 2] + share * (slow - p[k, 2])
        p[k, 3] = p[k, 3] + share * (mean - p[k, 3])


def law_torques(h, lengths, first, p, law, torque):
    """Mean torque of each step, torque (steps,) [N m], of a law at the pressures p (m, 4) [Pa] of the intervals.

    Step k of length h[k] is made of the intervals from first[k] on, of lengths (m,) [s].
    """
    for k in range(len(h)):
        total = 0.0 * h[k]
        for j in range(first[k], first[k + 1]):
            total = total + lengths[j] * mean_of_law(Interval(p[j, 0], p[j, 1], p[j, 2], p[j, 3]), law)
        torque[k] = total / h[k]


def slow_torques(h, lengths, first, p, chamber, state, torque, grown):
    """As `law_torques`, of a chamber whose rubber takes time; its slow `state` (2,) moves on in place.

    grown (m + 1,) takes the fourth power of the hoop stretch between the intervals.
    """
    grown[0] = state[1]
    for k in range(len(h)):
        total = 0.0 * h[k]
        for j in range(first[k], first[k + 1]):
            made = advance(lengths[j], Interval(p[j, 0], p[j, 1], p[j, 2], p[j, 3]), chamber, state)
            total = total + lengths[j] * made
            grown[j + 1] = state[1]
        torque[k] = total / h[k]
