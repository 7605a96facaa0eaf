"""Reconstruct the continuous shape of a body from a chain of links by a spline through the link tips."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError
from pliant.numerics.spline import BOUNDARIES, CLAMPED, spline_matrix

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]


def spline_shape(
    tips: ArrayLike,
    node_arc_length: ArrayLike,
    arc_length: ArrayLike,
    *,
    boundary: str = CLAMPED,
    base: ArrayLike = (0.0, 0.0),
    base_tangent: ArrayLike = (0.0, 1.0),
) -> Array:
    """Reconstruct a continuous shape from a chain of links: return P points (T, P, d) [m] on the cubic spline through
    the base and the link tips, in T frames and d dimensions.

    Parameters
    ----------
    tips : (T, n, d) array, m
        Positions of the link tips.
    node_arc_length : (n + 1,) array, m
        Arc lengths of base and tips.
    arc_length : (P,) array, m
        Arc lengths at which the shape is evaluated.
    boundary : {"natural", "not-a-knot", "clamped+not-a-knot"}
        End conditions of the spline.
    base : (d,) array, m
    base_tangent : (d,) or (T, d) array
        Unit tangent at the base; used when the base is clamped.

    Returns
    -------
    (T, P, d) array, m

    Raises
    ------
    InputError
        When the array shapes do not match, the boundary is unknown, or there is only one link.

    Notes
    -----
    Paper: Sec. III-A, the solid line of Fig. 5 [fig:matchCurve]
    """
    tip = np.asarray(tips, dtype=np.float64)
    knots = np.asarray(node_arc_length, dtype=np.float64)
    if tip.ndim != 3 or knots.shape != (tip.shape[1] + 1,):
        raise InputError(f"tips (T, n, d) need n + 1 node arc lengths, but their shapes are {tip.shape}, {knots.shape}")
    if knots.size < 3:
        raise InputError(f"a spline needs at least two links, got {knots.size - 1}: compute more links")
    if boundary not in BOUNDARIES:
        raise InputError(f"boundary must be one of {', '.join(BOUNDARIES)}, not {boundary!r}")
    first = np.broadcast_to(np.asarray(base, dtype=np.float64), (len(tip), 1, tip.shape[2]))
    matrix, slope = spline_matrix(knots, np.asarray(arc_length, dtype=np.float64), boundary)
    tangent = np.broadcast_to(np.asarray(base_tangent, dtype=np.float64), (len(tip), tip.shape[2]))
    return np.matmul(matrix, np.concatenate((first, tip), axis=1)) + slope[:, None] * tangent[:, None, :]
