"""Measure the centreline of a bright body in one frame, to sub-pixel accuracy, from its two edges.

The edges are located along normals of an approximate line. Along each normal the fraction of a pixel that the body
covers is ``(light - background) / (body - background)``. An edge blurred by focus or motion crosses one half where the
sharp edge lies. The midpoints between both edges are smoothed along the body by a spline with few knots.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pliant.recording.camera import opencv
from pliant.video.surroundings import Surroundings

Array = np.ndarray
POINTS = 61  # number of points of the line, base to tip
SPANS = 16  # of the spline along the body
ROUGHNESS = 5e-11  # weight of its third derivative
STIFF_END = 5.0  # factor of that weight near the tip, where the spline is free; tuned on videos of actuator "a"
INNER = 0.45  # of the half width: within it the lightness of the body is measured
WIDTHS = (0.75, 1.3)  # accepted width relative to the usual width
STEEP = 0.08  # slope of the body fraction per pixel from which an edge has full weight
BEYOND = 2.0  # widths beyond the end of the line in which the tip is searched


@dataclass(frozen=True)
class Ribbon:
    """Body measured in one frame, at S points from base to tip: centreline (S, 2) [pixels], half widths (S,) [pixels],
    lightness (S,), and a mask (S,) of the points at which both edges were found.

    `seen` marks the points at which both edges were found, `tip` whether the tip was found.
    """

    line: Array
    half: Array
    light: Array
    seen: Array
    tip: bool


class Basis:
    """Smoothing splines for quantities along the body, over a parameter that is 0 at the base and 1 at the tip."""

    def __init__(self, count: int) -> None:
        from scipy.interpolate import BSpline

        knots = np.concatenate([np.zeros(3), np.linspace(0, 1, SPANS + 1), np.ones(3)])
        self.at = np.linspace(0.0, 1.0, count)
        self.matrix = BSpline.design_matrix(self.at, knots, 3).toarray()
        third = BSpline(knots, np.eye(SPANS + 3), 3).derivative(3)((np.arange(SPANS) + 0.5) / SPANS)
        stiff = np.where(np.arange(SPANS) < SPANS - 2, 1.0, STIFF_END)[:, None]
        self.rough = ROUGHNESS * count * (stiff * third).T @ third / SPANS

    def smooth(self, values: Array, weight: Array) -> Array:
        """Return `values` (S, d), d quantities at S points along the body, smoothed by a weighted fit of splines. A
        value whose weight (S,) is 0 has no effect on the result.
        """
        left = self.matrix.T * weight
        return np.asarray(self.matrix @ np.linalg.solve(left @ self.matrix + self.rough, left @ values))


BASIS = Basis(POINTS)


def evenly(line: Array, count: int = POINTS) -> Array:
    """Return `count` points [pixels] at equal spacing along the polyline through N points `line` (N, 2)."""
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(line, axis=0).T)))
    distances = np.linspace(0.0, along[-1], count)
    return np.stack([np.interp(distances, along, line[:, 0]), np.interp(distances, along, line[:, 1])], axis=1)


def normals(line: Array) -> tuple[Array, Array]:
    """Return the unit tangents (S, 2) and unit normals (S, 2) at S points of a line. For a tangent along +y, the normal
    points along +x.
    """
    tangent = np.gradient(line, axis=0)
    tangent /= np.maximum(np.hypot(tangent[:, 0], tangent[:, 1]), 1e-9)[:, None]
    return tangent, np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)


class Sampler:
    """Sampler of lightness in a picture and in the background, on a scale on which body and background differ by 1."""

    def __init__(self, around: Surroundings) -> None:
        self.around = around
        self.cv2: Any = opencv("tracking a video")

    def __call__(self, picture: Array, points: Array) -> tuple[Array, Array]:
        """Return the lightness (S, U) of a picture and of the background at points (S, U, 2) [pixels]."""
        cv2, x, y = self.cv2, *(np.ascontiguousarray(points[..., k], np.float32) for k in (0, 1))
        both = [cv2.remap(p, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) @ self.around.weight
                for p in (picture, self.around.background)]  # fmt: skip
        return both[0], both[1]


def share(light: Array, behind: Array, body: Array) -> Array:
    """Return the fraction (S, U) of a pixel that the body covers, at U points across the body for each of S points
    along it. It is about 1 within the body and 0 outside, or where body and background hardly differ.
    """
    contrast = body[:, None] - behind
    return np.asarray(np.clip((light - behind) / np.where(np.abs(contrast) < 0.2, np.inf, contrast), -0.2, 1.4))


def crossing(profile: Array, first: Array) -> tuple[Array, Array]:
    """Return the fractional column at which each of S profiles (S, U) of U samples falls below one half for the first
    time at or after the column `first` (S,). Also return the slope of the profile at this column.

    Returns
    -------
    at, slope : arrays (S,)
        Fractional columns of the crossing, NaN where there is none; fall of the profile per column.
    """
    columns = np.arange(profile.shape[1])
    below = (profile < 0.5) & (columns >= first[:, None])
    k = np.maximum(below.argmax(axis=1), 1)
    row = np.arange(len(profile))
    high, low = profile[row, k - 1], profile[row, k]
    position = k - 1 + (high - 0.5) / np.where(high > low, high - low, np.inf)
    around = profile[row, np.maximum(k - 3, 0)] - profile[row, np.minimum(k + 2, profile.shape[1] - 1)]
    return np.where(below.any(axis=1) & (k > first) & (high >= 0.5), position, np.nan), around / 5.0


def edges(profile: Array, middle: int) -> tuple[Array, Array, Array]:
    """Return the columns (S,) of the left and of the right edge of the body in S profiles (S, U) of U samples across
    it, and the smaller slope (S,) of the two edges.
    """
    last = profile.shape[1] - 1
    left, rise = crossing(profile[:, ::-1], np.full(len(profile), last - middle))
    right, fall = crossing(profile, np.full(len(profile), middle))
    return last - left, right, np.minimum(rise, fall)
