"""Track the silhouette of a body through a video: its motion in the previous two frames predicts where to search in the
next.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pliant.recording.camera import opencv
from pliant.video.surroundings import Surroundings

Array = np.ndarray
WIDE, FINE = 2.2, 0.6  # search range to both sides of the line: in widths, and in half widths beyond the edge
HIDDEN_RUN, HIDDEN = 0.12, 0.3  # largest hidden fractions of the body, in one piece and in total
LENGTH = 0.05  # accepted relative change of the length between two frames
LIGHT = 0.45  # accepted change of lightness relative to the contrast of body and background
KEEP = 0.8  # weight of the previous widths and lightness in the update
WEIGHT_BASE = 50.0
LEVELS = 24  # intervals of distance from the base
LEAST_PIXELS = 40  # least number of pixels of the body in the small picture
POINTS = 61  # number of points of the line, base to tip
SPANS = 16  # of the spline along the body
ROUGHNESS = 5e-11  # weight of its third derivative
STIFF_END = 5.0  # factor of that weight near the tip, where the spline is free; tuned on videos of actuator "a"
INNER = 0.45  # of the half width: within it the lightness of the body is measured
WIDTHS = (0.75, 1.3)  # accepted width relative to the usual width
STEEP = 0.08  # slope of the body fraction per pixel from which an edge has full weight
BEYOND = 2.0  # widths beyond the end of the line in which the tip is searched


@dataclass
class Known:
    """State of the silhouette tracker after a frame: centreline, displacement since the frame before, half width
    [pixels], lightness, and length of the body.
    """

    line: Array  # (S, 2)
    step: Array  # (S, 2), since the previous frame
    half: Array  # (S,)
    light: Array  # (S,)
    length: float


class Follower:
    """Tracker of the body's silhouette through the frames of a video. `base` (2,) [pixels] is the position of the
    body's base, where it is known.
    """

    def __init__(self, around: Surroundings, base: Array | None = None) -> None:
        self.around, self.base = around, base
        self.sample = Sampler(around)
        self.known: Known | None = None
        self.cv2 = opencv("tracking a video")

    def __call__(self, picture: Array) -> Ribbon | None:
        """Return the body in the next frame; None where it is wholly or partly hidden."""
        body = None
        if self.known is not None:
            body = self._refined(picture, self.known.line + self.known.step, self.known)
        if body is None:
            body = self._afresh(picture)
        if body is None:
            if self.known is not None:
                self.known.step = np.zeros_like(self.known.step)
            return None
        self._learn(body)
        return body

    def _afresh(self, picture: Array) -> Ribbon | None:
        """Return the body from this frame alone, without the previous ones."""
        around = self.around
        small = self.cv2.resize(picture, around.small.shape[1::-1], interpolation=self.cv2.INTER_AREA)
        mask = mask_of(small, around)
        start = None if self.base is None else self.base / around.scale
        line = rough_line(mask, self._begin(mask) if start is None else start)
        if line is None or len(line) < 4:
            return None
        line = evenly(line * around.scale)  # to a pixel, which is near enough to begin
        length = float(np.hypot(*np.diff(line, axis=0).T).sum())
        half = 0.5 * mask.sum() * around.scale**2 / length
        if self.known is None:
            guess = Known(line, np.zeros_like(line), np.full(POINTS, half), np.full(POINTS, around.body), 0.0)
        else:
            guess = replace(self.known, line=line)
        return self._refined(picture, line, guess)

    def _begin(self, mask: Array) -> Array | None:
        """Return the end of the body that never moves, in the small picture; None where there is none."""
        if not self.around.always.any():
            return None
        line = rough_line(mask, None)
        if line is None:
            return None
        always = np.argwhere(self.around.always)[:, ::-1]
        near = [float(np.linalg.norm(always - end, axis=1).min()) for end in (line[0], line[-1])]
        return np.asarray(line[0] if near[0] <= near[1] else line[-1])

    def _refined(self, picture: Array, line: Array, known: Known) -> Ribbon | None:
        """Return the body measured by its edges along the normals, first in a wide range, then in a narrow one."""
        line = self._centred(picture, line, known)
        for _ in range(2):
            line, tip = self._ended(picture, line, known, at_tip=True)
            if self.base is None:
                line, _ = self._ended(picture, line[::-1], known, at_tip=False)
                line = line[::-1]
            measured = self._measured(picture, line, known)
            line = measured.line
        line, tip = self._ended(picture, line, known, at_tip=True)
        measured = replace(measured, line=line, tip=tip)
        return measured if self._whole(measured, known) else None

    def _centred(self, picture: Array, line: Array, known: Known) -> Array:
        """Return the line moved to the middle of the body's pixels within a wide range."""
        reach, step = WIDE * 2.0 * float(known.half.mean()), max(1.0, 0.1 * float(known.half.mean()))
        u = np.arange(-reach, reach + step, step)
        for _ in range(2):
            _, normal = normals(line)
            light, behind = self.sample(picture, line[:, None] + u[None, :, None] * normal[:, None])
            body = share(light, behind, known.light)
            body = np.where(body > 0.5, np.minimum(body, 1.0), 0.0)
            mass = body.sum(axis=1) * step
            fits = (mass > 0.5 * 2 * known.half) & (mass < 1.6 * 2 * known.half)
            offset = np.where(fits, (body @ u) / np.maximum(body.sum(axis=1), 1e-9), 0.0)
            line = self._smooth(line + offset[:, None] * normal, fits.astype(float))
        return evenly(line)

    def _measured(self, picture: Array, line: Array, known: Known) -> Ribbon:
        """Return the line at the middle between both edges."""
        reach = float(np.ceil((1.0 + FINE) * known.half.max() + 4.0))
        u = np.arange(-reach, reach + 1.0)
        _, normal = normals(line)
        light, behind = self.sample(picture, line[:, None] + u[None, :, None] * normal[:, None])
        plateau = np.median(light[:, np.abs(u) < INNER * known.half.min()], axis=1)
        alike = np.abs(plateau - known.light) < LIGHT
        plateau = np.where(alike, plateau, known.light)
        left, right, slope = edges(share(light, behind, plateau), len(u) // 2)
        half = 0.5 * (right - left)
        with np.errstate(invalid="ignore"):
            fits = alike & (half > WIDTHS[0] * known.half) & (half < WIDTHS[1] * known.half)
        offset = np.where(fits, 0.5 * (left + right) - len(u) // 2, 0.0)
        fits &= np.abs(offset - _median(offset)) < 6.0
        trust = np.where(fits, np.clip(slope / STEEP, 0.1, 1.0) ** 2, 0.0)
        smooth = self._smooth(line + offset[:, None] * normal, trust)
        return Ribbon(evenly(smooth), np.where(fits, half, known.half), plateau, fits, tip=True)

    def _smooth(self, line: Array, weight: Array) -> Array:
        weight = weight.copy()
        weight[[0, -1]] = 0.0  # their normals lie on the body's ends
        weight[-2] *= 0.5
        if self.base is not None:
            line = line.copy()
            line[0], weight[0] = self.base, WEIGHT_BASE
        if (weight > 0).sum() < BASIS.matrix.shape[1]:
            return line
        return BASIS.smooth(line, weight)

    def _ended(self, picture: Array, line: Array, known: Known, *, at_tip: bool) -> tuple[Array, bool]:
        """Return the line extended or cut to the end of the body, and whether that end was found."""
        half = float(known.half[-4:].mean() if at_tip else known.half[:4].mean())
        light = float(np.median(known.light[-6:] if at_tip else known.light[:6]))
        along = line[-1] - line[-6]
        along /= max(float(np.hypot(*along)), 1e-9)
        across = np.array([along[1], -along[0]])
        v = np.arange(-2.0 * half, BEYOND * 2.0 * half)
        u = np.linspace(-0.55, 0.55, 11) * half
        neighbour = line[-1] + v[:, None, None] * along + u[None, :, None] * across
        sampled, behind = self.sample(picture, neighbour)
        body = share(sampled, behind, np.full(len(v), light)).mean(axis=1)
        end = float(crossing(body[None], np.zeros(1, int))[0][0])
        if not np.isfinite(end):
            return line, False
        beyond = end + v[0]
        length = float(np.hypot(*np.diff(line, axis=0).T).sum())
        longer = np.concatenate([line, [line[-1] + max(beyond, 0.0) * along]]) if beyond > 0 else line
        steps = np.append(0.0, np.cumsum(np.hypot(*np.diff(longer, axis=0).T)))
        distances = np.linspace(0.0, max(length + beyond, 1.0), POINTS)
        return np.stack([np.interp(distances, steps, longer[:, k]) for k in (0, 1)], axis=1), True

    def _whole(self, found: Ribbon, known: Known) -> bool:
        """Return whether enough of the body was seen, with its tip and with the previous length."""
        inside = found.seen[2:]
        run = longest_run(~inside)
        length = float(np.hypot(*np.diff(found.line, axis=0).T).sum())
        same = not known.length or abs(length / known.length - 1.0) < LENGTH
        few = run <= HIDDEN_RUN * POINTS and (~inside).mean() < HIDDEN and inside[-6:].sum() > 2
        return bool(found.tip and same and few)

    def _learn(self, found: Ribbon) -> None:
        length = float(np.hypot(*np.diff(found.line, axis=0).T).sum())
        old = self.known
        if old is None:
            half = np.where(found.seen, found.half, np.median(found.half[found.seen]))
            self.known = Known(found.line, np.zeros_like(found.line), half, found.light, length)
            return
        mix = np.where(found.seen, 1.0 - KEEP, 0.0)
        self.known = Known(
            found.line, found.line - old.line, old.half + mix * (found.half - old.half),
            old.light + mix * (found.light - old.light), length,
        )


def _median(values: Array) -> Array:
    """Return the running median (S,) over five points."""
    padded = np.pad(values, 2, mode="edge")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1))


