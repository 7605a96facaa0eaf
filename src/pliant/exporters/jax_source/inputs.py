"""Inputs: pressure behind the valves, and the mean torque of chambers over a time step under constant commands."""

from __future__ import annotations

import jax.numpy as jnp
from jax import lax

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


def saturating(p, a):
    """Return the torque per pascal of the saturating law at pressures p (k,), for coefficients a (k, 2)."""
    part = p / a[:, 1]
    return a[:, 0] / jnp.sqrt(1.0 + part * part)


def lever(p, a, form):
    """Return the torque per pascal of k chambers at pressures p (k,): polynomial (form 0) or saturating law (1)."""
    if form == 1:
        return saturating(p, a)
    value = 0.0 * p
    for k in range(a.shape[1] - 1, 0, -1):
        value = (value + a[:, k]) * p
    return value + a[:, 0]


def secant(p0, p1, a, first):
    """Return the secant slope of the polynomial a[first] p + a[first + 1] p^2 + ... between two pressures."""
    value, ratio, power = 0.0 * p0, 1.0 + 0.0 * p0, 1.0 + 0.0 * p0
    for k in range(first, a.shape[1]):
        value = value + a[:, k] * ratio
        power = power * p0
        ratio = ratio * p1 + power
    return value


def lever_secant(p0, p1, a, form):
    """Return the secant slope of the torque per pascal between two pressures, which may be equal."""
    if form == 0:
        return secant(p0, p1, a, 1)
    middle = 0.5 * (p0 + p1)
    half = lax.stop_gradient(0.5 * jnp.abs(p1 - p0) + 1e-4 * jnp.abs(middle) + 1e-9)
    return (lever(middle + half, a, form) - lever(middle - half, a, form)) / (2.0 * half)


def mean_of_law(p, a):
    """Return the mean torque of a polynomial law over an interval p: start, middle, end and mean pressure."""
    start, middle, end, mean = p
    simpson = (start * lever(start, a, 0) + 4.0 * middle * lever(middle, a, 0) + end * lever(end, a, 0)) / 6.0
    return simpson + (mean - (start + 4.0 * middle + end) / 6.0) * secant(start, end, a, 0)


def swollen(p, slow, share, a, form):
    """Return the torque of chambers whose lever arm follows the lagged pressure `slow`."""
    return lever(p + share * (slow - p), a, form) * p


def swollen_slope(start, end, slow, share, a, form):
    """Return the secant slope of `swollen` between two pressures, with the lagged pressure held."""
    s0, s1 = start + share * (slow - start), end + share * (slow - end)
    return lever(s1, a, form) + start * (1.0 - share) * lever_secant(s0, s1, a, form)


def mean_swollen(p, slow, growth, share, law):
    """Return the mean torque over an interval p, for three lagged pressures and three factors of inflation."""
    start, middle, end, mean = p
    torques = [g * swollen(pressure, s, share, *law) for pressure, s, g in zip(p[:3], slow, growth, strict=True)]
    slope = growth[1] * swollen_slope(start, end, slow[1], share, *law)
    simpson = (torques[0] + 4.0 * torques[1] + torques[2]) / 6.0
    return simpson + (mean - (start + 4.0 * middle + end) / 6.0) * slope


def slow_interval(h, p, slow, time):
    """Return the lagged pressure at middle and end of h [s], from its value `slow` at the start."""
    start, _, end, mean = p
    first, rise, x = mean - 0.5 * (end - start), end - start, h / time
    gone = -jnp.expm1(-0.5 * x)
    middle = slow + gone * (first - slow) + 0.5 * (1.0 - gone / (0.5 * x)) * rise
    gone = -jnp.expm1(-x)
    return middle, slow + gone * (first - slow) + (1.0 - gone / x) * rise


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


def chamber_torques(p, h, interval, slow):
    """Return the mean torques (C,) [N m] of all inputs over a step of h [s], and their slow states (C, 2) after it.

    `interval` are the pressures of `behind_valves`.
    """
    torque = jnp.zeros_like(interval[0])
    for rows, form, swells, inflates, gent in CHAMBERS:
        at = jnp.array(rows)
        own, law = [part[at] for part in interval], (p["torque"][at], form)
        if not (swells or inflates):
            mean = mean_of_law(own, law[0]) if form == 0 else mean_swollen(own, own[:3], (1.0, 1.0, 1.0), 0.0, law)
            torque = torque.at[at].set(mean)
            continue
        before = slow[at, 0]
        half, last = slow_interval(h, own, before, p["swell_time"][at])
        slow, growth = slow.at[at, 0].set(last), (1.0, 1.0, 1.0)
        if inflates:
            wall = [p[f"inflation_{name}"][at] for name in ("limit", "time", "jm")]
            y, first = slow[at, 1], 2.0 * own[3] - 0.5 * (own[1] + own[2])
            middle, end = inflated(0.5 * h, first, y, wall, gent), inflated(h, own[3], y, wall, gent)
            slow, growth = slow.at[at, 1].set(end), (y**0.75, middle**0.75, end**0.75)
        mean = mean_swollen(own, (before, half, last), growth, p["swell_share"][at], law)
        torque = torque.at[at].set(mean)
    return torque, slow


def rest_torques(p, pressure):
    """Return the torques (C,) [N m] of all inputs in equilibrium at pressures (C,), and their slow states (C, 2)."""
    torque, stretch = jnp.zeros_like(pressure), jnp.ones_like(pressure)
    for rows, form, _, inflates, gent in CHAMBERS:
        at = jnp.array(rows)
        own = lever(pressure[at], p["torque"][at], form) * pressure[at]
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
