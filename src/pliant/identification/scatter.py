"""Scatter of fitted parameters between recordings, beyond what noise explains."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
FEWEST = 3  # recordings
POOLED = 4.0  # recordings by which the scatter of all parameters together counts in that of each


def scatter_between(scores: Array, inverse: Array, noise: Array) -> Array | None:
    """Return the covariance (P, P) of P parameters between recordings, beyond what noise explains; None for fewer than
    three recordings.

    The sandwich formula gives the covariance of the mean of K recordings from their scores J_k' r_k. Its ratio to the
    variance that noise explains is pooled between parameters, since few recordings determine it, and lessened by its
    own standard deviation under noise alone. The variance between recordings is K times the excess of the mean.

    Parameters
    ----------
    scores : array (K, P)
        J_k' r_k of each of K recordings, with the Jacobian J_k and the residuals r_k.
    inverse : array (P, P)
        Inverse of J' J of all recordings and priors.
    noise : array (P, P)
        Covariance of the parameters from correlated noise.
    """
    count = len(scores)
    if count < FEWEST:
        return None
    shares = ((scores - scores.mean(axis=0)) @ inverse) ** 2
    variance, explained = shares.sum(axis=0) * count / (count - 1), np.diag(noise)
    ratio = np.divide(variance, explained, out=np.ones_like(variance), where=explained > 0)
    pooled = ((count - 1) * ratio + POOLED * ratio.mean()) / (count - 1 + POOLED)
    excess = np.sqrt(np.maximum(pooled - 1.0 - np.sqrt(2.0 / (count - 1 + POOLED)), 0.0))
    return np.asarray(count * np.outer(excess, excess) * noise)
