"""The cubic spline through a few nodes on a body: its distance from the recorded body in every frame, and its points.

The arc length is common to all frames. Nodes and spline are therefore two fixed matrices, and the error of a frame
takes two small matrix products.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError
from pliant.numerics.spline import BOUNDARIES, CLAMPED, local_cubic_matrix, spline_matrix

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import ArrayLike, NDArray

    from pliant.reduction.body import BodyShape

    Array = NDArray[np.float64]

CHUNK_VALUES = 1 << 16  # working set of about 0.5 MB an array: stays in cache
GRID = 200  # least number of search points along the spline
NEWTON_STEPS = 4


@dataclass(frozen=True)
class SplineMap:
    """Matrices that map the positions of the stations in a frame to a few nodes on the body, and these nodes to the
    cubic spline through them.

    Attributes
    ----------
    knots : (n + 1,) array, m
        Arc lengths of the nodes.
    boundary : str
        End conditions of the spline.
    nodes : (n + 1, S) array
        Matrix from the stations to the nodes.
    spline : (S, n + 1) array
        Matrix from the nodes to the spline at the stations.
    slope : (S,) array
        Factor of the base tangent in the spline at the stations.
    """

    knots: Array
    boundary: str
    nodes: Array
    spline: Array
    slope: Array


def spline_map(arc_length: Array, knots: Array, boundary: str) -> SplineMap:
    """Return the matrices from the stations to nodes at the arc lengths `knots` [m], and from the nodes to the cubic
    spline through them.
    """
    spline, slope = spline_matrix(knots, arc_length, boundary)
    return SplineMap(knots, boundary, local_cubic_matrix(arc_length, knots), spline, slope)


def frame_errors(body: BodyShape, maps: Sequence[SplineMap], metric: str = "arc") -> tuple[Array, Array]:
    """Compute the largest and the mean distance (K, T) [m] over the stations between the body and a spline through a
    few nodes on it, for K choices of nodes and T frames.

    Parameters
    ----------
    body : BodyShape
    maps : K maps
    metric : {"arc", "closest"}
        Distance at equal arc length, or to the closest point of the spline.

    Returns
    -------
    largest, mean : (K, T) arrays, m
    """
    frames = len(body.time)
    largest, mean = np.empty((2, len(maps), frames))
    for rows, points in _chunks(body.position):
        for k, mapped in enumerate(maps):
            distance = _distances(mapped, points, body.tangent[rows], body.arc_length, metric)
            largest[k, rows] = distance.max(axis=1)
            mean[k, rows] = distance.mean(axis=1)
    return largest, mean


def _chunks(position: Array) -> Iterator[tuple[slice, Array]]:
    """Yield slices of frames and their points as (d, rows, S), so that the stations are the contiguous axis."""
    frames, stations, axes = position.shape
    step = max(1, CHUNK_VALUES // (stations * axes))
    for start in range(0, frames, step):
        rows = slice(start, min(start + step, frames))
        yield rows, np.ascontiguousarray(position[rows].transpose(2, 0, 1))


def _distances(one: SplineMap, points: Array, tangent: Array, arc_length: Array, metric: str) -> Array:
    """Return the distances (rows, S) [m] of the points from the spline."""
    axes, rows, stations = points.shape
    nodes = points.reshape(-1, stations) @ one.nodes.T
    difference = (nodes @ one.spline.T).reshape(axes, rows, stations)
    if one.boundary == CLAMPED:
        difference += tangent.T[:, :, None] * one.slope
    difference -= points
    np.square(difference, out=difference)
    distance = difference[0]
    for axis in range(1, axes):
        distance += difference[axis]
    np.sqrt(distance, out=distance)
    if metric == "closest":
        nodes = nodes.reshape(axes, rows, -1)
        return closest_distances(points, nodes, tangent, arc_length, one.knots, one.boundary, distance)
    return distance


def closest_distances(
    points: Array, nodes: Array, tangent: Array, arc_length: Array, knots: Array, boundary: str, distance: Array
) -> Array:
    """Return the distance (T, S) [m] from each of S stations to the closest point of a spline, in T frames. It is at
    most `distance` (T, S) [m], the distance to the spline's point of equal arc length.

    The search covers the part of the spline that can be closest to a station: within pi times its distance at equal arc
    length. A grid search finds the neighbourhood, and Newton's method on the local cubic finds the point.

    Parameters
    ----------
    points : (d, T, S) array, m
        Positions of the stations.
    nodes : (d, T, n + 1) array, m
        Positions of the nodes of the spline.
    tangent : (T, d) array
        Base tangent.
    arc_length : (S,) array, m
        Arc lengths of the stations.
    knots : (n + 1,) array, m
        Arc lengths of the nodes.
    boundary : str
        End conditions of the spline.
    distance : (T, S) array, m
        Distance of each station from the spline at equal arc length.
    """
    fold = max(1, int(np.ceil(GRID / (arc_length.size - 1))))
    grid = np.interp(np.arange((arc_length.size - 1) * fold + 1) / fold, np.arange(arc_length.size), arc_length)
    curve, *derivatives = [_evaluate(knots, boundary, nodes, tangent, grid, order) for order in range(4)]
    reach = np.pi * distance.max()
    nearest = _nearest_on_grid(points, curve, arc_length, grid, fold, reach)
    taken = [np.take_along_axis(d, nearest[None], axis=2) for d in (curve, *derivatives)]
    refined = _newton(points, taken, grid, nearest)
    return np.minimum(distance, refined)


def _evaluate(knots: Array, boundary: str, nodes: Array, tangent: Array, grid: Array, order: int) -> Array:
    matrix, slope = spline_matrix(knots, grid, boundary, order)
    return np.asarray(nodes @ matrix.T + tangent.T[:, :, None] * slope)


def _nearest_on_grid(
    points: Array, curve: Array, arc_length: Array, grid: Array, fold: int, reach: float
) -> NDArray[np.intp]:
    """Return the index (T, S) of the nearest grid point among those within `reach` along the arc."""
    home = np.arange(arc_length.size) * fold
    best = np.full(points.shape[1:], np.inf)
    index = np.zeros(points.shape[1:], dtype=np.intp)
    steps = int(np.ceil(reach / np.diff(grid).min())) + 1
    for shift in range(-min(steps, grid.size - 1), min(steps, grid.size - 1) + 1):
        cell = np.clip(home + shift, 0, grid.size - 1)
        squared = np.square(points - curve[:, :, cell]).sum(axis=0)
        better = squared < best
        best[better] = squared[better]
        index[better] = np.broadcast_to(cell, index.shape)[better]
    return index


def _newton(points: Array, taken: list[Array], grid: Array, nearest: NDArray[np.intp]) -> Array:
    """Return the distance after Newton steps along the cubic r + u r' + u^2/2 r'' + u^3/6 r''' of each point."""
    r, r1, r2, r3 = taken
    low = grid[np.maximum(nearest - 1, 0)] - grid[nearest]
    high = grid[np.minimum(nearest + 1, grid.size - 1)] - grid[nearest]
    u = np.zeros(nearest.shape)
    for step in range(NEWTON_STEPS + 1):
        gap = r + u * (r1 + u * (r2 / 2 + u * r3 / 6)) - points
        if step == NEWTON_STEPS:
            break
        first = r1 + u * (r2 + u * r3 / 2)
        gradient = (gap * first).sum(axis=0)
        hessian = np.square(first).sum(axis=0) + (gap * (r2 + u * r3)).sum(axis=0)
        slow = np.square(first).sum(axis=0) / 2  # far from the curve the full Hessian may lose its sign
        u = np.clip(u - gradient / np.maximum(hessian, np.maximum(slow, 1e-300)), low, high)
    return np.minimum(np.linalg.norm(gap, axis=0), np.linalg.norm(r - points, axis=0))


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
