"""Choose the positions of the joints along the body: at equal arc length, or such that the largest error of the spline
through them is smallest.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pliant.numerics.spline import NATURAL, NOT_A_KNOT, spline_matrix
from pliant.reduction.body import BodyShape
from pliant.reduction.error import frame_errors, spline_map

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

DENSE_STATIONS = 65  # eight stations in each of eight segments
ACTIVE_FRAMES = 96  # frames in the search; the worst of the others are added each round
ROUNDS = 8
START_SEGMENTS = 16


def equal_nodes(arc_length: Array, n: int, nodes: str = "auto") -> Array:
    """Return the arc lengths (n + 1,) [m] of the nodes of n segments of equal length along the body, base and tip
    included.

    With ``nodes="interpolated"`` they are exactly j L / n, between stations where necessary. With ``"stations"`` they
    are at the nearest stations. ``"auto"`` interpolates from 65 stations on: a local cubic between stations L / 64
    apart has 0.05 % of the error of an eight-segment spline. With fewer stations only measured points are used.
    """
    target = np.linspace(0.0, arc_length[-1], n + 1)
    if nodes == "interpolated" or (nodes == "auto" and arc_length.size >= DENSE_STATIONS):
        return target
    nearest = np.abs(arc_length[None, :] - target[:, None]).argmin(axis=1)
    return arc_length[nearest]


def best_nodes(body: BodyShape, n: int, boundary: str, start: Array) -> Array:
    """Search for nodes for which the spline through them is closest to the body. Return their arc lengths (n + 1,) [m],
    for n segments. The largest error of the spline is not above the one with the nodes `start`.

    Base and tip are fixed. The search moves nodes from station to station, alone and in blocks, on a set of active
    frames. It adds the worst of all frames until none is worse than the active ones. It starts from the equal nodes and
    from de Boor's equidistribution of |x''''|^(1/4), and ends in a local optimum.

    Parameters
    ----------
    body : BodyShape
    n : int
        Number of segments.
    boundary : str
        End conditions of the spline.
    start : (n + 1,) array, m
        Arc lengths of the initial nodes.
    """
    s = body.arc_length
    best, best_errors = start, _largest(body, start, boundary)
    indices = [_to_indices(s, start), _to_indices(s, _equidistributed(body, n))]
    active = np.union1d(
        np.argsort(best_errors)[-ACTIVE_FRAMES // 2 :],
        np.linspace(0, len(body.time) - 1, min(ACTIVE_FRAMES // 2, len(body.time))).astype(int),
    )
    for _ in range(ROUNDS):
        search = _Search(body, active, boundary)
        found = min((search.descend(i) for i in indices), key=lambda pair: pair[1])
        errors = _largest(body, s[found[0]], boundary)
        if errors.max() < best_errors.max():
            best, best_errors = s[found[0]], errors
        if errors.max() <= found[1] * (1 + 1e-9):
            break
        active = np.union1d(active, np.argsort(errors)[-ACTIVE_FRAMES // 3 :])
        indices = [*indices[:2], found[0]]
    return best


def stations_between(arc_length: Array, knots: Array) -> int:
    """Return the smallest number of stations strictly between two neighbouring nodes. The error of the spline can only
    be measured at such stations.
    """
    tolerance = 1e-9 * arc_length[-1]
    inside = [((arc_length > a + tolerance) & (arc_length < b - tolerance)).sum() for a, b in pairwise(knots)]
    return int(min(inside))


def _largest(body: BodyShape, knots: Array, boundary: str) -> Array:
    return frame_errors(body, [spline_map(body.arc_length, knots, boundary)])[0][0]


class _Search:
    """Search over stations as nodes on a fixed set of frames; a segment always keeps a station inside."""

    def __init__(self, body: BodyShape, frames: NDArray[np.intp], boundary: str) -> None:
        self.s = body.arc_length
        self.points = np.ascontiguousarray(body.position[frames].transpose(1, 2, 0)).reshape(self.s.size, -1)
        self.tangent = np.ascontiguousarray(body.tangent[frames].T).reshape(-1)
        self.axes = body.position.shape[2]
        self.boundary = boundary
        self.seen: dict[bytes, float] = {}

    def cost(self, index: NDArray[np.intp]) -> float:
        """Return the largest squared distance [m^2] between the body and the spline through nodes at the stations with
        the indices `index`.
        """
        key = index.tobytes()
        if key not in self.seen:
            spline, slope = spline_matrix(self.s[index], self.s, self.boundary)
            gap = spline @ self.points[index] - self.points
            if self.boundary not in (NATURAL, NOT_A_KNOT):
                gap += slope[:, None] * self.tangent
            np.square(gap, out=gap)
            self.seen[key] = float(gap.reshape(self.s.size, self.axes, -1).sum(axis=1).max())
        return self.seen[key]

    def descend(self, index: NDArray[np.intp]) -> tuple[NDArray[np.intp], float]:
        """Move nodes between stations, starting from the station indices `index`, while this reduces the largest error
        of the spline through them. Return the final indices and the largest error [m].
        """
        cost = self.cost(index)
        n = index.size - 1
        stride = max(1, self.s.size // (4 * n))
        while stride:
            improved = False
            for first in range(1, n):
                for last in range(first, n):
                    for shift in (-stride, stride):
                        trial = index.copy()
                        trial[first : last + 1] += shift
                        if np.diff(trial).min() > 1 and self.cost(trial) < cost:
                            index, cost, improved = trial, self.cost(trial), True
            if not improved:
                stride //= 2
        return index, float(np.sqrt(cost))


def _to_indices(s: Array, knots: Array) -> NDArray[np.intp]:
    """Return the stations nearest to the knots, at least two apart, with the first and last kept."""
    index = np.abs(s[None, :] - knots[:, None]).argmin(axis=1)
    index[0], index[-1] = 0, s.size - 1
    for j in range(1, index.size - 1):
        index[j] = max(index[j], index[j - 1] + 2)
    for j in range(index.size - 2, 0, -1):
        index[j] = min(index[j], index[j + 1] - 2)
    return index


def _equidistributed(body: BodyShape, n: int) -> Array:
    """Return nodes that divide int |x''''|^(1/4) ds equally, with x'''' from jumps of a spline's third derivative."""
    s = body.arc_length
    segments = max(2, min(START_SEGMENTS, (s.size - 1) // 2))
    knots = s[_to_indices(s, np.linspace(0.0, s[-1], segments + 1))]
    middle = (knots[:-1] + knots[1:]) / 2
    third, _ = spline_matrix(knots, middle, NOT_A_KNOT, 3)
    sample = np.linspace(0, len(body.time) - 1, min(500, len(body.time))).astype(int)
    jerk = np.matmul(third, body.position[sample][:, np.searchsorted(s, knots)])
    jump = np.linalg.norm(np.diff(jerk, axis=1), axis=2).max(axis=0)
    slope = jump / np.diff(middle)
    density = (np.concatenate((slope[:1], slope)) + np.concatenate((slope, slope[-1:]))) ** 0.25
    share = np.concatenate(([0.0], np.cumsum((density + 0.05 * density.max() + 1e-30) * np.diff(knots))))
    return np.interp(np.linspace(0.0, share[-1], n + 1), share, knots)
