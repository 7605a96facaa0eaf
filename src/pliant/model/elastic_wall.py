"""A chamber whose wall expands at once, in proportion to the pressure: its lever grows with the cube of its radius.

tau = a p (1 + c p)^3

Two numbers: a = A d at rest [N m/Pa] and c, the strain of the radius for each pascal. The bladder's A d = 2/3 r2^3
(Sec. III-C) with r2 (1 + c p). A neo-Hookean tube (`equations.chamber.inflated`) begins so, with c = 1 / (4 limit).
"""

from __future__ import annotations

import numpy as np

from pliant.equations.law import LawParameter, TorqueLaw

Array = np.ndarray


def coefficients(lever: float, compliance: float) -> Array:
    """Coefficients (4,) [N m/Pa^i] of a p (1 + c p)^3."""
    return lever * np.array([1.0, 3.0 * compliance, 3.0 * compliance**2, compliance**3])


def start(pressure: Array, torque: Array) -> dict[str, float]:
    """From pressures [Pa] and torques [N m] at rest: a straight line through the cube roots of torque over pressure."""
    pushed = pressure > 0
    root = np.cbrt(torque[pushed] / pressure[pushed])
    if np.unique(pressure[pushed]).size < 2:
        return {"lever": float(np.mean(root) ** 3), "compliance": 0.0}
    slope, first = np.polyfit(pressure[pushed], root, 1)
    return {"lever": float(first**3), "compliance": float(slope / first)}


TORQUE_LAW = TorqueLaw(
    "elastic_wall",
    {
        "lever": LawParameter("N m/Pa", 0.0, np.inf, 0.0, "A d of a chamber at rest whose radius grows with pressure"),
        "compliance": LawParameter("1/Pa", 0.0, 1e-4, 1e-7, "strain of its radius for each pascal"),
    },
    coefficients, start, scale="lever",
)
