"""Is the filter as sure as it may be? Normalised errors and innovations against their chi-square bounds."""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError

Array = np.ndarray


def nees(error: Array, covariance: Array) -> Array:
    """Normalised estimation error squared (...,) of errors (..., N) with covariances (..., N, N)."""
    return np.asarray(np.einsum("...a,...a->...", error, np.linalg.solve(covariance, error[..., None])[..., 0]))


def mean_bounds(degrees: Array, level: float = 0.95) -> tuple[float, float]:
    """Bounds of the mean of independent chi-square numbers of these degrees of freedom, over their mean degree.

    A mean of normalised squares, divided by its mean degree, lies between them with probability `level` when the
    covariances are right: 1 is what it should be.
    """
    from scipy.special import gammaincinv  # as chi2.ppf does, without a third of a second for scipy.stats

    total = float(np.sum(degrees))
    if total <= 0:
        raise InputError("consistency needs at least one degree of freedom: no row of any frame was used")
    low, high = 2.0 * gammaincinv(0.5 * total, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
    return float(low) / total, float(high) / total


def whiteness(innovation: Array) -> tuple[float, float]:
    """Correlation of whitened innovations (T, m) with those of the frame before, and its bound at 95 %.

    White innovations lie within the bound; beyond it, the model errs in a way that lasts from frame to frame.
    """
    left, right = innovation[:-1], innovation[1:]
    both = np.isfinite(left) & np.isfinite(right)
    if both.sum() < 2:
        raise InputError("whiteness needs two frames in a row that are whole")
    power = 0.5 * float(np.sum(left[both] ** 2) + np.sum(right[both] ** 2))
    common = float(np.sum(left[both] * right[both]))
    return common / power if power else 0.0, 1.96 / float(np.sqrt(both.sum()))
