"""Fixed-lag smoothing of a filtered recording: each state is improved by the frames that follow."""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError
from pliant.estimation.symbols import FilterOutput

Array = np.ndarray


def smooth(out: FilterOutput, lag: int) -> tuple[Array, Array]:
    """Return states (T, N) and covariances (T, N, N) of each frame, given all frames up to `lag` frames later.

    x_{k|k+L} = x_k + sum_{j=1..L} C_k ... C_{k+j-1} (x_{k+j} - x^-_{k+j}),  C_k = P_k F_{k+1}^T (P^-_{k+1})^{-1}

    With a lag as long as the recording this is the Rauch-Tung-Striebel smoother of the whole recording.

    Source: Rauch, Tung and Striebel (1965); Sarkka, Bayesian Filtering and Smoothing, Sec. 8.2

    Raises
    ------
    InputError
        When the lag is negative.
    """
    if lag < 0:
        raise InputError(f"the lag must be a number of frames, at least 0, got {lag}")
    x, P = out.estimate.copy(), out.covariance.copy()
    frames = x.shape[0]
    gain = gains(out)
    moved = out.estimate - out.predicted
    learnt = out.covariance - out.predicted_covariance
    product = np.broadcast_to(np.eye(x.shape[1]), P.shape).copy()
    for j in range(1, min(lag, frames - 1) + 1):
        product = product[: frames - j] @ gain[j - 1 :]
        x[: frames - j] += np.einsum("tab,tb->ta", product, moved[j:])
        P[: frames - j] += product @ learnt[j:] @ np.swapaxes(product, 1, 2)
    return x, 0.5 * (P + np.swapaxes(P, 1, 2))


def gains(out: FilterOutput) -> Array:
    """Return the smoothing gains C_k (T - 1, N, N) from each frame to the next.

    States with zero variance (known, and constant in the model) are scaled by 1 so that the division stays defined.
    """
    forward = out.transition[1:] @ out.covariance[:-1]  # F P, the transpose of P F^T
    ahead = out.predicted_covariance[1:]
    scale = np.sqrt(np.einsum("taa->ta", ahead))
    scale[scale == 0] = 1.0
    unit = ahead / scale[:, :, None] / scale[:, None, :]
    unit = unit + 1e-13 * np.eye(unit.shape[1])
    solved = np.linalg.solve(unit, forward / scale[:, :, None]) / scale[:, :, None]
    return np.asarray(np.swapaxes(solved, 1, 2))