def longest_run(flags: Array) -> int:
    """Return the length of the longest run of successive True values."""
    best = run = 0
    for flag in flags.tolist():
        run = run + 1 if flag else 0
        best = max(best, run)
    return best


def mask_of(small: Array, around: Surroundings) -> Array:
    """Return a mask (h, w) of the pixels of the body in a scaled-down picture (h, w, 3) of h by w pixels."""
    cv2 = opencv("tracking a video")
    light, behind = small.astype(np.float32) @ around.weight, around.small @ around.weight
    share = (light - behind) / np.maximum(around.body - behind, 0.3)
    mask = ((share > 0.5) & around.reach).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, label, facts, _ = cv2.connectedComponentsWithStats(mask)
    if count < 2:
        return np.zeros(mask.shape, bool)
    inside = np.bincount(label[around.always], minlength=count)
    inside[0] = 0
    best = int(inside.argmax()) if inside.any() else 1 + int(facts[1:, cv2.CC_STAT_AREA].argmax())
    return np.asarray(label == best)


def rough_line(mask: Array, start: Array | None) -> Array | None:
    """Return N points (N, 2) [pixels] along the middle of the body, base first, from the mask (h, w) of its pixels;
    None where the mask is too small.

    Parameters
    ----------
    start : array (2,), optional
        Position of the base. Without it the line begins at one of the two ends that are farthest apart.
    """
    pixels = np.argwhere(mask)[:, ::-1].astype(float)
    if len(pixels) < LEAST_PIXELS:
        return None
    distances = _distances(mask, pixels, pixels[0] if start is None else start)
    if start is None:
        distances = _distances(mask, pixels, pixels[int(np.where(np.isfinite(distances), distances, -1.0).argmax())])
    whole = np.isfinite(distances)
    step = distances[whole].max() / LEVELS
    level = np.minimum((distances[whole] / step).astype(int), LEVELS - 1)
    count = np.bincount(level, minlength=LEVELS)
    middle = np.stack([np.bincount(level, pixels[whole, k], LEVELS) / np.maximum(count, 1) for k in (0, 1)], axis=1)
    return np.asarray(middle[count > 0])


def _distances(mask: Array, place: Array, start: Array) -> Array:
    """Return the distance (N,) of each pixel of the mask from the pixel nearest to `start`, within the mask."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    number = np.full((mask.shape[0] + 2, mask.shape[1] + 2), -1)
    number[1:-1, 1:-1][mask] = np.arange(len(place))
    rows, columns, lengths = [], [], []
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        pixel, neighbour = number[1:-1, 1:-1], number[1 + dy : mask.shape[0] + 1 + dy, 1 + dx : mask.shape[1] + 1 + dx]
        both = (pixel >= 0) & (neighbour >= 0)
        rows.append(pixel[both])
        columns.append(neighbour[both])
        lengths.append(np.full(int(both.sum()), float(np.hypot(dy, dx))))
    graph = coo_array((np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))),
                      shape=(len(place), len(place))).tocsr()  # fmt: skip
    nearest = int(np.linalg.norm(place - start, axis=1).argmin())
    return np.asarray(dijkstra(graph, directed=False, indices=nearest))


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
