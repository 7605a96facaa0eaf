"""Compute the distance between a body and the cubic spline through a few of its points, for all frames.

The arc length is common to all frames. Nodes and spline are therefore two fixed matrices, and the error of a frame
takes two small matrix products.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pliant.numerics.spline import CLAMPED, local_cubic_matrix, spline_matrix
from pliant.reduction.closest import closest_distances

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from pliant.reduction.body import BodyShape

CHUNK_VALUES = 1 << 16  # working set of about 0.5 MB an array: stays in cache


@dataclass(frozen=True)
class SplineMap:
    """Linear map from the stations of a frame to the spline through its nodes.

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

    knots: NDArray[np.float64]
    boundary: str
    nodes: NDArray[np.float64]
    spline: NDArray[np.float64]
    slope: NDArray[np.float64]


def spline_map(arc_length: NDArray[np.float64], knots: NDArray[np.float64], boundary: str) -> SplineMap:
    """Return the map for nodes at the arc lengths `knots` [m], which may be at or between stations."""
    spline, slope = spline_matrix(knots, arc_length, boundary)
    return SplineMap(knots, boundary, local_cubic_matrix(arc_length, knots), spline, slope)


def frame_errors(
    body: BodyShape, maps: Sequence[SplineMap], metric: str = "arc"
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute the largest and the mean error over the stations in every frame, for each of K maps.

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
        for k, one in enumerate(maps):
            distance = _distances(one, points, body.tangent[rows], body.arc_length, metric)
            largest[k, rows] = distance.max(axis=1)
            mean[k, rows] = distance.mean(axis=1)
    return largest, mean


def node_positions(one: SplineMap, position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the positions (T, n + 1, d) [m] of the nodes."""
    return np.matmul(one.nodes, position)


def _chunks(position: NDArray[np.float64]) -> Iterator[tuple[slice, NDArray[np.float64]]]:
    """Yield slices of frames and their points as (d, rows, S), so that the stations are the contiguous axis."""
    frames, stations, axes = position.shape
    step = max(1, CHUNK_VALUES // (stations * axes))
    for start in range(0, frames, step):
        rows = slice(start, min(start + step, frames))
        yield rows, np.ascontiguousarray(position[rows].transpose(2, 0, 1))


def _distances(
    one: SplineMap,
    points: NDArray[np.float64],
    tangent: NDArray[np.float64],
    arc_length: NDArray[np.float64],
    metric: str,
) -> NDArray[np.float64]:
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
