"""Reconstruct the continuous shape of a body from a chain of links: a spline through the link tips, or a curve of
continuous curvature.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError
from pliant.numerics.curve import tangents
from pliant.numerics.spline import BOUNDARIES, CLAMPED, spline_matrix

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

GAUSS_POINTS = 4
PIECES = 4  # least number of quadrature intervals per segment


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


def curvature_profile(turns: ArrayLike, node_arc_length: ArrayLike, arc_length: ArrayLike) -> Array:
    """Return the curvature (T, P) [1/m] at P arc lengths of a continuous curve that follows a planar chain of n links
    over T frames. `turns` (T, n) [rad] is the angle of each link to the previous one: joint angle q plus rest angle
    theta_0.

    The tangent angle phi(s) is the quadratic spline whose mean over segment i is the chord angle
    alpha_i = sum_{k<=i} turns_k, with phi(0) = 0: the derivative of the clamped cubic spline through
    int phi ds = sum h_i alpha_i. A circle is reproduced exactly, whatever the segments.
    """
    return _angle_spline(turns, node_arc_length, np.asarray(arc_length, dtype=np.float64), 2)


def curvature_shape(
    turns: ArrayLike, node_arc_length: ArrayLike, arc_length: ArrayLike, *, base: ArrayLike = (0.0, 0.0)
) -> Array:
    """Reconstruct a continuous planar shape from a chain of links: return P points (T, P, 2) [m] over T frames of a
    curve with continuous curvature that leaves the base along +y.

    The length is exact by construction. The curve passes near the link tips, not through them.

    Parameters
    ----------
    turns : (T, n) array, rad
        Angle of each link to the previous one: q + theta_0.
    node_arc_length : (n + 1,) array, m
    arc_length : (P,) array, m
        Arc lengths at which the shape is evaluated, from 0 on.
    base : (2,) array, m
    """
    at = np.asarray(arc_length, dtype=np.float64)
    knots = np.asarray(node_arc_length, dtype=np.float64)
    if at.size and (at.min() < knots[0] or at.max() > knots[-1] * (1 + 1e-9)):
        raise InputError(f"arc_length must be between {knots[0]:g} and {knots[-1]:g} m")
    fine = np.concatenate([np.linspace(a, b, PIECES + 1) for a, b in pairwise(knots)])
    grid = np.unique(np.concatenate((fine, at)))
    x, w = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    half = np.diff(grid) / 2
    gauss = (grid[:-1] + half)[:, None] + half[:, None] * x
    phi = _angle_spline(turns, knots, gauss.ravel(), 1).reshape(-1, *gauss.shape)
    step = tangents(phi) * w[:, None]
    points = np.zeros((len(phi), grid.size, 2))
    np.cumsum(step.sum(axis=2) * half[:, None], axis=1, out=points[:, 1:])
    return points[:, np.searchsorted(grid, at)] + np.asarray(base, dtype=np.float64)


def _angle_spline(turns: ArrayLike, node_arc_length: ArrayLike, at: Array, derivative: int) -> Array:
    turn = np.asarray(turns, dtype=np.float64)
    knots = np.asarray(node_arc_length, dtype=np.float64)
    if turn.ndim != 2 or knots.shape != (turn.shape[1] + 1,):
        raise InputError(f"turns (T, n) need n + 1 node arc lengths, but their shapes are {turn.shape}, {knots.shape}")
    area = np.zeros((len(turn), knots.size))
    np.cumsum(np.cumsum(turn, axis=1) * np.diff(knots), axis=1, out=area[:, 1:])
    if knots.size == 2:  # one link: a circular arc, phi = 2 alpha s / h
        rate = 2 * turn / (knots[1] - knots[0])
        return rate * (at - knots[0]) if derivative == 1 else np.repeat(rate, at.size, axis=1)
    matrix, _ = spline_matrix(knots, at, CLAMPED, derivative)
    return area @ matrix.T
