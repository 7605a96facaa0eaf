"""Torque law of a chamber whose radius grows linearly with the pressure, so that its lever arm grows with the cube of
the radius.

tau = a p (1 + c p)^3

It has two parameters: a = A d at rest [N m/Pa], and c, the strain of the radius per pascal. The bladder's A d = 2/3
r2^3 (Sec. III-C) with r2 (1 + c p). At low pressure a neo-Hookean tube (`equations.chamber.inflated`) behaves like
this, with c = 1 / (4 limit).
"""

from __future__ import annotations

import numpy as np

from pliant.equations.law import LawParameter, TorqueLaw

Array = np.ndarray


def coefficients(lever: float, compliance: float) -> Array:
    """Return the four coefficients of p, p^2, p^3 and p^4 in the elastic-wall law of the torque, a p (1 + c p)^3, at
    pressure p. The coefficient of p^i is in N m/Pa^i.

    a is `lever` [N m/Pa], c is `compliance` [1/Pa].
    """
    return lever * np.array([1.0, 3.0 * compliance, 3.0 * compliance**2, compliance**3])


def start(pressure: Array, torque: Array) -> dict[str, float]:
    """Return starting values for a fit of the elastic-wall law, from T measured pressures (T,) [Pa] and static torques
    (T,) [N m].

    They follow from a straight line through the cube roots of torque over pressure.
    """
    pushed = pressure > 0
    root = np.cbrt(torque[pushed] / pressure[pushed])
    if np.unique(pressure[pushed]).size < 2:
        return {"lever": float(np.mean(root) ** 3), "compliance": 0.0}
    slope, first = np.polyfit(pressure[pushed], root, 1)
    return {"lever": float(first**3), "compliance": float(slope / first)}


TORQUE_LAW = TorqueLaw(
    "elastic_wall",
    {
        "lever": LawParameter("N m/Pa", 0.0, np.inf, 0.0, "A d at zero pressure, as the radius grows with pressure"),
        "compliance": LawParameter("1/Pa", 0.0, 1e-4, 1e-7, "strain of the chamber's radius per pascal"),
    },
    coefficients, start, scale="lever",
)
