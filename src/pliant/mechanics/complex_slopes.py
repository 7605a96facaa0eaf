"""Derivatives of a chain's accelerations by complex steps, for chains without analytic derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pliant.equations.symbols import Slopes

Array = np.ndarray
TINY = 1e-20  # imaginary step: its square vanishes beside 1


def complex_slopes(
    accelerate: Callable[..., None], x: Array, v: Array, torque: Array, body: Any, joints: Any, work: Any, out: Slopes,
) -> None:
    """Write the accelerations (N,) of a chain and their derivatives by its N coordinates x and rates v to `out`, by
    complex steps.

    `accelerate` is the result of `Mechanics.acceleration`. `motion.acceleration_jacobian` does the same for a planar
    chain of constant length. `work.A` keeps the factors of M.
    """
    arguments = [of_kind(value, complex) for value in (torque, body, joints)]
    scratch = type(work)(*(a.astype(complex) for a in work))
    moved = np.empty(x.size, dtype=complex)
    for by_rate, rows in enumerate((out.a_phi, out.a_w)):
        for k in range(x.size):
            position, rate = x.astype(complex), v.astype(complex)
            (rate if by_rate else position)[k] += 1j * TINY
            accelerate(position, rate, *arguments, scratch, moved)
            rows[k], out.a[:] = moved.imag / TINY, moved.real
    work.A[:] = scratch.A.real


def of_kind(value: Any, kind: type) -> Any:
    """Return a copy of a number, array or tuple of these, converted to the number type `kind` (float or complex)."""
    if isinstance(value, tuple):
        return type(value)(*(of_kind(entry, kind) for entry in value))
    return np.array(value, dtype=kind) if isinstance(value, np.ndarray) else kind(value)
