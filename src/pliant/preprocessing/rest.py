"""Find the frames of a recording in which the body is at rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError
from pliant.preprocessing import detectors
from pliant.preprocessing.cut import cut_time
from pliant.preprocessing.held import runs
from pliant.recording.inputs import recorded_inputs
from pliant.recording.rules import check_recording, shape_values, shape_variable

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

HALF_WINDOW_S = 0.1
STILL_SHARE = 0.03  # of the largest peak displacement
EARLY_SHARE = 0.1  # of the largest peak displacement: drift that is accepted at rest
LEAST_REST_S = 0.1
INPUT_SHARE = 0.05
FEWEST_FRAMES = 3
STILL_FRAMES = 0.95
END, CALM = 0.1, 0.5  # last part of a recording, in which a body has nearly come to rest if it moves half as far
FIRST_FRAMES = 5  # in which a body that is moved at once is still at rest
NEAR = 0.2  # of the range of the last station's motion: it rests where it rested first
TRIES = 10


def rest_window(recording: xr.Dataset) -> tuple[float, float]:
    """Return the start and end [s] of the interval in which the body is at rest before its first motion.

    Where inputs were measured, it is the time before an input first departs from its initial value by 5 % of its range,
    if that time holds three frames and the body is still during it. (The condition matters where the pressure has
    another clock than the shape.) Otherwise the shape decides: a frame is still when, within 0.1 s around it, every
    station stays within 3 % of the largest peak displacement or twenty times its noise, whichever is more. When no
    still interval precedes the first motion, the longest one anywhere is returned. Spikes of single frames are ignored.

    Returns
    -------
    (start, end) : float, s

    Raises
    ------
    InputError
        When no still interval lasts 0.1 s.
    """
    check_recording(recording)
    time, position = recording["time"].values, shown(recording)
    quiet = before_inputs(recording)
    if quiet is not None and still_within(position, time, quiet):
        return quiet
    rests = [(start, stop - 1) for start, stop in runs(_still(position, time), 1)]
    rests = [rest for rest in rests if time[rest[1]] - time[rest[0]] >= LEAST_REST_S]
    if not rests:
        raise InputError("the body is never at rest for 0.1 s: state `rest` = [start, end], s, in [alignment.options] "
                         "of a study, or --rest of pliant shape")
    first = rests[0]
    early = _precedes_motion(position, first)
    chosen = first if early else max(rests, key=lambda rest: time[rest[1]] - time[rest[0]])
    return float(time[chosen[0]]), float(time[chosen[1]])


def shown(recording: xr.Dataset) -> NDArray:
    """Return the recorded positions (T, S, d) [m] of S stations over T frames in d dimensions. For a recording without
    positions, return the angles (T, S, 1) [rad] or the inclination (T, S, d). Spikes of single frames are interpolated.
    """
    if not shape_variable(recording):
        raise InputError("finding a rest window needs positions or angles, but the recording holds neither: use "
                         "another recording")
    return detectors.spikes_bridged(shape_values(recording))


def before_inputs(recording: xr.Dataset) -> tuple[float, float] | None:
    """Return the times [s] of the first frame and of the last frame before any input changes. Return None without
    inputs, or with fewer than three such frames.
    """
    inputs, starts = recorded_inputs(recording), []
    for channel in inputs:
        known = np.isfinite(channel.values)
        time, values = channel.time[known], channel.values[known]
        moved = np.abs(values - np.median(values[:5])) > INPUT_SHARE * np.ptp(values) if known.any() else known[:0]
        starts += [time[int(np.argmax(moved))]] if moved.any() else []
    if not inputs:
        return None
    time = recording["time"].values
    before = time[time < min(starts, default=inputs[0].time[0])]
    return (float(before[0]), float(before[-1])) if before.size >= FEWEST_FRAMES else None


def clock_finding(recording: xr.Dataset) -> list[str]:
    """Return a list with one sentence where the body moves before its inputs change; else an empty list."""
    window = before_inputs(recording)
    if window is None or still_within(shown(recording), recording["time"].values, window):
        return []
    what = "the pressure does" if "pressure" in recording else "its inputs do"
    line = f"the body moves before {what} ({window[1]:.3g} s): it was touched, or their clocks differ (clock = 'align')"
    return [f"{line}; rest is taken from the shape"]


def still_within(position: NDArray, time: NDArray, window: tuple[float, float]) -> bool:
    """Return whether the body stays at rest, apart from noise and drift, between two times [s].

    The drift may be a tenth of the largest peak displacement. One frame in twenty may exceed the limits, as spikes do.
    """
    part = position[(time >= window[0]) & (time <= window[1])]
    noise, travel = (np.nan_to_num(detectors.by_blocks(f, position)) for f in (detectors.noise_level, detectors.travel))
    limit = np.maximum(EARLY_SHARE * travel.max(initial=0.0), 20.0 * noise)
    away = detectors.by_blocks(_away, part)
    return bool((away <= limit).all(axis=1).mean() >= STILL_FRAMES)


def _away(position: NDArray) -> NDArray:
    """Return the distance (T, S) [m] of each station from its median position; 0 where it was not seen."""
    finite = np.isfinite(position).all(axis=2)
    centres = np.array([np.median(p[s], axis=0) if s.any() else np.zeros(p.shape[1])
                      for p, s in zip(np.swapaxes(position, 0, 1), finite.T, strict=True)])
    return np.where(finite, np.linalg.norm(position - centres, axis=-1), 0.0)


def _precedes_motion(position: NDArray, run: tuple[int, int]) -> bool:
    """Return whether no station was far from its position in the run at any earlier time."""
    centre = detectors.mean_place(position[run[0] : run[1] + 1])
    away, whole = (_farthest(part, centre) for part in (position[: run[0]], position))
    return bool(away <= EARLY_SHARE * whole)


def _farthest(position: NDArray, place: NDArray) -> float:
    """Return the largest distance [m] of a station from its `place`."""
    return max((float(np.linalg.norm(p, axis=1).max(initial=0.0)) for p in detectors.seen_points(position, place)),
               default=0.0)


def _still(position: NDArray, time: NDArray) -> NDArray:
    """Return a mask (T,) of frames in which the body is still."""
    rate = (len(time) - 1) / max(time[-1] - time[0], 1e-12)
    reach = max(1, round(HALF_WINDOW_S * rate))
    width = detectors.by_blocks(lambda part: _width(part, reach), position)
    finite = detectors.by_blocks(lambda part: np.isfinite(part).all(2), position)
    repeated = detectors.repeated_frames(position)
    fresh = position[~repeated] if repeated.any() else position
    travel = np.nan_to_num(detectors.by_blocks(detectors.travel, fresh))
    noise = np.nan_to_num(detectors.by_blocks(detectors.noise_level, fresh))
    limit = np.fmax(STILL_SHARE * travel.max(initial=0.0), 20.0 * noise)
    return (width <= limit).all(1) & finite.any(1)


def _width(position: NDArray, reach: int) -> NDArray:
    """Return the diagonal (T, S) [m] of the box in which a station stays for `reach` frames on both sides."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    finite = np.isfinite(position)
    high = maximum_filter1d(np.where(finite, position, -np.inf), 2 * reach + 1, axis=0, mode="nearest")
    low = minimum_filter1d(np.where(finite, position, np.inf), 2 * reach + 1, axis=0, mode="nearest")
    with np.errstate(invalid="ignore"):
        return np.linalg.norm(np.where(high >= low, high - low, 0.0), axis=-1)


