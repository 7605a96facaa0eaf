"""Resample a recording in time or along the body. New samples too far from a measured one become NaN."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pliant.equations.observation import FURTHER
from pliant.errors import InputError
from pliant.preprocessing.arc_length import station_arc_length
from pliant.preprocessing.rotations import continuous
from pliant.recording import append_history, check_recording, make_recording
from pliant.recording.rules import CONSTANTS, shape_values, shape_variable
from pliant.recording.schema import VARIABLES, refuse_loss

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import ArrayLike, NDArray

LEAST_STATIONS = 4  # a cubic needs four points
GAP_RATIO = 2.5
OF_STATIONS = ("time", "station")
TOUCH = 1e-12  # m: a new station that is this close to an old one coincides with it


def resample_time(
    recording: xr.Dataset, *, rate_hz: float | None = None, time: ArrayLike | None = None, longest_gap_s: float
) -> xr.Dataset:
    """Return the recording with its shape linearly interpolated to a regular frame rate [Hz] or to given times [s].

    Orientations are interpolated by component and normalised. No low-pass filter is applied, so a rate below that of
    the recording causes aliasing. The pressure keeps its own times.

    Parameters
    ----------
    recording : xarray.Dataset
    rate_hz : float, optional
        New frame rate, starting at the first frame.
    time : (T,) array, s, optional
        New times, instead of `rate_hz`.
    longest_gap_s : float
        Longest time between two measured samples to interpolate over; new samples in longer gaps are NaN.
    """
    check_recording(recording)
    if not shape_variable(recording):
        raise InputError("resample_time needs positions, but the recording holds none: leave this step out")
    if (rate_hz is None) == (time is None):
        raise InputError("resample_time needs exactly one of rate_hz and time: set one of them")
    if not longest_gap_s > 0:
        raise InputError(f"longest_gap_s must be positive, not {longest_gap_s!r}")
    if rate_hz is not None and not 0 < rate_hz < np.inf:
        raise InputError(f"rate_hz must be positive and finite, not {rate_hz!r}")
    old = recording["time"].values
    if time is None:
        count = int(np.floor((old[-1] - old[0]) * float(rate_hz or 0.0) + 1e-9)) + 1
        new = old[0] + np.arange(count) / float(rate_hz or np.nan)
    else:
        new = np.asarray(time, dtype=np.float64)
    arrays = {n: recording[n].values for n in VARIABLES if n in recording and recording[n].dims[:2] == OF_STATIONS}
    if "quaternion" in arrays:
        arrays["quaternion"] = continuous(arrays["quaternion"])[0]
    resampled = {n: in_time(old, value, new, longest_gap_s) for n, value in arrays.items()}
    for name in {"quaternion", "gravity"} & set(resampled):
        norm = np.linalg.norm(resampled[name], axis=-1, keepdims=True)
        resampled[name] = resampled[name] / np.where(norm > 0.1, norm, np.nan)
    result = _with(recording.drop_dims("time"), recording, resampled, time=new)
    refuse_loss(recording, result, "resample_time", ("strain",))
    empty = int(np.isnan(shape_values(result)).any(-1).sum())
    bridged = f"gaps up to {longest_gap_s:g} s bridged, {empty} points missing"
    return append_history(result, f"resampled from {len(old)} to {len(new)} frames, {bridged}")


def pressure_on_shape_clock(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording with its pressure interpolated to the times of the shape. The pressure is NaN before the
    first and after the last pressure sample.
    """
    check_recording(recording)
    if "pressure" not in recording or "time" not in recording.coords:
        raise InputError("pressure_on_shape_clock needs a shape and a pressure, but the recording lacks one of them: "
                         "leave this step out")
    clock, time = recording["pressure_time"].values, recording["time"].values
    values = recording["pressure"].values.reshape(len(clock), -1)
    new = np.stack([np.interp(time, clock, v, left=np.nan, right=np.nan) for v in values.T], -1)
    chamber = [str(c) for c in recording["chamber"].values] if "chamber" in recording.coords else None
    resampled = make_recording(
        pressure=new if chamber else new[:, 0], pressure_time=time, chamber=chamber, attrs=dict(recording.attrs)
    )
    rest = recording.drop_dims("pressure_time").drop_vars("chamber", errors="ignore")
    missing = int(np.isnan(new).any(1).sum())
    line = f"pressure interpolated from {len(clock)} samples to the times of the shape, {missing} samples missing"
    return append_history(rest.merge(resampled, combine_attrs="override").assign_attrs(recording.attrs), line)


