"""Torques at rest over a record of pressures."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.model.actuation import Actuation

Array = np.ndarray


def torques_over(actuation: Actuation, pressure: Any) -> Array:
    """Torque (T, C) of each chamber at rest at pressures (T, C), Pa; (T,) is enough for one. N m.

    Raises
    ------
    InputError
        When there are not as many as chambers.
    """
    p = np.asarray(pressure, dtype=float)
    p = p[:, None] if p.ndim == 1 else p
    if p.ndim != 2 or p.shape[1] != actuation.count:
        raise InputError(
            f"expected pressures (T, {actuation.count}) in Pa, one for each chamber ({actuation.listing}), got shape "
            f"{p.shape}"
        )
    return np.stack([np.asarray(c.torque_at(p[:, k])) for k, c in enumerate(actuation.inputs)], axis=1)


def joint_torques_over(actuation: Actuation, pressure: Any) -> Array:
    """Torques (T, n) [N m] of the joints at rest; pressures as `torques_over` takes them."""
    return np.asarray(torques_over(actuation, pressure) @ actuation.gain)
