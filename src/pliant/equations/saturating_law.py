"""A torque law which saturates: the torque approaches a limit at high pressure.

tau = a p / sqrt(1 + (p / p0)^2)

It has two numbers: a [N m/Pa], the paper's A d at low pressure, and p0 [Pa], above which the torque tends to a p0. An
example is a chamber whose reinforcement carries most of the load at high pressure. Unlike a polynomial, the law stays
bounded outside the pressures of a fit.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.law import LawParameter, TorqueLaw


def saturating_lever(p, a):
    """Return the torque per unit pressure [N m/Pa] of the saturating law at the pressure p [Pa], for its two
    coefficients `a`.

    `a` is (A d [N m/Pa], p0 [Pa]).
    """
    share = p / a[1]
    return a[0] / np.sqrt(1.0 + share * share)


def start(pressure, torque):
    """Return starting values for a fit of the saturating law, from pressures (T,) [Pa] and static torques (T,) [N m].

    (p / tau)^2 = 1 / a^2 + (p / (a p0))^2 is fitted as a straight line in p^2.
    """
    pushed = (pressure > 0) & (torque > 0)
    p, ratio = pressure[pushed], (pressure[pushed] / torque[pushed]) ** 2
    slope, first = np.polyfit(p**2, ratio, 1) if np.unique(p).size > 1 else (0.0, float(np.mean(ratio)))
    if first <= 0 or slope <= 0:  # no saturation in these data
        return {"lever": float(np.mean(1.0 / np.sqrt(ratio))), "level": 3.0 * float(np.max(p))}
    return {"lever": float(1.0 / np.sqrt(first)), "level": float(np.sqrt(first / slope))}


TORQUE_LAW = TorqueLaw(
    "saturating",
    {
        "lever": LawParameter("N m/Pa", 0.0, np.inf, 0.0, "A d of a chamber with saturating torque, at low pressure"),
        "level": LawParameter("Pa", 1e3, 1e8, 1e5, "pressure above which the torque saturates"),
    },
    None, start, "lever", saturating_lever,
)
