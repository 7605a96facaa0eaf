"""Inputs: pressure behind the valves, and the mean torque of chambers over a time step under constant commands."""

from __future__ import annotations

import jax.numpy as jnp
from jax import lax

from pliant.equations.chamber import mean_inflated, mean_of_law, mean_swollen, slow_interval
from pliant.equations.laws import lever
from pliant.equations.symbols import ChamberConstants, Interval
from pliant.exporters.jax_source.structure import CHAMBERS, LIMITED


def behind_valves(p, h, command, pressure):
    """Return the pressures (C,) behind the valves at start, middle and end of a step of h [s], and their means."""
    falling = command < pressure
    lag = jnp.where(falling, p["fall_time"], p["rise_time"])
    lagged = lag > 0
    middle, end, mean = lagging(h, command, pressure, jnp.where(lagged, lag, 1.0))
    plain = [jnp.where(lagged, own, command) for own in (pressure, middle, end, mean)]
    if not LIMITED.any():
        return plain
    rate = jnp.where(falling, -p["fall_rate"], p["rise_rate"])
    gap = command - pressure
    above = (gap - rate * lag) * rate > 0
    limited = jnp.where(above, jnp.minimum(h, jnp.where(above, gap - rate * lag, 0.0) / rate), 0.0)
    middle, _ = limited_then_lagging(0.5 * h, limited, rate, lag, command, pressure)
    end, area = limited_then_lagging(h, limited, rate, lag, command, pressure)
    slow = (pressure, middle, end, area / h)
    return [jnp.where(LIMITED, a, b) for a, b in zip(slow, plain, strict=True)]


def lagging(h, command, pressure, lag):
    """Return the pressure behind a first-order valve at middle and end of h [s], and its mean."""
    gap = pressure - command
    middle = command + gap * jnp.exp(-0.5 * h / lag)
    end = command + gap * jnp.exp(-h / lag)
    return middle, end, command + lag / h * (pressure - end)


def limited_then_lagging(t, limited, rate, lag, command, pressure):
    """Return the pressure after t [s], at `rate` [Pa/s] for `limited` [s] and then lagging, and its integral."""
    first = jnp.minimum(t, limited)
    value = pressure + rate * first
    area = first * (pressure + 0.5 * rate * first)
    left, lagged = t > limited, lag > 0
    rest = jnp.where(left, t - limited, 1.0)
    _, end, mean = lagging(rest, command, value, jnp.where(lagged, lag, 1.0))
    end, mean = jnp.where(lagged, end, command), jnp.where(lagged, mean, command)
    return jnp.where(left, end, value), area + jnp.where(left, rest * mean, 0.0)


def wall_rate(p, y, wall, gent):
    """Return the rate of y, the fourth power of the hoop stretch of a viscous wall, and its derivative by y."""
    limit, time, jm = wall
    push = p / limit
    if not gent:
        return (1.0 - (1.0 - push) * y) / time, (push - 1.0) / time
    root = jnp.sqrt(y)
    left = 1.0 - (root + 1.0 / root - 2.0) / jm
    near = left > 0.1
    inverse = 1.0 / jnp.where(near, left, 1.0)
    factor = jnp.where(near, inverse, 20.0 - 100.0 * left)
    slope = jnp.where(near, inverse * inverse, 100.0) * 0.5 * (1.0 - 1.0 / y) / (root * jm)
    return (push * y - (y - 1.0) * factor) / time, (push - factor - (y - 1.0) * slope) / time


def inflated(h, p, y, wall, gent):
    """Return the fourth power of the hoop stretch after h [s] at a constant pressure."""
    rate, slope = wall_rate(p, y, wall, gent)
    x = -slope * h
    far = jnp.abs(x) > 1e-8
    large = jnp.where(far, x, 1.0)
    late = jnp.where(far, -jnp.expm1(-large) / large, 1.0 - 0.5 * x)
    return y + h * late * rate


def constants_of(p, at, form, rubber):
    """Return the constants of inputs of one kind, with the indices `at`; without rubber those of a rigid wall."""
    wall = [p[name][at] if rubber else 0.0 for name in ChamberConstants._fields[1:-1]]
    return ChamberConstants(p["torque"][at].T, *wall, form)


def chamber_torques(p, h, interval, slow):
    """Return the mean torques (C,) [N m] of all inputs over a step of h [s], and their slow states (C, 2) after it.

    `interval` are the pressures of `behind_valves`.
    """
    torque = jnp.zeros_like(interval[0])
    for rows, form, swells, inflates, gent in CHAMBERS:
        at = jnp.array(rows)
        own, kind = Interval(*(part[at] for part in interval)), constants_of(p, at, form, swells or inflates)
        if not (swells or inflates):
            mean = mean_of_law(own, kind.law) if form == 0 else mean_swollen(own, own[:3], kind)
            torque = torque.at[at].set(mean)
            continue
        before = slow[at, 0]
        half, last = slow_interval(h, own, before, kind.swell_time)
        slow, lagged = slow.at[at, 0].set(last), (before, half, last)
        if inflates:
            y, first, wall = slow[at, 1], 2.0 * own.mean - 0.5 * (own.middle + own.end), kind[3:6]
            middle, end = inflated(0.5 * h, first, y, wall, gent), inflated(h, own.mean, y, wall, gent)
            slow, mean = slow.at[at, 1].set(end), mean_inflated(own, lagged, (y, middle, end), kind)
        else:
            mean = mean_swollen(own, lagged, kind)
        torque = torque.at[at].set(mean)
    return torque, slow


def rest_torques(p, pressure):
    """Return the torques (C,) [N m] of all inputs in equilibrium at pressures (C,), and their slow states (C, 2)."""
    torque, stretch = jnp.zeros_like(pressure), jnp.ones_like(pressure)
    for rows, form, _, inflates, gent in CHAMBERS:
        at = jnp.array(rows)
        own = lever(pressure[at], p["torque"][at].T, form) * pressure[at]
        if inflates:
            push = pressure[at] / p["inflation_limit"][at]
            y = gent_rest(push, p["inflation_jm"][at]) if gent else 1.0 / (1.0 - push)
            stretch, own = stretch.at[at].set(y), own * y**0.75
        torque = torque.at[at].set(own)
    return torque, jnp.stack([pressure, stretch], axis=1)


def gent_rest(push, jm):
    """Return the fourth power of the hoop stretch of a Gent wall in equilibrium under push = pressure / limit."""

    def moved(y, push, jm):
        rate, slope = wall_rate(push, y, (1.0, 1.0, jm), gent=True)
        return y - rate / slope

    held, wall = lax.stop_gradient(push), lax.stop_gradient(jm)
    low = held < 0.5
    start = jnp.where(low, 1.0 / (1.0 - jnp.where(low, held, 0.0)), (wall * (1.0 + 0.02 * held) + 4.0) ** 2)
    y = lax.fori_loop(0, 100, lambda _, y: moved(y, held, wall), start)
    return moved(lax.stop_gradient(y), push, jm)  # one more move of Newton's method has the exact derivative
