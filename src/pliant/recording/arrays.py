"""Build recordings from the named arrays of NumPy and MATLAB files, with options that state names and units."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from pliant.errors import InputError, inside
from pliant.recording.clock import SECONDS, since_1970
from pliant.recording.column_names import parted
from pliant.recording.mapping import FileMapping, shorten
from pliant.recording.schema import make_recording
from pliant.units import PASCAL, DrivenBy, metre_per, newton_per, pascal_per, radian_per

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import xarray as xr
    from numpy.typing import NDArray

INPUT_SI = {"tension": newton_per, "displacement": metre_per, "angle": radian_per}
POSE = 7  # numbers of a position and an orientation, which is left out
UNIT, MOST = 1e-2, 0.95  # deviation of the norm of a quaternion, and least part of the frames
POSITIONS = "positions of the stations"  # name of the array that joins those of the stations
RATES = ("rate_hz", "frame_rate", "sample_rate", "sampling_rate", "fs")  # usual names of a frame rate [Hz]
USUAL_NAMES = {
    "time": ("time", "t"),
    "position": ("position", "positions", "xyz", "points"),
    "quaternion": ("quaternion",),
    "pressure_time": ("pressure_time", "t_p"),
    "strain": ("strain",),
    "gauge_position": ("gauge_position",),
    "arc_length": ("arc_length", "s"),
}
PRESSURE_NAMES = {"pressure": "pa"} | {f"{start}_{unit}": unit for start in ("p", "pressure") for unit in PASCAL}


class ArrayMapping(FileMapping):
    """Options that name the arrays of a .npz or .mat file (time, position, pressure, ...) and state their units.

    Attributes
    ----------
    time, position, quaternion, pressure, pressure_time, strain, gauge_position, arc_length : str, optional
        Name of each array in the file. Default: the usual names, such as ``time`` or ``t``. Positions may also be a
        table with an array (T, 3), or the arrays of x, y and z, for each station, from base to tip.
    actuation, input_kind, input_unit, input_names : optional
        Array (T) or (T, I) of inputs other than pressure, their kind (tension, displacement or angle), unit and names.
    rate_hz : float, optional
        Frame rate where there is no array of time.
    length_unit : str
        Unit of position, arc length and gauge position. Default m.
    pressure_unit : str, optional
        Unit of `pressure`. Needed when the array is named here, unless its name contains the unit, as ``p_kpa`` does.
    station : list of str, optional
        Names of the stations, from base to tip.
    order : str
        Meaning of the dimensions of `position`: any order of the letters t (time), s (station), a (axis). With names
        in `station`, x, y, z of one station after the other may also lie in the columns of a table.
    trial : int, optional
        Index, from 0, of the trial to read, where `position` has the trials as an additional first dimension. A
        pressure with one value for each trial is then the nominal pressure.
    """

    time: str | None = None
    position: str | dict[str, str | list[str]] | None = None
    quaternion: str | None = None
    pressure: str | None = None
    pressure_time: str | None = None
    strain: str | None = None
    gauge_position: str | None = None
    arc_length: str | None = None
    rate_hz: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    length_unit: str = "m"
    pressure_unit: str | None = None
    station: list[str] | None = None
    order: str = Field(default="tsa", pattern="^(tsa|tas|sta|sat|ats|ast)$")
    trial: int | None = Field(default=None, ge=0)
    actuation: str | None = None
    input_kind: DrivenBy | None = None
    input_unit: str | None = None
    input_names: list[str] | None = None


def recording_from_arrays(
    arrays: Mapping[str, Any], mapping: Mapping[str, Any] | None, file: str, *, others: Sequence[str] = ()
) -> xr.Dataset:
    """Build a recording from the named arrays of a .npz or .mat file; `mapping` states which array is which, and the
    units.

    `others` are names of entries of the file that are not numeric. They and all unused arrays are listed in the
    history.
    """
    options = ArrayMapping.load(mapping, file)
    history = list[str]()
    if isinstance(options.position, dict):
        arrays, options, history = _by_station(arrays, options, options.position, file)
    by_role = {role: _find(arrays, role, getattr(options, role), file) for role in USUAL_NAMES}
    timed = {role: _in_seconds(by_role[role], getattr(options, role), file) for role in ("time", "pressure_time")}
    by_role |= {role: time for role, (time, _) in timed.items()}
    pressure_name, pressure = _pressure(arrays, options, file)
    scale = metre_per(options.length_unit)
    position = by_role["position"]
    history += _unused(arrays, options, pressure_name, others, file)
    history += [line for _, said in timed.values() for line in said]
    level = None
    if options.trial is not None:
        position, pressure, level = _one_trial(position, pressure, options.trial, file)
    if position is not None:
        position = _ordered(_side_by_side(position, options), options.order, file) * scale
        if position.shape[-1] == 2:
            position = np.concatenate([position, np.zeros((*position.shape[:2], 1))], -1)
            history.append("stations with two coordinates got z = 0")
    inputs = _inputs(arrays, options, file)
    if position is None and by_role["strain"] is None and pressure is None and not inputs:
        raise InputError(f"{file} holds no position, strain or pressure under a usual name: name them in the "
                         f"mapping. Its arrays are: {_listing(arrays)}")
    rated = options if by_role["time"] is not None else _with_rate(options, arrays)
    time, log_time = _clock(by_role, position, rated, file), by_role["pressure_time"]
    shapeless = position is None and by_role["strain"] is None
    with inside(file):
        return make_recording(
            None if shapeless else time, position, quaternion=by_role["quaternion"],
            station=options.station if position is not None else None,
            pressure=pressure, pressure_time=time if log_time is None else np.ravel(log_time),
            input_time=time if log_time is None else np.ravel(log_time), **inputs,
            strain=by_role["strain"], gauge_position=_scaled(by_role["gauge_position"], scale), nominal_pressure=level,
            arc_length=_scaled(by_role["arc_length"], scale), history=history,
        )  # fmt: skip


def _in_seconds(time: NDArray | None, name: str | None, file: str) -> tuple[NDArray | None, list[str]]:
    """Return an array of times [s], by the unit at the end of its name or, since 1970, by their size; and a sentence
    for the history where their unit is another.
    """
    unit = parted(name.rpartition(".")[2])[1] if name else ""
    if time is None or not time.size:
        return time, []
    if unit in SECONDS and unit != "s":
        return time * SECONDS[unit], [f"the times of {file} are in {unit}, as the name {name} says"]
    unit, said = since_1970(np.ravel(time), "s", file)
    return time * SECONDS[unit], said


def trials_in_arrays(
    arrays: Mapping[str, Any], mapping: Mapping[str, Any] | None, file: str
) -> dict[str, dict[str, Any]]:
    """Return the options of each trial of a file whose positions have the trials as an additional first dimension, by
    the number of the trial; empty for any other file, or where the mapping states the trial.
    """
    options = ArrayMapping.load(mapping, file)
    if options.trial is not None or isinstance(options.position, dict):
        return {}
    position = _find(arrays, "position", options.position, file)
    if position is None or position.ndim != 4:
        return {}
    return {str(k): {**(mapping or {}), "trial": k} for k in range(len(position))}


def _by_station(
    arrays: Mapping[str, Any], options: ArrayMapping, stations: Mapping[str, str | list[str]], file: str
) -> tuple[Mapping[str, Any], ArrayMapping, list[str]]:
    """Return the arrays, with one array of all positions (T, S, 3) in place of those of each station, the options that
    name it, and a sentence on what was left out.
    """
    parts, turned = [], []
    for name, listed in stations.items():
        columns = [_find(arrays, f"station {name}", key, file) for key in ([listed] if isinstance(listed, str) else
                                                                          listed)]  # fmt: skip
        part = np.column_stack([np.squeeze(column) for column in columns if column is not None])
        if part.shape[1] == POSE and part.shape[0] > POSE - len("wxyz"):
            part = _place(part, name, file)
            turned.append(name)
        parts.append(part.T if part.shape[0] in (2, 3) and part.shape[0] < part.shape[1] else part)
    if len({part.shape for part in parts}) > 1 or parts[0].shape[1] not in (2, 3):
        shapes = ", ".join(f"{name} {part.shape}" for name, part in zip(stations, parts, strict=True))
        raise InputError(f"{file}: the positions of the stations must have equal lengths and 2 or 3 coordinates, but "
                         f"are {shapes}: correct position in the mapping")
    used = {key for listed in stations.values() for key in ([listed] if isinstance(listed, str) else listed)}
    rest = {name: array for name, array in arrays.items() if name not in used}
    update = {"position": POSITIONS, "station": list(stations), "order": "tsa"}
    left = [f"orientations of {shorten(turned)} in {file} were left out"] if turned else []
    return rest | {POSITIONS: np.stack(parts, axis=1)}, options.model_copy(update=update), left


def are_quaternions(rows: NDArray) -> bool:
    """Return whether nearly all rows (T, 4) are quaternions of norm 1."""
    norm = np.linalg.norm(rows, axis=1)
    return bool(norm.size and np.mean(np.abs(norm - 1.0) < UNIT) > MOST)


def _place(pose: NDArray, station: str, file: str) -> NDArray:
    """Return the positions (T, 3) of poses (T, 7) whose last four numbers are quaternions; refuse others."""
    if not are_quaternions(pose[np.isfinite(pose).all(axis=1), 3:]):
        raise InputError(f"{file}: the array of station {station} has 7 columns, whose last four are not quaternions "
                         "of norm 1: store x, y, z first, or name arrays of positions alone")
    return pose[:, :3]


def _inputs(arrays: Mapping[str, Any], options: ArrayMapping, file: str) -> dict[str, Any]:
    """Return the arguments of `make_recording` for inputs other than pressure."""
    if options.actuation is None:
        return {}
    if options.input_kind is None or options.input_unit is None:
        raise InputError(f"{file}: actuation of the mapping needs input_kind (tension, displacement or angle) and "
                         "input_unit: add them")
    values = np.squeeze(np.asarray(_find(arrays, "actuation", options.actuation, file)))
    values = values[:, None] if values.ndim == 1 else values
    return {"actuation": values * INPUT_SI[options.input_kind](options.input_unit), "input_kind": options.input_kind,
            "input_names": options.input_names}  # fmt: skip


def _one_trial(
    position: NDArray | None, pressure: NDArray | None, trial: int, file: str
) -> tuple[NDArray, NDArray | None, float | None]:
    """Return position and pressure of one trial, and the nominal pressure [Pa] where each trial has one number."""
    if position is None or position.ndim != 4:
        shape = "none" if position is None else f"one of shape {position.shape}"
        raise InputError(
            f"{file}: `trial` needs positions of four dimensions (trials, frames, stations, axes), but holds {shape}: "
            "remove `trial` from the mapping"
        )
    if trial >= len(position):
        raise InputError(f"{file} has no trial {trial}: choose one of 0 to {len(position) - 1}")
    if pressure is None:
        return position[trial], None, None
    if len(pressure) != len(position):
        raise InputError(f"{file} has {len(position)} trials, but its pressure has {len(pressure)} rows: store one "
                         "value or row of pressure per trial")
    row = pressure[trial]
    return (position[trial], None, float(row)) if row.ndim == 0 else (position[trial], row, None)


def _unused(
    arrays: Mapping[str, Any], options: ArrayMapping, pressure: str | None, others: Sequence[str], file: str
) -> list[str]:
    used = {pressure, options.actuation, *RATES}
    idle = ("pressure_time",) if pressure is None else ()
    for role, names in USUAL_NAMES.items():
        if role in idle:
            continue
        named = getattr(options, role)
        named = named if isinstance(named, str) else None
        used |= {named} if named else set(names)
    left = [*(name for name in arrays if name not in used), *others]
    return [f"{len(left)} array(s) of {file} were not used: {shorten(left)}"] if left else []


def _listing(arrays: Mapping[str, Any]) -> str:
    return ", ".join(f"{k} {np.shape(v)}" for k, v in list(arrays.items())[:30]) or "none"


def _find(arrays: Mapping[str, Any], role: str, name: str | None, file: str) -> NDArray | None:
    names = USUAL_NAMES[role] if name is None else (name,)
    present = [n for n in names if n in arrays]
    if name is not None and not present:
        raise InputError(f"{file} has no array {name!r} for {role}: set {role} in the mapping to one of "
                         f"{_listing(arrays)}")
    if len(present) > 1:
        raise InputError(f"{file} has {' and '.join(present)}, which are both usual names of {role}: set {role} in "
                         "the mapping to one of them")
    return numbers(arrays[present[0]], f"the array {present[0]} of {file}") if present else None


def numbers(value: Any, name: str, remedy: str = "store it as floats") -> NDArray:
    """Return an array as float64; raise InputError, which ends in `remedy`, where it holds other than real numbers."""
    array = np.asarray(value)
    if array.dtype.kind not in "iufb":
        raise InputError(f"{name} must hold real numbers, but has the type {array.dtype}: {remedy}")
    return array.astype(np.float64)


def texts(values: NDArray) -> list[str]:
    """Return the texts in an array of str or bytes, such as the names of points in an HDF5 file."""
    return [v.decode("utf-8", "replace") if isinstance(v, bytes) else str(v) for v in np.ravel(values)]


def _pressure(
    arrays: Mapping[str, Any], options: ArrayMapping, file: str
) -> tuple[str | None, NDArray | None]:
    if options.pressure is not None:
        if options.pressure not in arrays:
            raise InputError(f"{file} has no array {options.pressure!r}: set pressure in the mapping to one of "
                             f"{_listing(arrays)}")
        unit = options.pressure_unit or PRESSURE_NAMES.get(options.pressure.lower())
        if unit is None:
            raise InputError(f"the unit of {options.pressure!r} in {file} is unknown: set pressure_unit in the mapping")
        name = options.pressure
    else:
        present = [n for n in PRESSURE_NAMES if n in arrays]
        present = present or [n for n in arrays if n.lower() in PRESSURE_NAMES and n.lower() != "pressure"]  # p_kPa
        if len(present) > 1:
            raise InputError(f"{file} has several pressures: {', '.join(present)}; set pressure in the mapping to "
                             "one of them")
        if not present:
            return None, None
        name, unit = present[0], options.pressure_unit or PRESSURE_NAMES[present[0].lower()]
    values = np.squeeze(numbers(arrays[name], f"the array {name} of {file}"))
    return name, np.atleast_1d(values) * pascal_per(unit)


def _side_by_side(position: NDArray, options: ArrayMapping) -> NDArray:
    """Return positions (T, S * N) of as many stations as the mapping names, N coordinates side by side for each, as
    (T, S, N); other positions unchanged.
    """
    count = len(options.station or ())
    if position.ndim == 2 and position.shape[1] > 3 and not count and options.order == "tsa":
        raise InputError(f"position has {position.shape[1]} columns: if they are x, y, z of one station after another, "
                         'name the stations in the mapping, such as station = ["base", "tip"]; else state order')
    if position.ndim != 2 or count < 2 or position.shape[1] not in (2 * count, 3 * count) or options.order != "tsa":
        return position
    return position.reshape(len(position), count, -1)


def _ordered(position: NDArray, order: str, file: str) -> NDArray:
    if position.ndim == 2 and "s" in order:  # a single station
        position = np.expand_dims(position, order.index("s"))
    if position.ndim != 3:
        raise InputError(f"position in {file} must have 2 or 3 dimensions, but its shape is {position.shape}: store "
                         "it as (frames, stations, axes). If its first dimension is the trial, set trial = 0 in the "
                         "mapping; `pliant new` makes a recording of each")
    return np.transpose(position, [order.index(letter) for letter in "tsa"])


def _with_rate(options: ArrayMapping, arrays: Mapping[str, Any]) -> ArrayMapping:
    """Return the options with the frame rate that a file states under a usual name, where the mapping states none."""
    rates = [float(np.ravel(arrays[name])[0]) for name in RATES if name in arrays and np.size(arrays[name]) == 1]
    if options.rate_hz is not None or len(rates) != 1 or not rates[0] > 0:
        return options
    return options.model_copy(update={"rate_hz": rates[0]})


def _clock(found: Mapping[str, Any], position: Any, options: ArrayMapping, file: str) -> NDArray | None:
    if found["time"] is not None and options.rate_hz is not None:
        raise InputError(f"{file} has an array of times: remove rate_hz from the mapping")
    if found["time"] is not None:
        return np.ravel(found["time"])
    first = position if position is not None else found["strain"]
    if first is None:
        return None
    if options.rate_hz is None:
        raise InputError(f"{file} has no array of times under a usual name: set time (the name of the array) or "
                         "rate_hz in the mapping")
    return np.arange(len(first)) / options.rate_hz


def _scaled(value: NDArray | None, scale: float) -> NDArray | None:
    return None if value is None else np.ravel(value) * scale
