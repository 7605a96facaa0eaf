"""Torque laws for one pressure: the polynomial law, and the registry of laws that have their own function.

A law with a kernel is one file, such as `saturating_law`. It is registered here twice: in `LAWS`, and in `lever` under
its number, which is its position in `LAWS` counted from 1. Chambers carry this number through every kernel as `form`.
"""

from __future__ import annotations

from pliant.equations import saturating_law
from pliant.equations.saturating_law import saturating_lever

LAWS = (saturating_law.TORQUE_LAW,)
POLYNOMIAL = "polynomial"
NUMBERS = {POLYNOMIAL: 0.0, **{law.name: k + 1.0 for k, law in enumerate(LAWS)}}  # `form` of each law by its name


def lever(p, a, form):
    """Return the torque per unit pressure [N m/Pa] at the pressure p [Pa], for the law number `form` with coefficients
    `a` (k,).

    `a` (k,) are the numbers of the law, `form` selects it (see `NUMBERS`). For the polynomial, form 0: a_1 + a_2 p +
    a_3 p^2 + ...
    """
    if form.real == 1.0:
        return saturating_lever(p, a)
    value = 0.0 * p
    for k in range(len(a) - 1, 0, -1):
        value = (value + a[k]) * p
    return value + a[0]


def secant(p0, p1, a, first):
    """Return the secant slope of the polynomial a[first] p + a[first + 1] p^2 + ... between the pressures p0 and p1
    [Pa].

    The pressures may be equal.

    (tau(p1) - tau(p0)) / (p1 - p0) = sum_k a_k (p0^{k-1} + p0^{k-2} p1 + ... + p1^{k-1})
    """
    value = 0.0 * p0
    ratio = 1.0 + 0.0 * p0
    power = ratio
    for k in range(first, len(a)):
        value = value + a[k] * ratio
        power = power * p0
        ratio = ratio * p1 + power
    return value


def lever_secant(p0, p1, a, form):
    """Return the secant slope [N m/Pa^2] of the torque per unit pressure between two pressures [Pa], which may be
    equal.

    `lever` gives the torque per unit pressure.

    For a law with a kernel of its own, the two points are moved slightly apart, so that equal pressures are no special
    case.
    """
    if form.real == 0.0:
        return secant(p0, p1, a, 1)
    middle = 0.5 * (p0 + p1)
    half = 0.5 * abs((p1 - p0).real) + 1e-4 * abs(middle.real) + 1e-9
    return (lever(middle + half, a, form) - lever(middle - half, a, form)) / (2.0 * half)


def law_torque(p, a, form):
    """Return the torque [N m] at the pressure p [Pa], for the torque law number `form` with coefficients `a` (k,)."""
    return lever(p, a, form) * p


def law_slope(p, a, form):
    """Return d(torque)/dp [N m/Pa] at the pressure p [Pa], for the torque law number `form` with
    coefficients `a` (k,).
    """
    return lever(p, a, form) + p * lever_secant(p, p, a, form)
