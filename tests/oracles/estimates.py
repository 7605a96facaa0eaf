"""Measures of estimates, for tests of filters."""

from __future__ import annotations

import numpy as np


def nees(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the normalised squared error e^T P^-1 e of estimates, from errors (..., N) and covariances (..., N, N)."""
    return np.einsum("...a,...a->...", error, np.linalg.solve(covariance, error[..., None])[..., 0])
