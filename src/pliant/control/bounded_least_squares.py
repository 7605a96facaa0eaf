"""Solver of small least-squares problems with bounds on the unknowns."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def bounded_least_squares(
    H: Array, b: Array, start: Array, highest: float | Array, lowest: float | Array = 0.0
) -> Array:
    """Return the F unknowns x (F,) that minimise 1/2 x^T H x - b^T x between the bounds `lowest` and `highest`, by
    projected Newton steps.

    H (F, F) must be positive definite; `start` (F,) is the initial guess.

    Source: Bertsekas, SIAM J. Control Optim. 20(2), 1982
    """
    x = np.clip(start, lowest, highest)
    for _ in range(60):
        slope = H @ x - b
        free = ~(((x <= lowest) & (slope > 0)) | ((x >= highest) & (slope < 0)))
        if not free.any() or np.abs(slope[free]).max() <= 1e-9 * np.abs(b).max():
            break
        move = np.zeros_like(x)
        move[free] = -np.linalg.solve(H[np.ix_(free, free)], slope[free])
        length = 1.0
        while length > 1e-4:
            step = np.clip(x + length * move, lowest, highest) - x
            if slope @ step + 0.5 * step @ H @ step < 0.0:
                break
            length *= 0.5
        if (np.abs(step) <= 1e-6 * (highest - lowest)).all():
            return x + step
        x = x + step
    return x