def resample_arc_length(
    recording: xr.Dataset, *, spacing_mm: float, longest_gap_mm: float | None = None
) -> xr.Dataset:
    """Return the recording with its positions interpolated, frame by frame, to stations of equal spacing along the
    body, by cubic splines.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording with at least four stations from base to tip. Their arc length is the recorded one or the time-mean
        sum of chords.
    spacing_mm : float
        Spacing of the new stations, from the first station on; the remainder at the tip is left out.
    longest_gap_mm : float, optional
        Longest distance between two measured stations to interpolate over; new stations in longer gaps are NaN.
        Default: 2.5 times the largest spacing of the stations, so that one lost station is bridged.

    Returns
    -------
    xarray.Dataset
        The recording with positions only, as orientations cannot be interpolated along the body.
    """
    check_recording(recording)
    count = recording.sizes["station"] if "position" in recording else 0
    if count < LEAST_STATIONS:
        raise InputError(f"resampling along the body needs positions of at least {LEAST_STATIONS} stations, but the "
                         f"recording has {count}: leave this step out")
    if not 0 < spacing_mm < np.inf:
        raise InputError(f"spacing_mm must be positive and finite, not {spacing_mm!r}")
    position = recording["position"].values
    whole = np.isfinite(position).all((1, 2))
    if not whole.any():
        raise InputError("no frame has all stations, so their arc length is unknown: give the recording an arc_length")
    arc, findings = station_arc_length(recording, position[whole])
    if arc[-1] < spacing_mm * 1e-3:
        raise InputError(f"the spacing of {spacing_mm:g} mm is longer than the body, {1e3 * arc[-1]:.3g} mm: choose "
                         "a smaller spacing_mm")
    new = np.arange(int(np.floor(arc[-1] / (spacing_mm * 1e-3) + 1e-9)) + 1) * spacing_mm * 1e-3
    gap = GAP_RATIO * float(np.diff(arc).max()) if longest_gap_mm is None else longest_gap_mm * 1e-3
    resampled = _along(arc, position, new, gap)
    names = [f"s{i:03d}" for i in range(len(new))]
    result = _with(recording.drop_dims("station"), recording, {"position": resampled}, station=names, arc_length=new)
    refuse_loss(recording, result, "resample_arc_length", ("quaternion", "angle", "strain"))
    empty = int(np.isnan(resampled).any(-1).sum())
    line = (f"resampled from {len(arc)} to {len(new)} stations every {spacing_mm:g} mm ({findings[0]}), "
            f"{1e3 * (arc[-1] - new[-1]):.3g} mm left over at the tip, {empty} points missing")  # fmt: skip
    return append_history(result, line)


def in_time(old: NDArray, values: NDArray, new: NDArray, longest: float) -> NDArray:
    """Interpolate values (T, S, ...) of S stations at T times `old` [s] linearly to the times `new` (U,) [s], and
    return them (U, S, ...), for each station over the frames in which it was seen.

    The result is NaN where the seen frames before and after are more than `longest` [s] apart.
    """
    flat = values.reshape(*values.shape[:2], -1)
    result = np.full((len(new), *flat.shape[1:]), np.nan)
    for s in range(flat.shape[1]):
        finite = np.isfinite(flat[:, s]).all(-1)
        if not finite.any():
            continue
        known = old[finite]
        right = np.clip(np.searchsorted(known, new, side="left"), 0, len(known) - 1)
        left = np.clip(np.searchsorted(known, new, side="right") - 1, 0, len(known) - 1)
        good = (new >= known[0]) & (new <= known[-1]) & (known[right] - known[left] <= longest)
        for axis in range(flat.shape[2]):
            result[good, s, axis] = np.interp(new[good], known, flat[finite, s, axis])
    return result.reshape(len(new), *values.shape[1:])


def _along(arc: NDArray, position: NDArray, new: NDArray, gap: float) -> NDArray:
    """Interpolate positions to arc lengths `new` by cubic splines over the stations that each frame has.

    A spline is linear in its points, so one matrix of weights serves all frames with the same stations.
    """
    from scipy.interpolate import CubicSpline

    result = np.full((len(position), len(new), position.shape[2]), np.nan)
    finite = np.isfinite(position).all(2)
    patterns = finite[:1] if finite.all() else np.unique(finite, axis=0)
    for pattern in patterns:
        if pattern.sum() < LEAST_STATIONS:
            continue
        rows, known = np.flatnonzero((finite == pattern).all(1)), arc[pattern]
        right, left = np.searchsorted(known, new - TOUCH), np.searchsorted(known, new + TOUCH) - 1
        inside = np.flatnonzero((left >= 0) & (right < known.size))
        good = inside[known[right[inside]] - known[left[inside]] <= gap]
        weights = CubicSpline(known, np.eye(len(known)))(new[good])
        points = position[rows] if pattern.all() else position[np.ix_(rows, np.flatnonzero(pattern))]
        for axis in range(position.shape[2]):
            result[rows[:, None], good, axis] = points[..., axis] @ weights.T
    return result


def _with(kept: xr.Dataset, recording: xr.Dataset, arrays: dict, **coords: object) -> xr.Dataset:
    """Return the recording with new arrays; variables without the replaced dimension are kept."""
    station = coords.get("station", [str(n) for n in recording["station"].values])
    arc = coords.get("arc_length", recording["arc_length"].values if "arc_length" in recording.coords else None)
    constants = {str(n): kept[n].values for n in kept.data_vars if str(n).endswith(CONSTANTS)}
    resampled = make_recording(
        coords.get("time", recording["time"].values), station=station, arc_length=arc,  # type: ignore[arg-type]
        frame=recording.attrs["frame"], attrs=dict(recording.attrs),
        further={n: array for n, array in arrays.items() if n in FURTHER} | constants,
        **{n: array for n, array in arrays.items() if n not in FURTHER},
        angle_reference=next((recording[n].attrs["reference"] for n in ("angle", "quaternion", "gravity") if n in arrays
                              and "reference" in recording[n].attrs), "rest"),
    )  # fmt: skip
    others = {n: kept[n] for n in kept.data_vars if n in ("pressure", "actuation")}
    return resampled.assign(others).assign_attrs(recording.attrs)
