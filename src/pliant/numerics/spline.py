"""Cubic splines and interpolation as matrices, which map values at fixed knots to values at other points.

One matrix therefore serves all frames and all coordinates of a recording.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

NATURAL = "natural"
NOT_A_KNOT = "not-a-knot"
CLAMPED = "clamped+not-a-knot"
BOUNDARIES = (NATURAL, NOT_A_KNOT, CLAMPED)


def spline_matrix(
    knots: ArrayLike, at: ArrayLike, boundary: str, derivative: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the matrix B (P, N) and the vector `slope` (P,) that evaluate a cubic spline at P points. The result is
    ``B @ values + slope * base_slope``, from the values at N knots and, if the base is clamped, the derivative
    `base_slope` at the first knot.

    Parameters
    ----------
    knots : (N,) array, m
        Strictly increasing; at least three.
    at : (P,) array, m
        Where the spline is evaluated.
    boundary : {"natural", "not-a-knot", "clamped+not-a-knot"}
        The last one prescribes the derivative with respect to the abscissa at the first knot, and is
        not-a-knot at the last.
    derivative : int
        Order of the derivative that the matrix returns.

    Returns
    -------
    B : (P, N) array
    slope : (P,) array
        Zero unless the base is clamped.

    Raises
    ------
    ValueError
        When the boundary is unknown, or there are too few knots.
    """
    from scipy.interpolate import CubicSpline

    x = np.asarray(knots, dtype=np.float64)
    if boundary not in BOUNDARIES:
        raise ValueError(f"boundary must be one of {', '.join(BOUNDARIES)}, not {boundary!r}")
    if x.size < 3:
        raise ValueError(f"a cubic spline needs at least 3 knots, got {x.size}")
    unit = np.eye(x.size + 1)
    condition: Any = ((1, unit[-1]), NOT_A_KNOT) if boundary == CLAMPED else boundary
    response = CubicSpline(x, unit[:-1], bc_type=condition)(np.asarray(at, dtype=np.float64), derivative)
    return np.ascontiguousarray(response[:, :-1]), response[:, -1].copy()


def local_cubic_matrix(stations: ArrayLike, at: ArrayLike) -> NDArray[np.float64]:
    """Return the matrix (P, S) that interpolates values at `stations` (S,) to points `at` (P,) by Lagrange cubics.

    Each row holds at most four weights, those of the stations around the point; a point that falls on a
    station takes its value exactly. At least four stations, strictly increasing.
    """
    x = np.asarray(stations, dtype=np.float64)
    p = np.asarray(at, dtype=np.float64)
    first = np.clip(np.searchsorted(x, p) - 2, 0, x.size - 4)
    matrix = np.zeros((p.size, x.size))
    for i, k in enumerate(first):
        local = x[k : k + 4]
        for j in range(4):
            others = np.delete(local, j)
            matrix[i, k + j] = np.prod((p[i] - others) / (local[j] - others))
    return matrix


def polynomial_slope_weights(x: ArrayLike, degree: int) -> NDArray[np.float64]:
    """Return weights (S,) for values measured at S points `x`. Their dot product with the values is the slope at
    ``x[0]`` of the polynomial of degree `degree` fitted to the values.
    """
    points = np.asarray(x, dtype=np.float64)
    span = points[-1] - points[0]
    vandermonde = np.vander((points - points[0]) / span, degree + 1, increasing=True)
    weights: NDArray[np.float64] = np.linalg.pinv(vandermonde)[1] / span
    return weights
