"""Functions that build a recording: an `xarray.Dataset` with fixed dimensions, units and attributes.

`make_recording` lists the variables. `check_recording`, in `pliant.recording.rules`, lists what is refused.

See `make_recording` for the variables and `check_recording`, in `pliant.recording.rules`, for what is refused.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.equations.observation import FURTHER
from pliant.errors import InputError
from pliant.recording.lost import REFUSED, counted, unit_poses
from pliant.recording.rules import (
    COMPONENTS,
    CONSTANTS,
    COORDINATES,
    SCHEMA,
    SCHEMA_VERSION,
    VARIABLES,
    check_recording,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import xarray as xr
    from numpy.typing import ArrayLike, NDArray

__all__ = ["COMPONENTS", "COORDINATES", "VARIABLES", "append_history", "check_recording", "make_recording"]


def make_recording(
    time: ArrayLike | None = None,
    position: ArrayLike | None = None,
    *,
    station: Sequence[str] | None = None,
    quaternion: ArrayLike | None = None,
    angle: ArrayLike | None = None,
    angle_reference: str = "rest",
    pressure: ArrayLike | None = None,
    pressure_time: ArrayLike | None = None,
    chamber: Sequence[str] | None = None,
    actuation: ArrayLike | None = None,
    input_time: ArrayLike | None = None,
    input_names: Sequence[str] | None = None,
    input_kind: str | Sequence[str] = "",
    strain: ArrayLike | None = None,
    gauge_position: ArrayLike | None = None,
    core: Sequence[str] | None = None,
    arc_length: ArrayLike | None = None,
    frame: str = "tracker",
    nominal_pressure: float | None = None,
    source: str = "",
    source_format: str = "memory",
    source_sha256: str = "",
    history: str | Sequence[str] = (),
    attrs: dict[str, Any] | None = None,
    further: Mapping[str, ArrayLike] | None = None,
) -> xr.Dataset:
    """Build a recording (`xarray.Dataset`) from arrays such as positions and pressures, which are copied and checked.

    Parameters
    ----------
    time : (T,) array, s
        Sample times of the shape, strictly increasing. May be left out when only pressure was recorded.
    position : (T, S, 3) or, in the frame planar, (T, S, 2) array, m
        Positions of the stations; NaN marks a drop-out. May be left out where only the angles of the stations were
        measured.
    station : S names, optional
        Default ``s000, s001, ...`` from base to tip.
    quaternion : (T, S, 4) array, optional
        Unit quaternions x, y, z, w; NaN where a station has no orientation. Lengths within 0.05 of 1 are normalised. A
        quaternion of another length is a lost station: it and the position of its frame become NaN, and are counted.
    angle : (T, S) array, rad, optional
        Planar recordings only: rotation of a station about +z.
    angle_reference : {"rest", "base"}
        What `angle`, or the `quaternion` of an aligned recording, is measured from: the station's own rest pose, or the
        base tangent (the base frame). For ``gravity`` of `further`: whether only its changes since rest are compared
        with a model, or its values.
    pressure : (P,) or (P, C) array, Pa gauge, optional
        With two dimensions one column per chamber. (P, 1) without `chamber` is stored as (P,).
    pressure_time : (P,) array, s, optional
        Sample times of the pressure; default is `time` when the lengths agree.
    chamber : C names, optional
        Names of the chambers; default ``c000, c001, ...``.
    actuation : (P, I) array, optional
        Inputs other than pressure, in N, m or rad according to `input_kind`, which is needed.
    input_time : (P,) array, s, optional
        Sample times of `actuation`; default is `time` when the lengths agree.
    input_names : I names, optional
        Default ``u000, u001, ...``.
    input_kind : {"tension", "displacement", "angle"} or I of them
        Tension of a tendon, its displacement, or the angle of a motor.
    strain : (T, C, G) array, optional
        Dimensionless strain of each core at each gauge; needs `gauge_position`.
    gauge_position : (G,) array, m, optional
        Position of each gauge along the fibre.
    core : C names, optional
        Default ``core000, core001, ...``.
    arc_length : (S,) array, m, optional
        Arc length of each station from the base.
    frame : {"tracker", "planar", "spatial"}
        Coordinate frame: that of the tracker, or an aligned frame with the base at the origin and the base tangent
        along +y (planar) or +z (spatial).
    nominal_pressure : float, Pa gauge, optional
        Constant pressure during the test, where no pressure was recorded and its switching times are unknown.
    source, source_format, source_sha256 : str
        Name, format and checksum of the file that was read.
    history : str or list of str
        One line per processing step so far.
    attrs : dict, optional
        Further attributes, stored unchanged.
    further : dict, optional
        Values of other kinds of measurement by their variables in `equations.observation.KINDS`, (T, S) or, where the
        variable has a row for each axis, (T, S, d), and the constants (S, k) of their stations by the variable followed
        by ``_constants``. ``gravity`` is the unit vector (T, S, d) of the direction of gravity in the axes of each
        station's link (x to the side, the last axis along the link), as an inertial sensor shows it; its constants
        (S, d) are that direction in the base frame.

    Returns
    -------
    xarray.Dataset
        The recording, all arrays as float64; see `check_recording`.

    Raises
    ------
    InputError
        When an array has the wrong shape or breaks a rule of the schema.

    Examples
    --------
    >>> from pliant.recording import make_recording
    >>> recording = make_recording([0.0, 0.1], [[[0, 0, 0], [0, 0.1, 0]], [[0, 0, 0], [0.01, 0.099, 0]]])
    >>> dict(recording.sizes)
    {'time': 2, 'station': 2, 'axis': 3}
    """
    variables: dict[str, Any] = {}
    coords: dict[str, Any] = {}
    if time is not None:
        coords["time"] = _floats("time", time, 1)
    if strange := [name for name in further or () if name.removesuffix(CONSTANTS) not in FURTHER]:
        raise InputError(f"{strange[0]!r} is not a further kind of measurement ({', '.join(FURTHER) or 'none'}): "
                         "leave it out")  # fmt: skip
    refused: dict[str, dict[str, int]] = {}
    for name, value in {"position": position, "angle": angle, **(further or {})}.items():
        if value is not None:
            dims = VARIABLES[name][0][0]
            array = _floats(name, value, len(dims))
            variables[name] = (dims, array)
            coords.setdefault("station", _names(station, array.shape[dims.index("station")], "station", "s"))
            if "axis" in dims:
                coords.setdefault("axis", _axes(array.shape[2]))
    if quaternion is not None:
        _add_orientation(variables, coords, quaternion, station, refused)
    if arc_length is not None:
        coords["arc_length"] = ("station", _floats("arc_length", arc_length, 1))
    _add_pressure(variables, coords, pressure, pressure_time, chamber)
    _add_inputs(variables, coords, actuation, input_time, input_names, input_kind)
    _add_strain(variables, coords, strain, gauge_position, core)
    recording = _assemble(variables, coords)
    for name in [n for n in ("angle", "quaternion", "gravity") if n in recording and frame != "tracker"]:
        recording[name].attrs["reference"] = angle_reference
    lines = [history] if isinstance(history, str) else list(history)
    recording.attrs = {
        "schema": SCHEMA, "schema_version": SCHEMA_VERSION, "frame": frame, "source": source,
        "source_format": source_format, "source_sha256": source_sha256,
        "pressure_reference": "gauge", "history": "\n".join(line for line in lines if line),
    } | (attrs or {})  # fmt: skip
    if nominal_pressure is not None:
        recording.attrs["nominal_pressure"] = float(nominal_pressure)
    return check_recording(counted(recording, refused) if refused else recording)


def recorded_further(recording: xr.Dataset, stations: Sequence[str]) -> dict[str, tuple[NDArray, NDArray]]:
    """Return the values, (T, S) or (T, S, d), and the constants (S, k) of S stations in T frames for each measured
    variable beside positions, angles and orientations that a recording holds, by the name of the variable.
    """
    names = [name for name in FURTHER if name in recording]
    selected = recording.sel(station=list(stations)) if names else recording
    none = np.zeros((len(stations), 0))
    return {n: (selected[n].values, selected[m].values if (m := n + CONSTANTS) in selected else none) for n in names}


NEEDED = {"position": "positions", "quaternion": "orientations", "pressure": "a pressure", "strain": "strain"}


def check_holds(recording: xr.Dataset, variable: str, step: str, remedy: str = "leave this step out") -> None:
    """Check a recording, and raise InputError if it lacks the variable that a processing `step` needs. The message ends
    in `remedy`.
    """
    check_recording(recording)
    if variable not in recording:
        raise InputError(f"{step} needs {NEEDED[variable]}, but the recording holds none: {remedy}")


def refuse_loss(before: xr.Dataset, after: xr.Dataset, step: str, dropped: Sequence[str] = ()) -> None:
    """Raise InputError if a processing `step` lost a variable of a recording that it does not drop on purpose, because
    the step does not know how to transform it.

    `dropped` holds the names of the variables that the step drops on purpose.
    """
    if lost := [name for name in VARIABLES if name in before and name not in after and name not in dropped]:
        raise InputError(f"{step} would lose {', '.join(lost)} of the recording: leave out this step, or remove "
                         f"{lost[0]} from the recording")  # fmt: skip


def append_history(recording: xr.Dataset, *lines: str) -> xr.Dataset:
    """Return the recording with `lines` appended to its history. The data arrays are shared, not copied."""
    added = (line.replace("\n", " ") for line in lines)
    return recording.assign_attrs(history="\n".join([*history_of(recording), *added]))


def history_of(recording: xr.Dataset) -> list[str]:
    """Return the processing history of a recording, one sentence for each step."""
    return [line for line in str(recording.attrs.get("history", "")).split("\n") if line]


def _floats(name: str, value: ArrayLike, ndim: int) -> NDArray[np.float64]:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be an array of numbers: {error}") from None
    if array.ndim != ndim:
        raise InputError(f"{name} must have {ndim} dimension(s), but its shape is {array.shape}")
    return array


def _names(names: Sequence[str] | None, count: int, what: str, prefix: str) -> NDArray[np.str_]:
    names = [f"{prefix}{i:03d}" for i in range(count)] if names is None else [str(n) for n in names]
    if len(names) != count:
        raise InputError(f"{count} {what}(s) need {count} names, but {len(names)} were given")
    return np.array(names, dtype=str)


def _axes(count: int) -> list[str]:
    if count not in (2, 3):
        raise InputError(f"position needs 2 (planar) or 3 coordinates per station, but has {count}")
    return list("xyz"[:count])


def _add_clock(coords: dict, clock: Any, variable: str, name: str) -> None:
    """Add the sample times of the inputs as the coordinate `name`: `clock`, or the times of the shape."""
    clock = coords.get("time") if clock is None else clock
    if clock is None:
        raise InputError(f"{variable} has no times: pass {name} [s], one time per sample")
    coords[name] = _floats(name, clock, 1)


def _add_orientation(variables: dict, coords: dict, quaternion: Any, station: Any, refused: dict) -> None:
    """Add the orientations of the stations, leave out the positions whose orientation is refused, and count these by
    station in `refused`.
    """
    array = _floats("quaternion", quaternion, 3)
    coords.setdefault("station", _names(station, array.shape[1], "station", "s"))
    dims, position = variables.get("position", ((), None))
    array, position, counts, bare = unit_poses(array, position) if array.shape[2] == len(COMPONENTS) else (
        array, position, np.zeros(0), np.zeros(1, dtype=bool))  # fmt: skip
    for name, n in zip(coords["station"], counts, strict=False):
        if n:
            refused[str(name)] = {REFUSED: int(n)}
    if position is not None:
        variables["position"] = (dims, position)
    if not bare.all():
        variables["quaternion"], coords["component"] = (VARIABLES["quaternion"][0][0], array), list(COMPONENTS)


def _add_pressure(variables: dict, coords: dict, pressure: Any, clock: Any, chamber: Any) -> None:
    if pressure is None:
        return
    array = np.asarray(pressure)
    array = _floats("pressure", pressure, min(max(array.ndim, 1), 2))
    if array.ndim == 2 and array.shape[1] == 1 and chamber is None:
        array = array[:, 0]  # a lone pressure needs no name
    _add_clock(coords, clock, "pressure", "pressure_time")
    dims: tuple[str, ...] = ("pressure_time",)
    if array.ndim == 2:
        dims = ("pressure_time", "chamber")
        coords["chamber"] = _names(chamber, array.shape[1], "chamber", "c")
    variables["pressure"] = (dims, array)


def _add_inputs(variables: dict, coords: dict, actuation: Any, clock: Any, names: Any, kind: Any) -> None:
    if actuation is None:
        return
    array = _floats("actuation", actuation, 2)
    _add_clock(coords, clock, "actuation", "input_time")
    coords["input"] = _names(names, array.shape[1], "input", "u")
    coords["kind"] = ("input", _names([kind] * array.shape[1] if isinstance(kind, str) else kind, array.shape[1],
                                      "kind of an input", ""))  # fmt: skip
    variables["actuation"] = (("input_time", "input"), array)


def _add_strain(variables: dict, coords: dict, strain: Any, gauge_position: Any, core: Any) -> None:
    if strain is None:
        return
    array = _floats("strain", strain, 3)
    if gauge_position is None:
        raise InputError("strain needs gauge_position, the position of each gauge along the fibre in metres")
    coords["gauge_position"] = ("gauge", _floats("gauge_position", gauge_position, 1))
    coords["core"] = _names(core, array.shape[1], "core", "core")
    variables["strain"] = (("time", "core", "gauge"), array)


def _assemble(variables: dict, coords: dict) -> xr.Dataset:
    import xarray as xr

    try:
        recording = xr.Dataset(variables, coords)
    except ValueError as error:
        shapes = {name: np.shape(value[1]) for name, value in variables.items()}
        raise InputError(f"the shapes of the recording's arrays do not match: {shapes}; {error}") from None
    for name, (_, units, long_name) in (VARIABLES | COORDINATES).items():
        if name in recording.variables:
            recording[name].attrs.update(units=units, long_name=long_name)
    return recording