def later_rest(recording: xr.Dataset) -> list[float] | None:
    """Return the first rest [start, end] [s] at which all stations are labelled and the last one is where it began.

    None if all stations are labelled from the first frame on, or there is no such rest.
    """
    time, position = recording["time"].values, recording["position"].values
    complete = np.isfinite(position).all(axis=2)
    start = int(np.argmax(complete.all(axis=1)))
    tip = position[complete[:, -1], -1]
    if not start or not complete.all(axis=1).any() or len(tip) < 10:
        return None
    widest = float(np.linalg.norm(np.ptp(tip, axis=0)))
    shape = recording.drop_vars([name for name in ("pressure", "actuation") if name in recording])
    for _ in range(TRIES):
        try:
            begin, end = rest_window(cut_time(shape, float(time[start]), float(time[-1])))
        except InputError:
            return None
        still = position[(time >= begin) & (time <= end), -1]
        away = np.linalg.norm(np.nanmedian(still, axis=0) - np.median(tip[:10], axis=0))
        if away < NEAR * widest:
            return [round(begin, 3), round(end, 3)]
        start = int(np.searchsorted(time, end, side="right")) + 1
        if start >= len(time) - 10:
            return None
    return None


def nearest_rest(recording: xr.Dataset) -> list[float] | None:
    """Return the times [start, end] [s] at which a body that is never at rest is nearest to it: the end of a decay,
    else the first frames. None if the body is at rest at some time.
    """
    try:
        rest_window(recording)
    except InputError:
        time, tip = recording["time"].values, recording["position"].values[:, -1]
        last = time > time[-1] - END * (time[-1] - time[0])
        spread = [float(np.linalg.norm(np.nanstd(part, axis=0))) for part in (tip[last], tip)]
        calm = time[last] if spread[0] < CALM * spread[1] else time[:FIRST_FRAMES]
        return [round(float(calm[0]), 3), round(float(calm[-1]), 3)]
    return None
