"""Functions that list, copy and interpolate the actuation inputs measured in a recording, with pressures first."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pliant.recording.rules import COMPONENTS, INPUT_UNITS, VARIABLES, check_recording

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import ArrayLike, NDArray

class RecordedInput(NamedTuple):
    """One measured actuation input: its name, kind (such as pressure), unit, times [s] and values."""

    name: str  # "" for the only pressure of a recording
    kind: str  # pressure, tension, displacement or angle
    unit: str
    time: NDArray  # (P,) s
    values: NDArray  # (P,) SI


def recorded_inputs(recording: xr.Dataset) -> list[RecordedInput]:
    """Return all measured actuation inputs of a recording, pressures first, each with its own sample times."""
    inputs = []
    if "pressure" in recording:
        values = recording["pressure"].values.reshape(recording.sizes["pressure_time"], -1)
        names = [str(c) for c in recording["chamber"].values] if "chamber" in recording["pressure"].dims else [""]
        clock = recording["pressure_time"].values
        inputs += [RecordedInput(n, "pressure", "Pa", clock, v) for n, v in zip(names, values.T, strict=True)]
    if "actuation" in recording:
        clock, kinds = recording["input_time"].values, [str(k) for k in recording["kind"].values]
        for name, kind, values in zip(recording["input"].values, kinds, recording["actuation"].values.T, strict=True):
            inputs.append(RecordedInput(str(name), kind, INPUT_UNITS[kind], clock, values))
    return inputs


def inputs_on_one_clock(recording: xr.Dataset) -> list[RecordedInput]:
    """Return the measured inputs whose clock is compared with that of the shape: all if they share their sample times,
    else the pressures.
    """
    inputs = recorded_inputs(recording)
    shared = all(np.array_equal(entry.time, inputs[0].time) for entry in inputs)
    return inputs if shared else [entry for entry in inputs if entry.kind == "pressure"]


def input_arguments(recording: xr.Dataset) -> dict[str, Any]:
    """Return all inputs of a recording, with their names and times, as keyword arguments for `make_recording`, so that
    a new recording receives the same inputs.
    """
    names = {"pressure": "pressure", "pressure_time": "pressure_time", "chamber": "chamber", "actuation": "actuation",
             "input_time": "input_time", "input_names": "input", "input_kind": "kind"}  # fmt: skip
    return {argument: recording[name].values for argument, name in names.items() if name in recording.variables}


def inputs_at(recording: xr.Dataset, time: NDArray) -> NDArray:
    """Return the C measured inputs (T, C), linearly interpolated at T times `time` [s]. Beyond its ends an input keeps
    its first or last value.

    C is 0 for a recording without inputs.
    """
    rows = [np.interp(time, entry.time, entry.values) for entry in recorded_inputs(recording)]
    return np.stack(rows, -1) if rows else np.zeros((len(time), 0))


POSES = ("base_position", "base_angle", "base_quaternion")
CUTOFF = "base_cutoff"  # attribute of a recording


def with_base_motion(
    recording: xr.Dataset, position: ArrayLike, *, angle: ArrayLike | None = None,
    quaternion: ArrayLike | None = None, cutoff: float | str | None = None,
) -> xr.Dataset:
    """Return an aligned recording with the motion of its base as an input of the body.

    The positions and angles of the stations are then relative to the moved base.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording in the frame planar or spatial.
    position : (T, 2), in space (T, 3) array, m
        Position of the base frame's origin in the axes of the base frame at rest; NaN marks an unknown pose.
    angle : (T,) array, rad, optional
        In the plane: angle of the base frame about +z since rest.
    quaternion : (T, 4) array, optional
        In space: rotation of the base frame since rest, x, y, z, w.
    cutoff : float (Hz), "auto" or None
        Smoothing of the motion for its derivatives, see `pliant.simulation.BaseMotion`.

    Raises
    ------
    InputError
        When the shapes or the frame do not match.
    """
    poses: dict[str, Any] = {"base_position": position, "base_angle": angle, "base_quaternion": quaternion}
    added = recording.copy()
    for name, values in poses.items():
        if values is not None:
            (dims,), units, long_name = VARIABLES[name]
            about = {"units": units, "long_name": long_name}
            added[name] = (dims, np.array(values, dtype=np.float64), about)
    if quaternion is not None:
        added = added.assign_coords(component=list(COMPONENTS))
    if cutoff is not None:
        added.attrs[CUTOFF] = cutoff
    return check_recording(added)


def base_moves(recording: xr.Dataset) -> bool:
    """Return whether a recording holds the motion of its base as an input."""
    return "base_position" in recording


def keep_base(before: xr.Dataset, after: xr.Dataset) -> xr.Dataset:
    """Return the recording `after`, of the same frames as `before`, with the base motion of `before`, if it has one."""
    poses = {name: before[name] for name in POSES if name in before}
    return after.assign(poses).assign_attrs({CUTOFF: before.attrs[CUTOFF]} if CUTOFF in before.attrs else {})
