"""The loops that run compiled: many steps of the chain, and the valve between its breakpoints.

Plain text here; `pliant.compiler.choose.twin` makes what runs.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.elastic import tangent
from pliant.equations.energy import damping_power, input_power
from pliant.equations.motion import step
from pliant.equations.section import mean_torque


def march(phi, w, base_angle, h, torque, keep, body, joints, work, phi_out, w_out, energy_out):
    """Take len(h) steps of lengths h [s] under mean torques `torque` [N m]; phi and w (n,) are advanced in place.

    The whole march is refused where a spring has softened to nothing, or a link turns by more than a radian in one
    step: the rule takes the turn of half a step as straight, and what it returned beyond would be finite and wrong.

    Where keep[k] >= 0, the state after step k goes to row keep[k] of phi_out and w_out (rows, n), with the input work
    and the dissipated energy so far [J] to energy_out (rows, 2), both by the midpoint rate that the step itself uses.
    Returns the index of the first step that fails, or -1.
    """
    n = len(phi)
    supplied = 0.0
    lost = 0.0
    for k in range(len(h)):
        step(phi, w, base_angle, h[k], torque[k], body, joints, work)
        for i in range(n):
            work.c[i] = w[i] - 0.5 * work.a[i]
        supplied = supplied + h[k] * input_power(work.c, joints, torque[k])
        lost = lost + h[k] * damping_power(work.c, joints)
        for i in range(n):
            if not (abs(w[i]) * h[k] <= 1.0 and tangent(i, phi, base_angle, joints) > 0.0):  # no number: false
                return k
        row = keep[k]
        if row >= 0:
            for i in range(n):
                phi_out[row, i] = phi[i]
                w_out[row, i] = w[i]
            energy_out[row, 0] = supplied
            energy_out[row, 1] = lost
    return -1


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


def rate_limited_valve(h, u0, u1, rise, fall, rise_rate, fall_rate, p, out):
    """As `first_order_valve`, with a pressure that rises and falls no faster than `rise_rate` and `fall_rate`, Pa/s."""
    for k in range(len(h)):
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = rate_limited_interval(
            h[k], u0[k], u1[k], rise, fall, rise_rate, fall_rate, p
        )
        p = out[k, 2]


def rate_limited_interval(h, u0, u1, rise, fall, rise_rate, fall_rate, p):
    """Pressure at the start, the middle and the end of one interval of `rate_limited_valve`, and its mean; Pa."""
    slope = (u1 - u0) / h
    lag = rise
    rate = rise_rate
    if 0.5 * (u0 + u1) < p:
        lag = fall
        rate = -fall_rate
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


def held_step(phi, w, base_angle, h, command, p, rise, fall, law, body, joints, work):
    """One step of `march` behind a first-order valve at the pressure p [Pa], under a `command` [Pa] held constant.

    Returns the pressure at the end of the step, not a number where the step failed.
    """
    start, middle, end, mean = first_order_interval(h, command, command, rise, fall, p)
    step(phi, w, base_angle, h, mean_torque(start, middle, end, mean, law), body, joints, work)
    for i in range(len(w)):
        if not (abs(w[i]) * h <= 1.0 and tangent(i, phi, base_angle, joints) > 0.0):
            return np.nan
    return end


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
