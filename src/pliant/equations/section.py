"""The cross-section: bladder area, lever arm, and the torque that pressure makes. Sec. III-C."""

from __future__ import annotations

import numpy as np


def bladder_area(r2):
    """Area of the half-round chamber of inner radius r2 [m], m^2.

    A = pi r2^2 / 2

    The paper calls it the cross-section area of the actuator; the formula is that of the chamber.  # D6
    Paper: Sec. III-C
    """
    return 0.5 * np.pi * r2 * r2


def lever_arm(r2):
    """Distance of the chamber's centroid from its flat face, m.

    d = 4 r2 / (3 pi)

    Paper: Sec. III-C
    """
    return 4.0 * r2 / (3.0 * np.pi)


def torque(p, a):
    """Torque on every joint at gauge pressure p [Pa], N m.

    tau = a_1 p + a_2 p^2 + ... with a = (a_1, a_2, ...) in N m/Pa^k. The paper's law tau = p A d is a = (A d,).
    Every joint feels the same torque: the flat face does not stretch, so V(q) = A L + A d sum(q) and p dV/dq_i = p A d.

    Paper: Sec. III-C
    """
    value = 0.0 * p
    for k in range(len(a) - 1, -1, -1):
        value = (value + a[k]) * p
    return value


def secant(p0, p1, a):
    """Slope of the torque law's secant between the pressures p0 and p1 [Pa], N m/Pa, also where they are equal.

    (tau(p1) - tau(p0)) / (p1 - p0) = sum_k a_k (p0^{k-1} + p0^{k-2} p1 + ... + p1^{k-1})
    """
    value = 0.0 * p0
    ratio = 1.0 + 0.0 * p0
    power = ratio
    for k in range(len(a)):
        value = value + a[k] * ratio
        power = power * p0
        ratio = ratio * p1 + power
    return value


def mean_torque(start, middle, end, mean, a):
    """Mean torque of an interval from the pressure [Pa] at its start, middle and end, and its mean; N m.

    Simpson's rule on the torque law a; what that rule misses of the mean pressure, where a valve settles within the
    interval, enters by the slope of the law's secant. Exact for a linear law.
    """
    simpson = (torque(start, a) + 4.0 * torque(middle, a) + torque(end, a)) / 6.0
    return simpson + (mean - (start + 4.0 * middle + end) / 6.0) * secant(start, end, a)


def swollen_torque(p, slow, share, a):
    """Torque at the pressure p of a chamber that swells: its lever grows with a pressure that lags behind; N m.

    tau = p (a_1 + a_2 s + a_3 s^2 + ...),  s = p + share (slow - p)

    At rest, where slow = p, and at share = 0 it is `torque`. Without pressure there is no torque, however swollen the
    chamber still is.
    """
    swell = p + share * (slow - p)
    value = 0.0 * p
    for k in range(len(a) - 1, 0, -1):
        value = (value + a[k]) * swell
    return (value + a[0]) * p


def slow_interval(h, start, end, mean, slow, time):
    """Slow pressure at the middle and the end of an interval of length h [s]: time slow' = p - slow; Pa.

    Exact for a pressure that runs straight from `start` to `end`; one that bends in between is taken as a straight
    line of the same `mean` and the same rise.
    """
    first = mean - 0.5 * (end - start)
    rise = end - start
    x = h / time
    late = -np.expm1(-0.5 * x) / (0.5 * x)  # mean of the decay over half the interval
    middle = np.exp(-0.5 * x) * slow + 0.5 * x * late * first + 0.5 * (1.0 - late) * rise
    late = -np.expm1(-x) / x
    last = np.exp(-x) * slow + x * late * first + (1.0 - late) * rise
    return middle, last


def mean_swollen_torque(start, middle, end, mean, slow0, slow1, slow2, share, a):
    """Mean of `swollen_torque` over an interval: as `mean_torque`, with the slow pressure at its three times; N m."""
    simpson = (
        swollen_torque(start, slow0, share, a)
        + 4.0 * swollen_torque(middle, slow1, share, a)
        + swollen_torque(end, slow2, share, a)
    ) / 6.0
    slope = swollen_slope(start, end, slow1, share, a)
    return simpson + (mean - (start + 4.0 * middle + end) / 6.0) * slope


def swollen_slope(start, end, slow, share, a):
    """Slope of the chord of `swollen_torque` between two pressures [Pa], the slow one held; N m/Pa."""
    s0 = start + share * (slow - start)
    s1 = end + share * (slow - end)
    lever = 0.0 * end
    for k in range(len(a) - 1, -1, -1):
        lever = lever * s1 + a[k]
    return lever + start * (1.0 - share) * secant(s0, s1, a[1:])


def inflated_interval(h, middle, end, mean, y, limit, time):
    """Fourth power y of a chamber's hoop stretch at the middle and the end of an interval of length h [s].

    time y' = 1 - (1 - p / limit) y

    A thin neo-Hookean tube of viscous rubber whose length fibres hold: p = limit (1 - stretch^-4) at rest, limit [Pa]
    being shear modulus times wall over radius. It grows without end at the limit, and ever more slowly towards it.
    From the pressure [Pa] at the middle and end of the interval and its mean; exact where the pressure is constant.

    Source: Rivlin (1949) for the tube; the rate is work done by p less work stored, taken by the wall's viscosity.
    """
    half = 0.5 * h
    first = 2.0 * mean - 0.5 * (middle + end)
    return inflated(half, first, y, limit, time), inflated(h, mean, y, limit, time)


def inflated(h, p, y, limit, time):
    """Fourth power of the hoop stretch after h [s] at the pressure p [Pa]; see `inflated_interval`."""
    x = (1.0 - p / limit) * h / time
    late = 1.0 - 0.5 * x  # mean of the decay: its series where the difference below would lose its digits
    if abs(x) > 1e-8:
        late = -np.expm1(-x) / x
    return np.exp(-x) * y + h / time * late


def lever_growth(y):
    """Factor stretch^3 on the torque: V = A L + A d sum(q) and A d = 2/3 r2^3 grows with the cube of the radius.

    Paper: Sec. III-C, with a radius that gives way
    """
    return y**0.75


def mean_inflated_torque(start, middle, end, mean, slow0, slow1, slow2, y0, y1, y2, share, a):
    """Mean of `swollen_torque` times `lever_growth` over an interval, y given at its three times as slow is; N m."""
    simpson = (
        lever_growth(y0) * swollen_torque(start, slow0, share, a)
        + 4.0 * lever_growth(y1) * swollen_torque(middle, slow1, share, a)
        + lever_growth(y2) * swollen_torque(end, slow2, share, a)
    ) / 6.0
    slope = lever_growth(y1) * swollen_slope(start, end, slow1, share, a)
    return simpson + (mean - (start + 4.0 * middle + end) / 6.0) * slope
