"""A torque that levels off with the pressure, as of a chamber whose reinforcement takes over.

tau = a p / sqrt(1 + (p / p0)^2)

Two numbers: a [N m/Pa], the paper's A d at low pressure, and p0 [Pa], beyond which the torque tends to a p0. Outside
the pressures of a fit it stays bounded, where a polynomial does not.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.law import LawParameter, TorqueLaw


def saturating_lever(p, a):
    """Torque for each pascal [N m/Pa] at the pressure p [Pa]; a = (A d [N m/Pa], p0 [Pa])."""
    share = p / a[1]
    return a[0] / np.sqrt(1.0 + share * share)


def start(pressure, torque):
    """From pressures [Pa] and torques [N m] at rest: (p / tau)^2 = 1 / a^2 + (p / (a p0))^2 is a straight line."""
    pushed = (pressure > 0) & (torque > 0)
    p, ratio = pressure[pushed], (pressure[pushed] / torque[pushed]) ** 2
    slope, first = np.polyfit(p**2, ratio, 1) if np.unique(p).size > 1 else (0.0, float(np.mean(ratio)))
    if first <= 0 or slope <= 0:  # it does not level off
        return {"lever": float(np.mean(1.0 / np.sqrt(ratio))), "level": 3.0 * float(np.max(p))}
    return {"lever": float(1.0 / np.sqrt(first)), "level": float(np.sqrt(first / slope))}


TORQUE_LAW = TorqueLaw(
    "saturating",
    {
        "lever": LawParameter("N m/Pa", 0.0, np.inf, 0.0, "A d of a chamber at low pressure whose torque levels off"),
        "level": LawParameter("Pa", 1e3, 1e8, 1e5, "pressure from which on it levels off"),
    },
    None, start, "lever", saturating_lever,
)
