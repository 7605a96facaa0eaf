"""Delay between the clock of the pressure and the clock of the shape, with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from pliant.errors import InputError
from pliant.recording import append_history, check_recording

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

EDGE_TIME_S = 0.1  # an edge runs through most of its step within this time
EDGE_SHARE = 0.3  # of the pressure's range
ONSET_SHARE = 0.03  # of the step: where an edge, and the motion after it, begin
SEARCH_S = 0.3  # around the coarse delay, for the onset of the motion
SEGMENTS = 4
LEAST_CORRELATION = 0.3


@dataclass(frozen=True)
class Delay:
    """How much later the shape follows the pressure.

    Attributes
    ----------
    delay_s : float
        Time on the shape's clock minus time on the pressure's clock of the same event. The body's and the
        valve's own lag are part of it: a recording alone cannot tell them from an offset of the clocks.
    uncertainty_s : float
        One standard deviation.
    method : {"onset", "correlation"}
    edges : int
        Edges of the pressure that were used; 0 for the correlation.
    correlation : float
        Largest absolute correlation of pressure and motion over all delays.
    """

    delay_s: float
    uncertainty_s: float
    method: str
    edges: int
    correlation: float

    def summary(self) -> str:
        """One sentence."""
        how = f"from {self.edges} edge(s)" if self.method == "onset" else "from the correlation"
        return (
            f"the shape follows the pressure by {1e3 * self.delay_s:.1f} +- {1e3 * self.uncertainty_s:.1f} ms, {how}; "
            f"correlation {self.correlation:.2f}"
        )


def sync(
    ds: xr.Dataset, *, largest_s: float = 2.0, method: Literal["auto", "onset", "correlation"] = "auto"
) -> Delay:
    """Estimate the delay between pressure and shape.

    Parameters
    ----------
    ds : xarray.Dataset
        Recording with position and pressure.
    largest_s : float
        Largest delay that is looked for, of either sign.
    method : {"auto", "onset", "correlation"}
        ``correlation``: the delay at which pressure and motion agree best; its uncertainty is the larger of the
        scatter over parts of the recording and the one from residual and slope. ``onset``: where the motion
        starts after each edge of the pressure, looked for around the former delay. ``auto``: onset when there
        are edges.

    Raises
    ------
    InputError
        When pressure or motion is missing or constant, or when they do not agree at any delay.
    """
    check_recording(ds)
    if "position" not in ds or "pressure" not in ds:
        raise InputError("a delay is found between position and pressure, but the recording lacks one of them")
    if method not in ("auto", "onset", "correlation"):
        raise InputError(f"method is 'auto', 'onset' or 'correlation', not {method!r}")
    shape_time, motion = ds["time"].values, _motion(ds)
    pressure_time, pressure = ds["pressure_time"].values, _pressure(ds)
    coarse = _correlate(shape_time, motion, pressure_time, pressure, largest_s)
    if method == "correlation":
        return coarse
    edges = _edges(pressure_time, pressure)
    onsets = [_motion_onset(shape_time, motion, edge + coarse.delay_s) for edge in edges]
    delays = np.array([onset - edge for onset, edge in zip(onsets, edges, strict=True) if onset is not None])
    if delays.size == 0:
        if method == "onset":
            raise InputError(f"no motion starts at any of the {len(edges)} edges of the pressure: use the correlation")
        return coarse
    frame = float(np.median(np.diff(shape_time)))
    scatter = float(np.std(delays, ddof=1)) if delays.size > 1 else 2.0 * frame
    uncertainty = float(np.hypot(scatter / np.sqrt(delays.size), frame / np.sqrt(12.0)))
    return Delay(float(np.median(delays)), uncertainty, "onset", delays.size, coarse.correlation)


def shift_pressure(ds: xr.Dataset, delay_s: float) -> xr.Dataset:
    """Move the clock of the pressure by `delay_s`, such as ``sync(ds).delay_s``, onto that of the shape."""
    check_recording(ds)
    if "pressure" not in ds or not np.isfinite(delay_s):
        raise InputError("shift_pressure needs a recording with pressure and a finite delay in seconds")
    clock = ds["pressure_time"].copy(data=ds["pressure_time"].values + delay_s)
    shifted = ds.assign_coords(pressure_time=clock.values)
    shifted["pressure_time"].attrs = dict(ds["pressure_time"].attrs)
    return append_history(shifted, f"clock of the pressure moved by {1e3 * delay_s:+.2f} ms")


def _first_component(values: NDArray) -> NDArray:
    """(T,) main common course of the columns; NaN rows stay NaN."""
    seen = np.isfinite(values).all(1)
    if seen.sum() < 10:
        raise InputError("a delay needs at least ten samples of motion and of pressure")
    centred = values - values[seen].mean(0)
    weights = np.linalg.eigh(centred[seen].T @ centred[seen])[1][:, -1]
    return centred @ weights


def _motion(ds: xr.Dataset) -> NDArray:
    position = ds["position"].values
    course = _first_component(position.reshape(len(position), -1)[:, ~np.isnan(position).all(0).ravel()])
    return _without_gaps(ds["time"].values, course, "motion")


def _pressure(ds: xr.Dataset) -> NDArray:
    values = ds["pressure"].values.reshape(ds.sizes["pressure_time"], -1)
    course = _first_component(values)
    course = course * np.sign(course @ np.nan_to_num(values - np.nanmean(values, 0)).sum(1) or 1.0)
    return _without_gaps(ds["pressure_time"].values, course, "pressure")


def _without_gaps(time: NDArray, course: NDArray, what: str) -> NDArray:
    """Gaps are bridged for the estimate alone; the recording keeps them."""
    seen = np.isfinite(course)
    course = np.interp(time, time[seen], course[seen])
    if np.ptp(course) == 0:
        raise InputError(f"the {what} is constant: there is nothing to find a delay from")
    return course


def _correlate(time: NDArray, motion: NDArray, clock: NDArray, pressure: NDArray, largest: float) -> Delay:
    step = float(min(np.median(np.diff(time)), max(np.median(np.diff(clock)), 2e-3)))
    delay, peak, slope = _best_delay(time, motion, clock, pressure, np.arange(-largest, largest + step, step), step)
    if abs(peak) < LEAST_CORRELATION:
        raise InputError(f"pressure and motion agree at no delay up to {largest:g} s (correlation {abs(peak):.2f})")
    if abs(delay) > largest - step:
        raise InputError(f"the best delay lies at the end of the search, {delay:.3g} s: raise largest_s")
    near = delay + np.arange(-0.25, 0.25, step)
    parts = []
    for start, end in zip(*_segments(time), strict=True):
        part = (time >= start) & (time < end)
        if part.sum() > 20 and np.ptp(motion[part]) > 0.3 * np.ptp(motion):
            parts.append(_best_delay(time[part], motion[part], clock, pressure, near, step)[0])
    scatter = float(np.std(parts, ddof=1) / np.sqrt(len(parts))) if len(parts) > 1 else 0.0
    return Delay(delay, float(max(scatter, slope, step / np.sqrt(12.0))), "correlation", 0, abs(float(peak)))


def _segments(time: NDArray) -> tuple[NDArray, NDArray]:
    bounds = np.linspace(time[0], time[-1], SEGMENTS + 1)
    return bounds[:-1], bounds[1:]


def _best_delay(
    time: NDArray, motion: NDArray, clock: NDArray, pressure: NDArray, delays: NDArray, step: float
) -> tuple[float, float, float]:
    """Delay of the largest correlation between samples, that correlation, and its standard deviation."""
    grid = np.arange(time[0], time[-1], step)
    shape = np.interp(grid, time, motion)
    values = np.array([_correlation(grid, shape, clock, pressure, delay) for delay in delays])
    best = int(np.argmax(np.abs(values)))
    delay, peak = float(delays[best]), float(values[best])
    if 0 < best < len(delays) - 1:
        before, after = values[best - 1], values[best + 1]
        bend = before - 2 * peak + after
        delay += step * 0.5 * float((before - after) / bend) if bend else 0.0
    course = np.interp(grid - delay, clock, pressure)
    slope = np.gradient(course, step)
    residual = np.std(shape) * np.sqrt(max(1.0 - peak**2, 0.0))
    gain = abs(peak) * np.std(shape) / max(np.std(course), 1e-300)
    independent = max(time[-1] - time[0], 1.0)  # one sample a second: residuals persist
    spread = residual / max(gain * np.sqrt(np.mean(slope**2) * independent), 1e-300)
    return delay, peak, float(spread)


def _correlation(grid: NDArray, shape: NDArray, clock: NDArray, pressure: NDArray, delay: float) -> float:
    inside = (grid - delay >= clock[0]) & (grid - delay <= clock[-1])
    if inside.sum() < 0.3 * len(grid):
        return 0.0
    course, motion = np.interp(grid[inside] - delay, clock, pressure), shape[inside]
    spread = np.std(course) * np.std(motion)
    return float(np.mean((course - course.mean()) * (motion - motion.mean())) / spread) if spread > 0 else 0.0


def _edges(clock: NDArray, pressure: NDArray) -> list[float]:
    """Times at which fast changes of the pressure begin."""
    level = (pressure - pressure.min()) / np.ptp(pressure)
    ahead = np.interp(clock + EDGE_TIME_S, clock, level) - level
    fast = np.abs(ahead) > EDGE_SHARE
    starts = np.flatnonzero(fast & ~np.concatenate([[False], fast[:-1]]))
    edges = []
    for start in starts:
        window = (clock >= clock[start]) & (clock <= clock[start] + 2 * EDGE_TIME_S)
        before = level[start]
        step = level[window][-1] - before
        onset = _crossing(clock[window], (level[window] - before) / step, ONSET_SHARE) if abs(step) > 0.2 else None
        if onset is not None:
            edges.append(onset)
    return edges


def _motion_onset(time: NDArray, motion: NDArray, guess: float) -> float | None:
    """When the motion leaves its course before `guess`; None when it cannot be told."""
    before = (time >= guess - 2 * SEARCH_S) & (time < guess - SEARCH_S)
    window = (time >= guess - SEARCH_S) & (time <= guess + SEARCH_S)
    if before.sum() < 5 or window.sum() < 5:
        return None
    level, noise = float(np.median(motion[before])), float(np.std(motion[before]))
    step = float(np.ptp(motion[window]))
    threshold = max(ONSET_SHARE * step, 5.0 * noise)
    if threshold > 0.3 * step:
        return None
    return _crossing(time[window], np.abs(motion[window] - level) / threshold, 1.0)


def _crossing(time: NDArray, course: NDArray, level: float) -> float | None:
    above = np.flatnonzero(course >= level)
    if above.size == 0 or above[0] == 0:
        return None
    i = above[0]
    share = (level - course[i - 1]) / (course[i] - course[i - 1])
    return float(time[i - 1] + share * (time[i] - time[i - 1]))
