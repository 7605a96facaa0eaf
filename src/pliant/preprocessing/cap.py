"""Find the tip of a body from the curvature of a fibre in it: a rigid cap of known, constant curvature is mounted at
the tip.

The template along the fibre is [mean of the body | k_c over L_c | tail], averaged over the gauge of the sensor. It
slides over every frame, and the position with the least squared error is refined below one sample. The frames in which
the cap differs from the body vote for one tip.

Paper: Sec. II ("a cap with a constant curvature at the tip")
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

PLATEAU_TOLERANCE = 0.25  # of k_c: accepted deviation of the plateau and the tail
LEAST_CONTRAST = 0.15  # of k_c: a body whose curvature is closer to the cap's hides its edge
CLEAR_CONTRAST = 0.3  # of k_c
NEEDED_CONFIDENCE = 0.5
MAD_GATE = 4.0
REFINEMENTS = 5  # without noise the fourth is exact to rounding


@dataclass(frozen=True)
class Tip:
    """Tip of the body as an arc length along the fibre [m], with its uncertainty and the numbers of frames used.

    Attributes
    ----------
    found : bool
        False where there is no cap, or it cannot be distinguished from the body; `arc_length` is then NaN.
    arc_length : float, m
        Median over the frames that agree on the tip.
    standard_deviation : float, m
        Robust standard deviation over the frames that agree.
    confidence : float
        0 to 1: fraction of the frames with a clear cap that agree, times the contrast of cap and body.
    status : str
        The result in one sentence.
    per_frame : (T,) array, m
        Tip of every frame; NaN where a frame shows no cap.
    frames_used, frames_without_cap, frames_ambiguous, frames_rejected : int
        Numbers of frames that agree; that show no plateau of the cap's curvature; whose body is too close to the cap's
        curvature; that deviate from the median.
    """

    found: bool
    arc_length: float
    standard_deviation: float
    confidence: float
    status: str
    per_frame: Array
    frames_used: int
    frames_without_cap: int
    frames_ambiguous: int
    frames_rejected: int


def find_tip(
    curvature: Array | xr.DataArray,
    spacing: float,
    *,
    cap_curvature: float,
    cap_length: float,
    gauge_length: float | None = None,
    tail_curvature: float = 0.0,
) -> Tip:
    """Find the arc length of the body's tip along a fibre from the fibre's curvature (T, S) [1/m], T frames by S
    samples.

    Parameters
    ----------
    curvature : (T, S) array, 1/m
        Signed, at evenly spaced samples; a frame with NaN is left out and counted as one without a cap.
    spacing : float, m
        Distance between neighbouring samples.
    cap_curvature : float, 1/m
        Curvature of the cap, with the same sign convention as `curvature`.
    cap_length : float, m
        Length of the fibre in the cap.
    gauge_length : float, m, optional
        Length over which the sensor averages; default and minimum: `spacing`.
    tail_curvature : float, 1/m
        Curvature of the fibre behind the cap.

    Returns
    -------
    Tip
        The tip, at an arc length from the first sample.

    Raises
    ------
    InputError
        When the numbers cannot describe a cap, or the fibre is too short for one.
    """
    kappa = np.asarray(curvature, dtype=np.float64)
    width = max(spacing, gauge_length or 0.0)
    template = _template(kappa, spacing, cap_curvature, cap_length, width, tail_curvature)
    whole = np.isfinite(kappa).all(axis=1)
    tip_arc, fit = np.full(len(kappa), np.nan), np.full((4, len(kappa)), np.nan)
    if whole.any():
        tip_arc[whole], fit[:, whole] = template.locate(kappa[whole])
    body, plateau, tail, edge_error = fit
    allowed = PLATEAU_TOLERANCE * abs(cap_curvature) + 3.0 * edge_error
    capped = (np.abs(plateau - cap_curvature) < allowed) & (np.abs(tail - tail_curvature) < allowed)
    contrast = np.abs(body - cap_curvature) / abs(cap_curvature)
    clear = capped & (contrast * abs(cap_curvature) > LEAST_CONTRAST * abs(cap_curvature) + 3.0 * edge_error)
    return _consensus(np.where(capped, tip_arc, np.nan), capped, clear, contrast, spacing)


def _template(
    kappa: Array, spacing: float, cap_curvature: float, cap_length: float, width: float, tail: float
) -> CapTemplate:
    if kappa.ndim != 2:
        raise InputError(f"curvature must have the shape (time, station), not {kappa.shape}")
    numbers = (spacing, cap_curvature, cap_length, width, tail)
    if not np.isfinite(numbers).all():
        raise InputError("spacing, gauge_length, cap_curvature, cap_length and tail_curvature must be finite numbers")
    if spacing <= 0:
        raise InputError(f"the spacing of the curvature samples must be above 0 m, got {spacing} m")
    if cap_curvature == 0:
        raise InputError("cap_curvature must not be 0: set it to the curvature of the cap, in 1/m")
    if cap_length < 2 * width:
        raise InputError(
            f"a cap of {cap_length * 1e3:g} mm cannot be resolved by a gauge of {width * 1e3:g} mm: "
            "the cap must be at least twice as long; use a longer cap or a shorter gauge_length"
        )
    template = CapTemplate(spacing, cap_curvature, cap_length, width, tail)
    if kappa.shape[1] < template.samples:
        raise InputError(
            f"the fibre is too short: {kappa.shape[1]} samples, but body, cap and tail need {template.samples}: "
            "record more of the fibre on both sides of the cap"
        )
    return template


def _consensus(
    place: Array, capped: NDArray[np.bool_], clear: NDArray[np.bool_], contrast: Array, spacing: float
) -> Tip:
    without, ambiguous = int((~capped).sum()), int((capped & ~clear).sum())
    counted = f"{len(place)} frame(s): {without} without a cap, {ambiguous} with a body curved like the cap"
    if not clear.any():
        why = "the body is curved like the cap" if ambiguous else "there is no cap of this curvature and length"
        return Tip(False, np.nan, np.nan, 0.0, f"No tip: {why} ({counted}).", place, 0, without, ambiguous, 0)
    candidates = place[clear]
    median = float(np.median(candidates))
    deviation = 1.4826 * float(np.median(np.abs(candidates - median)))
    agree = np.abs(candidates - median) <= max(MAD_GATE * deviation, spacing)
    tip = float(np.median(candidates[agree]))
    sd = 1.4826 * float(np.median(np.abs(candidates[agree] - tip)))
    outstanding = np.clip(float(np.median(contrast[clear])) / CLEAR_CONTRAST, 0.0, 1.0)
    share = agree.sum() / (clear.sum() + without)
    steady = 1.0 / (1.0 + (deviation / (2 * spacing)) ** 2)
    confidence = float(share * outstanding * steady)
    rejected = int((~agree).sum())
    counted += f", {rejected} far from the median"
    sure = confidence >= NEEDED_CONFIDENCE
    if sure:
        status = f"Tip at {tip * 1e3:.2f} mm, confidence {confidence:.2f}, from {int(agree.sum())} of {counted}."
    else:
        status = f"No tip: the frames do not agree, confidence {confidence:.2f} ({counted})."
    used = int(agree.sum())
    return Tip(sure, tip if sure else np.nan, sd, confidence, status, place, used, without, ambiguous, rejected)


class CapTemplate:
    """Expected curvature along the fibre near the tip (body, then cap, then tail), averaged over the sensor's gauge
    length. It is shifted along a measured curvature to find the cap.
    """

    def __init__(self, spacing: float, cap_curvature: float, cap_length: float, width: float, tail: float) -> None:
        self.spacing, self.cap_curvature, self.cap_length = spacing, cap_curvature, cap_length
        self.width, self.tail = width, tail
        side = max(3, int(np.ceil((cap_length / 2 + width) / spacing)))
        self.before = side
        self.samples = 2 * side + int(np.ceil(cap_length / spacing)) + 1
        self.s = (np.arange(self.samples) - side) * spacing  # 0 is the edge between body and cap

    def shares(self, edge: Array) -> tuple[Array, Array]:
        """Return two arrays (T, M): which fractions of the gauge length of each of M samples lie on the body and on the
        tail. In each of T frames the cap begins at `edge` (T,) [m].
        """
        low = self.s - self.width / 2
        body = np.clip((edge[:, None] - low) / self.width, 0.0, 1.0)
        tail = np.clip((low + self.width - edge[:, None] - self.cap_length) / self.width, 0.0, 1.0)
        return body, tail

    def locate(self, kappa: Array) -> tuple[Array, Array]:
        """Return the tip position (T,) [m] along the fibre in T frames, from the curvature `kappa` (T, S) [1/m] of S
        samples. Also return four rows (4, T) [1/m]: mean curvature of body, cap and tail, and the standard error of the
        mean curvature of the cap.
        """
        body, tail = (share[0] for share in self.shares(np.zeros(1)))
        fixed = self.cap_curvature * (1 - body - tail) + self.tail * tail
        weight = float(body @ body)
        b = (kappa @ self._sliding(body, kappa.shape[1]) - fixed @ body) / weight
        squared = np.square(kappa) @ self._sliding(np.ones_like(body), kappa.shape[1])
        squared += fixed @ fixed - weight * b**2 - 2 * kappa @ self._sliding(fixed, kappa.shape[1])
        best = squared.argmin(axis=1)
        rows = np.arange(len(kappa))
        window = kappa[rows[:, None], best[:, None] + np.arange(self.samples)]
        edge, mean = self._refine(window, b[rows, best])
        return (best + self.before) * self.spacing + edge, self._levels(window, edge, mean)

    def _sliding(self, weights: Array, stations: int) -> Array:
        """Return a matrix (S, S - M + 1) whose columns hold the weights at every position of the window."""
        columns = np.arange(stations - self.samples + 1)
        matrix = np.zeros((stations, columns.size))
        matrix[columns[None, :] + np.arange(self.samples)[:, None], columns[None, :]] = weights[:, None]
        return matrix

    def _refine(self, window: Array, mean: Array) -> tuple[Array, Array]:
        """Refine the edge (at most one sample from 0) and the mean curvature of the body by Gauss-Newton."""
        edge = np.zeros(len(window))
        for _ in range(REFINEMENTS):
            body, tail = self.shares(edge)
            residual = window - mean[:, None] * body - self.tail * tail - self.cap_curvature * (1 - body - tail)
            on_body, on_tail = (body > 0) & (body < 1), (tail > 0) & (tail < 1)
            slope = (mean[:, None] - self.cap_curvature) * on_body + (self.cap_curvature - self.tail) * on_tail
            slope = slope / self.width
            a11, a12, a22 = (slope * slope).sum(1), (slope * body).sum(1), (body * body).sum(1)
            g1, g2 = (slope * residual).sum(1), (body * residual).sum(1)
            determinant = a11 * a22 - a12**2
            safe = determinant + (determinant == 0)  # 0 where no sample lies across an edge: the mean has settled
            edge = np.clip(edge + (a22 * g1 - a12 * g2) / safe, -self.spacing, self.spacing)
            mean = mean + (a11 * g2 - a12 * g1) / safe
        return edge, mean

    def _levels(self, window: Array, edge: Array, mean: Array) -> Array:
        """Return the measured curvature of body, plateau and tail, and the standard error of the plateau.

        A cap of two gauge lengths or more holds a whole sample, and so does the tail.
        """
        body, tail = self.shares(edge)
        inside, behind = 1 - body - tail > 0.999, tail > 0.999
        plateau = (window * inside).sum(1) / inside.sum(1)
        end = (window * behind).sum(1) / behind.sum(1)
        scatter = np.where(inside, window - plateau[:, None], np.where(behind, window - end[:, None], 0.0))
        freedom = np.maximum(inside.sum(1) + behind.sum(1) - 2, 1)
        return np.stack([mean, plateau, end, np.sqrt(np.square(scatter).sum(1) / freedom / inside.sum(1))])
