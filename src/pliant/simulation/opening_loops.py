"""Pressure of a chamber that fills and vents through an opening, in closed form: choked and subsonic flow (ISO 6358).

The absolute pressure P of a rigid chamber follows P' = (U / T) psi(P / U) while the command U lies above it, and P' =
-(P / T) psi(U / P) while it lies below, with psi(r) = 1 for r < b, else sqrt(1 - ((r - b) / (1 - b))^2), and b = 1/2. T
is volume over conductance and standard pressure, for gas of constant temperature. The pressure reaches the command in
finite time.

Source: ISO 6358-1:2013; b lies between 0.2 and 0.5 for most valves and tubes.

The functions are plain Python; `pliant.compiler.choose.twin` compiles them.
"""

from __future__ import annotations

import numpy as np

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
