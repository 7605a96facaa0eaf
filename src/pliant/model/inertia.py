"""Inertia constants of a chain's links, for one model or for a batch of models."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.equations.inertia import body_constants

Array = np.ndarray


def inertia_constants(length: Array, mass: Array, tip_mass: Any, *, rod: bool) -> tuple[Array, Array, Array]:
    """Return the inertia constants of n links: coupling matrix B (n, n, ...) and rotary inertias (n, ...) [kg m^2], and
    first moments h (n, ...) [kg m]. The dots are the axes of a batch, if any.

    Parameters
    ----------
    length, mass : array (n, ...)
        Lengths [m] and masses [kg] of the links; further axes are samples of a batch.
    tip_mass : float or array (...)
        Mass at the last tip, kg.
    rod : bool
        Whether links are uniform rods; otherwise their masses are at their tips.
    """
    n = len(length)
    B, h = np.empty((n, *length.shape)), np.empty(length.shape)
    body_constants(length, mass, length * (0.5 if rod else 1.0), tip_mass, B, h)
    return B, mass * length**2 / 12.0 * rod, h
