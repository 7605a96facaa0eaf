"""Static chamber and joint torques for a time series of pressures."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.model.actuation import Actuation

Array = np.ndarray


def torques_over(actuation: Actuation, pressure: Any) -> Array:
    """Return the static torques (T, C) [N m] of C chambers for gauge pressures (T, C) [Pa] at T instants.

    Raises
    ------
    InputError
        When the number of columns is not the number of chambers.
    """
    p = np.asarray(pressure, dtype=float)
    p = p[:, None] if p.ndim == 1 else p
    if p.ndim != 2 or p.shape[1] != actuation.count:
        word = "pressures" if actuation.variable == "pressure" else "inputs"
        raise InputError(f"expected {word} (T, {actuation.count}): {actuation.wanted}, got shape {p.shape}")
    return np.stack([np.asarray(c.torque_at(p[:, k])) for k, c in enumerate(actuation.inputs)], axis=1)


def joint_torques_over(actuation: Actuation, pressure: Any) -> Array:
    """Return the static torques (T, n) [N m] at n joints for gauge pressures (T, C) [Pa] of C
    chambers at T instants.
    """
    return np.asarray(torques_over(actuation, pressure) @ actuation.gain)
