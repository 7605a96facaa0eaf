"""Derivatives of a chain's accelerations by complex steps, for chains without analytic derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pliant.equations.symbols import Slopes

Array = np.ndarray
TINY = 1e-20  # imaginary step: its square vanishes beside 1


def complex_slopes(
    accelerate: Callable[[Array, Array, Any, Array], None], x: Array, v: Array, work: Any, out: Slopes
) -> None:
    """Write the accelerations (N,) of a chain and their derivatives by its N coordinates x and rates v to `out`, by
    complex steps.

    `work.A` keeps the factors of M.

    Parameters
    ----------
    accelerate : callable
        ``accelerate(x, v, work, a)`` writes the accelerations a (N,) of complex coordinates and rates.
    """
    scratch = type(work)(*(a.astype(complex) for a in work))
    moved = np.empty(x.size, dtype=complex)
    for by_rate, rows in enumerate((out.a_phi, out.a_w)):
        for k in range(x.size):
            position, rate = x.astype(complex), v.astype(complex)
            (rate if by_rate else position)[k] += 1j * TINY
            accelerate(position, rate, scratch, moved)
            rows[k], out.a[:] = moved.imag / TINY, moved.real
    work.A[:] = scratch.A.real
