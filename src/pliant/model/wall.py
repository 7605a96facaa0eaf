"""Equilibrium of a chamber's hyperelastic wall."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.equations import chamber, symbols

Array = np.ndarray


def rest_growth(pressure: Array, limit: Any, jm: Any = 0.0) -> Array:
    """Return the fourth power of the wall's hoop stretch in equilibrium at `pressure` [Pa]. `limit` [Pa] is the
    chamber's `inflation_limit`; where it is 0, the wall is rigid and the result 1.

    With Gent's rubber (`jm` > 0) it is finite at every pressure. Otherwise it is infinite from the limit on.
    """
    push, jm = np.broadcast_arrays(pressure / np.where(limit, limit, np.inf), jm)
    y = np.where(push < 1.0, 1.0 / np.where(push < 1.0, 1.0 - push, 1.0), np.inf)
    for at in map(tuple, np.argwhere(jm)):
        y[at] = rest_of_gent(float(push[at]), float(jm[at]))
    return y


def rest_of_gent(push: float, jm: float) -> float:
    """Return the fourth power of a Gent wall's hoop stretch in equilibrium. `push` is the pressure divided by the
    chamber's `inflation_limit`.
    """
    wall = symbols.ChamberConstants(np.zeros(1), 0.0, 1.0, 1.0, 1.0, jm, 0.0)
    y = 1.0 / (1.0 - push) if push < 0.5 else (jm * (1.0 + 0.02 * push) + 4.0) ** 2  # beyond the equilibrium
    for _ in range(100):  # from beyond the equilibrium Newton converges monotonically: the rate is concave in y
        rate, slope = chamber.wall_rate(push, y, wall)
        y -= rate / slope
        if abs(rate) <= 1e-14 * abs(slope) * y:
            break
    return float(y)
