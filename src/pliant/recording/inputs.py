"""Functions that list, copy and interpolate the actuation inputs measured in a recording, with pressures first."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pliant.recording.rules import INPUT_UNITS

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray


class RecordedInput(NamedTuple):
    """One measured actuation input: its name, kind (such as pressure), unit, times [s] and values."""

    name: str  # "" for the only pressure of a recording
    kind: str  # pressure, tension, displacement or angle
    unit: str
    time: NDArray  # (P,) s
    values: NDArray  # (P,) SI


def recorded_inputs(recording: xr.Dataset) -> list[RecordedInput]:
    """Return all measured actuation inputs of a recording, pressures first, each with its own sample times."""
    found = []
    if "pressure" in recording:
        values = recording["pressure"].values.reshape(recording.sizes["pressure_time"], -1)
        names = [str(c) for c in recording["chamber"].values] if "chamber" in recording["pressure"].dims else [""]
        clock = recording["pressure_time"].values
        found += [RecordedInput(n, "pressure", "Pa", clock, v) for n, v in zip(names, values.T, strict=True)]
    if "actuation" in recording:
        clock, kinds = recording["input_time"].values, [str(k) for k in recording["kind"].values]
        for name, kind, values in zip(recording["input"].values, kinds, recording["actuation"].values.T, strict=True):
            found.append(RecordedInput(str(name), kind, INPUT_UNITS[kind], clock, values))
    return found


def inputs_on_one_clock(recording: xr.Dataset) -> list[RecordedInput]:
    """Return the measured inputs whose clock is compared with that of the shape: all if they share their sample times,
    else the pressures.
    """
    inputs = recorded_inputs(recording)
    shared = all(np.array_equal(one.time, inputs[0].time) for one in inputs)
    return inputs if shared else [one for one in inputs if one.kind == "pressure"]


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
    rows = [np.interp(time, one.time, one.values) for one in recorded_inputs(recording)]
    return np.stack(rows, -1) if rows else np.zeros((len(time), 0))
