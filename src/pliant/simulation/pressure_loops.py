"""The loops between a command and what a chamber makes of it: valves and slow pressure, interval by interval.

Plain text here; `pliant.compiler.choose.twin` makes what runs.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.chamber import slow_interval
from pliant.equations.symbols import Interval

UNLIMITED = 1e30  # Pa/s; not infinite, whose product with no lag is not a number


def first_order_valve(h, u0, u1, rise, fall, p, out):
    """Pressure behind a first-order lag, exact for a command that is straight in each interval; Pa.

    Intervals of lengths h (m,) [s] with commands u0 at their start and u1 at their end; `rise` and `fall` are the
    time constants [s] while the command lies above or below the pressure. `p` is the pressure at the start; out (m, 4)
    takes it at the start, the middle and the end of each interval, and its mean.
    """
    for k in range(len(h)):
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = first_order_interval(h[k], u0[k], u1[k], rise, fall, p)
        p = out[k, 2]


def first_order_interval(h, u0, u1, rise, fall, p):
    """Pressure at the start, the middle and the end of one interval of `first_order_valve`, and its mean; Pa."""
    command = 0.5 * (u0 + u1)
    lag = rise
    if command < p:
        lag = fall
    if lag == 0.0:
        return u0, command, u1, command
    slope = (u1 - u0) / h
    gap = p - u0 + lag * slope
    middle = command - lag * slope + gap * np.exp(-0.5 * h / lag)
    end = u1 - lag * slope + gap * np.exp(-h / lag)
    return p, middle, end, command + lag / h * (p - end)  # the mean from lag p' = u - p


def rate_limited_valve(h, u0, u1, lag, p, out):
    """As `first_order_valve`, with the limits of a `symbols.Lag`."""
    for k in range(len(h)):
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = rate_limited_interval(h[k], u0[k], u1[k], lag, p)
        p = out[k, 2]


def rate_limited_interval(h, u0, u1, valve, p):
    """Pressure at the start, the middle and the end of one interval of `rate_limited_valve`, and its mean; Pa."""
    slope = (u1 - u0) / h
    lag = valve.rise
    rate = valve.rise_rate
    if 0.5 * (u0 + u1) < p:
        lag = valve.fall
        rate = -valve.fall_rate
    gap = u0 - p
    limited = 0.0  # how long the limit holds: until the gap is down to what the lag alone would make of it
    if (gap - rate * lag) * rate > 0.0:
        limited = h
        if (rate - slope) * rate > 0.0:
            limited = min(h, (gap - rate * lag) / (rate - slope))
    middle, area = limited_then_lagged(0.5 * h, limited, rate, lag, u0, slope, p)
    end, area = limited_then_lagged(h, limited, rate, lag, u0, slope, p)
    return p, middle, end, area / h


def limited_then_lagged(t, limited, rate, lag, u0, slope, p):
    """Pressure [Pa] at the time t [s] after p, and its integral, at a `rate` for the time `limited`, then lagging."""
    first = min(t, limited)
    value = p + rate * first
    area = first * (p + 0.5 * rate * first)
    if t > limited:
        u = u0 + slope * limited
        _, _, after, mean = first_order_interval(t - limited, u, u0 + slope * t, lag, lag, value)
        value = after
        area = area + (t - limited) * mean
    return value, area


def held_interval(h, command, valve, p):
    """`Interval` of pressure behind a valve (`symbols.Lag`) over h [s] under a `command` [Pa] held constant."""
    if valve.rise_rate >= UNLIMITED and valve.fall_rate >= UNLIMITED:
        start, middle, end, mean = first_order_interval(h, command, command, valve.rise, valve.fall, p)
    else:
        start, middle, end, mean = rate_limited_interval(h, command, command, valve, p)
    return Interval(start, middle, end, mean)


def second_order_valve(h, u0, u1, omega, zeta, p, out):
    """Pressure behind p'' + 2 zeta omega p' + omega^2 p = omega^2 u, exact for a command straight in each interval.

    As `first_order_valve`, with natural frequency omega [rad/s] and damping ratio zeta; starts at rest.
    """
    rate = 0.0
    damped = zeta * zeta - 1.0
    for k in range(len(h)):
        slope = (u1[k] - u0[k]) / h[k]
        offset = u0[k] - 2.0 * zeta / omega * slope  # the steady response is offset + slope t
        out[k, 0] = p
        before = rate
        x = p - offset
        v = rate - slope
        for j in range(1, 3):
            t = 0.5 * j * h[k]
            c = np.exp(-zeta * omega * t)  # the decay goes into c and s: apart they would overflow
            s = c * t
            if damped < -1e-9:
                root = omega * np.sqrt(-damped)
                s = c * np.sin(root * t) / root
                c = c * np.cos(root * t)
            elif damped > 1e-9:
                root = omega * np.sqrt(damped)
                slow = np.exp((root - zeta * omega) * t)
                fast = np.exp(-(root + zeta * omega) * t)
                c = 0.5 * (slow + fast)
                s = 0.5 * (slow - fast) / root
            out[k, j] = offset + slope * t + x * c + (v + zeta * omega * x) * s
            rate = slope + v * c - (omega * omega * x + zeta * omega * v) * s
        change = (rate - before) / omega + 2.0 * zeta * (out[k, 2] - p)
        out[k, 3] = 0.5 * (u0[k] + u1[k]) - change / (omega * h[k])  # from the equation itself, integrated
        p = out[k, 2]


def slow_pressure(h, behind, slow, time, out):
    """Slow pressure at the start, middle and end of each interval, out (m, 3) [Pa], from `behind` (m, 4) the valve.

    `slow` is its value at the start, `time` [s] its time constant; exact for a pressure straight in each interval.
    """
    for k in range(len(h)):
        p = Interval(behind[k, 0], behind[k, 1], behind[k, 2], behind[k, 3])
        out[k, 0] = slow
        out[k, 1], out[k, 2] = slow_interval(h[k], p, slow, time)
        slow = out[k, 2]
