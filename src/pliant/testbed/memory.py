"""Material with hysteresis: the exact update of Prony branches over a step, and random slip thresholds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def prony_decay(time: NDArray[np.float64], dt: float) -> NDArray[np.float64]:
    """Return the coefficients of the exact update of ``xi' = (u - xi) / time`` over a step `dt`.

    The input `u` varies linearly from u0 to u1 over the step.

    Parameters
    ----------
    time : (P,) array, s
    dt : float, s

    Returns
    -------
    (P, 3) array
        ``xi1 = c0 xi0 + c1 u0 + c2 u1``.
    """
    x = dt / time
    keep = np.exp(-x)
    mean = -np.expm1(-x) / x
    return np.column_stack([keep, mean - keep, 1.0 - mean])


def slip_thresholds(vertices: int, elements: int, *, scale: float, shape: float, seed: int) -> NDArray[np.float64]:
    """Return the curvature changes [1/m] at which slip elements yield, as Weibull quantiles drawn for each vertex.

    The draws are stratified: element j of every vertex lies in the j-th of `elements` equal parts of the distribution.
    The whole body then shows a continuous spectrum of thresholds.

    Returns
    -------
    (vertices, elements) array
    """
    rng = np.random.default_rng([seed, 15])
    level = (np.arange(elements) + rng.uniform(0.02, 0.98, (vertices, elements))) / max(elements, 1)
    return np.asarray(scale * (-np.log1p(-level)) ** (1.0 / shape))
