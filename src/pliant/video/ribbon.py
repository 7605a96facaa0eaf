"""The middle of a bright ribbon in one frame, sub-pixel: both its edges along the normals of a line that is near.

Along each normal the share of the body in a pixel is ``(light - background) / (body - background)``. A blurred edge
crosses one half where the sharp one lies, for a blur of focus or of motion alike. The middle between both edges is
smoothed along the body by a spline with few knots.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pliant.recording.camera import opencv
from pliant.video.surroundings import Surroundings

Array = np.ndarray
POINTS = 61  # of the line, base to tip
SPANS = 16  # of the spline along the body
ROUGHNESS = 5e-11  # weight of its third derivative
STIFF_END = 5.0  # of that weight near the tip, beyond which nothing holds the spline; tried on films of actuator "a"
INNER = 0.45  # of the half width: where the body's own lightness is taken
WIDTHS = (0.75, 1.3)  # of the usual width
STEEP = 0.08  # share of the body per pixel at an edge, from which on it counts fully
BEYOND = 2.0  # widths beyond an end, where the tip is looked for


@dataclass(frozen=True)
class Ribbon:
    """Shape in one frame, base to tip: points (S, 2), half widths (S,), lightness (S,), and which were seen."""

    line: Array
    half: Array
    light: Array
    seen: Array
    tip: bool


class Basis:
    """Splines along the body, base at 0 and tip at 1: from values (S,) with weights to smooth ones."""

    def __init__(self, count: int) -> None:
        from scipy.interpolate import BSpline

        knots = np.concatenate([np.zeros(3), np.linspace(0, 1, SPANS + 1), np.ones(3)])
        self.at = np.linspace(0.0, 1.0, count)
        self.matrix = BSpline.design_matrix(self.at, knots, 3).toarray()
        third = BSpline(knots, np.eye(SPANS + 3), 3).derivative(3)((np.arange(SPANS) + 0.5) / SPANS)
        stiff = np.where(np.arange(SPANS) < SPANS - 2, 1.0, STIFF_END)[:, None]
        self.rough = ROUGHNESS * count * (stiff * third).T @ third / SPANS

    def smooth(self, values: Array, weight: Array) -> Array:
        """Values (S, d) made smooth, those of no weight filled in."""
        left = self.matrix.T * weight
        return np.asarray(self.matrix @ np.linalg.solve(left @ self.matrix + self.rough, left @ values))


BASIS = Basis(POINTS)


def evenly(line: Array, count: int = POINTS) -> Array:
    """The line (N, 2) with points evenly along its length."""
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(line, axis=0).T)))
    at = np.linspace(0.0, along[-1], count)
    return np.stack([np.interp(at, along, line[:, 0]), np.interp(at, along, line[:, 1])], axis=1)


def normals(line: Array) -> tuple[Array, Array]:
    """Unit tangents and normals (S, 2), the normal a quarter turn on the way from x to y back from the tangent."""
    tangent = np.gradient(line, axis=0)
    tangent /= np.maximum(np.hypot(tangent[:, 0], tangent[:, 1]), 1e-9)[:, None]
    return tangent, np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)


class Sampler:
    """Lightness of a frame and of the background at points, on the body's own scale."""

    def __init__(self, around: Surroundings) -> None:
        self.around = around
        self.cv2: Any = opencv("tracking a video")

    def __call__(self, picture: Array, points: Array) -> tuple[Array, Array]:
        """Lightness and background (S, U) at points (S, U, 2) of a picture."""
        cv2, x, y = self.cv2, *(np.ascontiguousarray(points[..., k], np.float32) for k in (0, 1))
        both = [cv2.remap(p, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) @ self.around.weight
                for p in (picture, self.around.background)]  # fmt: skip
        return both[0], both[1]


def share(light: Array, behind: Array, body: Array) -> Array:
    """Share (S, U) of the body in each pixel; where body and background look alike, what the neighbours leave open."""
    contrast = body[:, None] - behind
    return np.asarray(np.clip((light - behind) / np.where(np.abs(contrast) < 0.2, np.inf, contrast), -0.2, 1.4))


def crossing(profile: Array, first: Array) -> tuple[Array, Array]:
    """Return where profiles (S, U) first fall below one half from column `first` (S,) on, and how steeply there.

    Returns
    -------
    at, slope : arrays (S,)
        Columns with fractions, NaN where there is none; shares of the body per column.
    """
    columns = np.arange(profile.shape[1])
    below = (profile < 0.5) & (columns >= first[:, None])
    k = np.maximum(below.argmax(axis=1), 1)
    row = np.arange(len(profile))
    high, low = profile[row, k - 1], profile[row, k]
    at = k - 1 + (high - 0.5) / np.where(high > low, high - low, np.inf)
    around = profile[row, np.maximum(k - 3, 0)] - profile[row, np.minimum(k + 2, profile.shape[1] - 1)]
    return np.where(below.any(axis=1) & (k > first) & (high >= 0.5), at, np.nan), around / 5.0


def edges(profile: Array, middle: int) -> tuple[Array, Array, Array]:
    """Columns (S,) of the edges to both sides of column `middle`, and the slope of the less steep of them."""
    last = profile.shape[1] - 1
    left, rise = crossing(profile[:, ::-1], np.full(len(profile), last - middle))
    right, fall = crossing(profile, np.full(len(profile), middle))
    return last - left, right, np.minimum(rise, fall)
