"""A typical pressure, tension or motor angle of a model, derived from its stiffness alone."""

from __future__ import annotations

import numpy as np

from pliant.errors import SimulationError
from pliant.model import Model
from pliant.simulation import state

BENT = 0.5  # rad, sum of the joint angles from rest at the typical pressure
RANGES = {"Pa": (1e3, 1e7), "N": (1e-1, 1e3), "m": (1e-4, 1.0), "rad": (1e-2, 1e2)}  # start and end of the search


def typical_pressure(model: Model, which: int = 0) -> float:
    """Return the pressure [Pa] that bends the chain by half a radian, or 0.8 of its largest static pressure if less.

    A model does not store the range of its recordings; this is the default level of a pulse. The result is 0 if no
    pressure bends the model. Only input `which` acts, the first by default. For a tendon the result is a tension [N],
    displacement [m] or angle [rad].
    """
    try:
        rest = state.equilibrium(model, first_alone(model, 0.0))
    except SimulationError:
        return 0.0
    low, (high, highest) = 0.0, RANGES[model.actuation.units[which]]
    while (bend := bent(model, high, rest, which)) is not None and bend < BENT:
        low, high = high, 2.0 * high
        if high > highest:
            return 0.0
    held = bend is not None
    for _ in range(30):
        middle = 0.5 * (low + high)
        bend = bent(model, middle, rest, which)
        if bend is None or bend >= BENT:
            high, held = middle, bend is not None
        else:
            low = middle
    return float(f"{low if held else 0.8 * low:.2g}")


def first_alone(model: Model, pressure: float, which: int = 0) -> np.ndarray:
    """Return pressures (C,) [Pa]: `pressure` in one chamber, the first by default, and 0 in the others."""
    return np.asarray(pressure * np.eye(model.actuation.count)[which])


def bent(model: Model, pressure: float, rest: np.ndarray, which: int = 0) -> float | None:
    """Return the bend [rad] from the rest shape under a pressure; None if the chain has no equilibrium.

    In space it is the size of the bend in both directions.
    """
    try:
        q = state.equilibrium(model, first_alone(model, pressure, which)) - rest
    except SimulationError:
        return None
    return float(np.linalg.norm(q[: 2 * model.n].reshape(-1, 2).sum(axis=0)) if model.space else abs(q.sum()))
