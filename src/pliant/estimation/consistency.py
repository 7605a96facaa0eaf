"""Consistency of a Kalman filter: normalised errors and innovations against their chi-square bounds."""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError

Array = np.ndarray


def nees(error: Array, covariance: Array) -> Array:
    """Return the normalised estimation error squared (...,) of errors (..., N) with covariances (..., N, N)."""
    return np.asarray(np.einsum("...a,...a->...", error, np.linalg.solve(covariance, error[..., None])[..., 0]))


def mean_bounds(degrees: Array, level: float = 0.95) -> tuple[float, float]:
    """Return the bounds of the mean of independent chi-square numbers over their mean degree of freedom.

    A mean of normalised squares, divided by its mean degree, lies between the bounds with probability `level` if the
    covariances are right. Its expected value is 1.
    """
    from scipy.special import gammaincinv  # as chi2.ppf does, without a third of a second for scipy.stats

    total = float(np.sum(degrees))
    if total <= 0:
        raise InputError("consistency needs at least one used value, but no row of any frame was used")
    low, high = 2.0 * gammaincinv(0.5 * total, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
    return float(low) / total, float(high) / total


def whiteness(innovation: Array) -> tuple[float, float]:
    """Return the lag-one correlation of whitened innovations (T, m), and its 95 % bound.

    The correlation of white innovations lies within the bound. A larger one means a model error that persists from
    frame to frame.
    """
    left, right = innovation[:-1], innovation[1:]
    both = np.isfinite(left) & np.isfinite(right)
    if both.sum() < 2:
        raise InputError("whiteness needs two consecutive frames without missing values")
    power = 0.5 * float(np.sum(left[both] ** 2) + np.sum(right[both] ** 2))
    common = float(np.sum(left[both] * right[both]))
    return common / power if power else 0.0, 1.96 / float(np.sqrt(both.sum()))
