"""Constants of the inertia of links, of one model or of many samples side by side."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.equations.inertia import body_constants

Array = np.ndarray


def inertia_constants(length: Array, mass: Array, tip_mass: Any, *, rod: bool) -> tuple[Array, Array, Array]:
    """Return B (n, n, ...), rotary inertias (n, ...) [kg m^2] and first moments h (n, ...) [kg m] of links.

    Parameters
    ----------
    length, mass : array (n, ...)
        m and kg; behind the links stand the samples of a batch.
    tip_mass : float or array (...)
        kg
    rod : bool
        Whether a link is a uniform rod; otherwise its mass sits at its tip.
    """
    n = len(length)
    B, h = np.empty((n, *length.shape)), np.empty(length.shape)
    body_constants(length, mass, length * (0.5 if rod else 1.0), tip_mass, B, h)
    return B, mass * length**2 / 12.0 * rod, h
