"""How much pressure a model is made for, as far as the model itself says."""

from __future__ import annotations

import numpy as np

from pliant.errors import SimulationError
from pliant.model import Model
from pliant.simulation import state

BENT = 0.5  # rad, sum of the joint angles from rest at the typical pressure
HIGHEST = 1e7  # Pa, where the search ends


def typical_pressure(model: Model) -> float:
    """Pressure [Pa] that bends the chain at rest by half a radian, or 0.8 of what it holds where that is less.

    The model keeps no range of its recordings: this is the level of a pulse when none is given. 0 for a model that
    no pressure bends. Of several chambers: the first alone.
    """
    try:
        rest = float(state.equilibrium(model, first_alone(model, 0.0)).sum())
    except SimulationError:
        return 0.0
    low, high = 0.0, 1e3
    while (bend := bent(model, high, rest)) is not None and bend < BENT:
        low, high = high, 2.0 * high
        if high > HIGHEST:
            return 0.0
    held = bend is not None
    for _ in range(30):
        middle = 0.5 * (low + high)
        bend = bent(model, middle, rest)
        if bend is None or bend >= BENT:
            high, held = middle, bend is not None
        else:
            low = middle
    return float(f"{low if held else 0.8 * low:.2g}")


def first_alone(model: Model, pressure: float) -> np.ndarray:
    """Return pressures (C,) [Pa]: `pressure` in the first chamber and none in the others."""
    return np.asarray(pressure * np.eye(1, model.actuation.count)[0])


def bent(model: Model, pressure: float, rest: float) -> float | None:
    """Size of the bend from rest [rad]; None where the chain finds no rest."""
    try:
        return abs(float(state.equilibrium(model, first_alone(model, pressure)).sum()) - rest)
    except SimulationError:
        return None
