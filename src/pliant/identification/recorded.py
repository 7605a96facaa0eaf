"""Functions that read positions, angles, arc lengths, inputs and excitation of a recording for an experiment."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import xarray as xr

from pliant.errors import InputError
from pliant.recording.inputs import recorded_inputs

Array = np.ndarray
Excitation = Literal["trace", "pulse", "step", "release"]


def recorded_places(recording: xr.Dataset, stations: tuple[str, ...]) -> Array:
    """Return the positions (T, S, 2) [m] of the stations, (T, S, 3) in space; NaN throughout for angles only."""
    if "position" not in recording:
        return np.full((recording.sizes["time"], len(stations), 2), np.nan)
    return np.asarray(recording["position"].sel(station=list(stations)).values, dtype=float)


def recorded_angles(name: str, recording: xr.Dataset, stations: tuple[str, ...], *, wanted: bool) -> dict[str, Any]:
    """Return the angles and their reference, or the orientations in space, as arguments of `Experiment`."""
    if not wanted:
        return {}
    if recording.attrs.get("frame") == "spatial":
        if "quaternion" not in recording:
            raise InputError(f"recording {name} has no orientations to fit: set angles to false")
        return {"orientation": recording["quaternion"].sel(station=list(stations)).values.astype(float)}
    if "angle" not in recording:
        raise InputError(f"recording {name} has no angles to fit: set angles to false")
    angle = recording["angle"]
    reference = str(angle.attrs.get("reference", "base"))
    return {"angle": angle.sel(station=list(stations)).values.astype(float), "angle_reference": reference}


def dense_arc_length(recording: xr.Dataset, stations: tuple[str, ...]) -> Array | None:
    """Return the arc lengths (S,) [m] of the stations, or None unless the recording has them in rising order."""
    if "arc_length" not in recording.coords or len(stations) < 2:
        return None
    s = recording["arc_length"].sel(station=list(stations)).values.astype(float)
    return s if np.all(np.diff(s) > 0) else None


def one_chamber(name: str, pressure: xr.DataArray) -> Array:
    """Return the samples (P,) [Pa] of the recording's only pressure; raise InputError if it has several chambers."""
    if pressure.ndim > 1 and pressure.sizes["chamber"] > 1:
        chambers = ", ".join(str(c) for c in pressure["chamber"].values)
        raise InputError(
            f"recording {name} has several pressures ({chambers}): select the one that bends the body, or state with "
            "drive which of them drives which chamber of the model"
        )
    return np.asarray(pressure.values, dtype=float).reshape(pressure.shape[0])


def only_input(name: str, recording: xr.Dataset) -> tuple[Array, Array]:
    """Return the times [s] and samples (P,) of the recording's only measured input, or raise InputError."""
    if "pressure" in recording and "actuation" not in recording:
        return recording["pressure_time"].values, one_chamber(name, recording["pressure"])
    inputs = recorded_inputs(recording)
    if len(inputs) != 1:
        listed = ", ".join(one.name or one.kind for one in inputs) or "none"
        raise InputError(f"recording {name} has {len(inputs)} measured inputs ({listed}): state with drive which of "
                         "them drives which input of the model")  # fmt: skip
    return inputs[0].time, np.array(inputs[0].values)


def default_excitation(name: str, recording: xr.Dataset) -> Excitation:
    """Return the excitation that the recording's inputs imply: "trace" if measured, "pulse" for a nominal pressure."""
    if {"pressure", "actuation"} & set(recording):
        return "trace"
    if "nominal_pressure" in recording.attrs:
        return "pulse"
    raise InputError(
        f"recording {name} has neither a measured pressure nor a nominal level: state nominal_pressure, "
        "or excitation 'release' for a body that was let go"
    )
