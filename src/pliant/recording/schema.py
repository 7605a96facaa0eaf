"""The one shape of a recording: an `xarray.Dataset` whose dimensions, units and attributes are checked.

See `make_recording` for the variables and `check_recording` for what is refused.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pliant.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

SCHEMA = "pliant-recording"
SCHEMA_VERSION = 1
FRAMES = ("tracker", "planar")
COMPONENTS = ("x", "y", "z", "w")
QUATERNION_NORM_TOLERANCE = 1e-3
SHORTEST_STEP = 1e-9  # s between two samples
# generous bounds of what anybody measures: beyond them stands a marker of missing data, a wrong unit or damage
MOST = {
    "position": 1e6, "arc_length": 1e6, "gauge_position": 1e6, "angle": 1e6, "pressure": 1e12, "strain": 1e3,
    "time": 1e13, "pressure_time": 1e13,
}  # fmt: skip

# name -> (dimensions that may carry it, units, long name)
COORDINATES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "time": (("time",), "s", "time on the clock of the shape"),
    "pressure_time": (("pressure_time",), "s", "time on the clock of the pressure"),
    "arc_length": (("station",), "m", "arc length of the station from the base"),
    "gauge_position": (("gauge",), "m", "position of the strain gauge along the fibre"),
}
VARIABLES: dict[str, tuple[tuple[tuple[str, ...], ...], str, str]] = {
    "position": ((("time", "station", "axis"),), "m", "position of the stations"),
    "quaternion": ((("time", "station", "component"),), "1", "orientation of the stations, x y z w"),
    "angle": ((("time", "station"),), "rad", "rotation of the stations about the normal of the plane"),
    "pressure": ((("pressure_time",), ("pressure_time", "chamber")), "Pa", "gauge pressure"),
    "strain": ((("time", "core", "gauge"),), "1", "strain of the fibre cores"),
}


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
) -> xr.Dataset:
    """Build a checked recording from plain arrays; the arrays are copied.

    Parameters
    ----------
    time : (T,) array, s
        Clock of the shape, strictly increasing. May be left out when only pressure was recorded.
    position : (T, S, 3) or, once planar, (T, S, 2) array, m
        NaN marks a drop-out.
    station : S names, optional
        Default ``s000, s001, ...`` from base to tip.
    quaternion : (T, S, 4) array, optional
        Unit quaternions x, y, z, w; NaN where a station has no orientation.
    angle : (T, S) array, rad, optional
        Planar recordings only: rotation of a station about +z.
    angle_reference : {"rest", "base"}
        What `angle` is measured from: the station's own rest pose, or the base tangent.
    pressure : (P,) or (P, C) array, Pa gauge, optional
        Needs `pressure_time`; with two dimensions one column per chamber.
    pressure_time : (P,) array, s, optional
        Clock of the pressure; default is `time` when the lengths agree.
    chamber : C names, optional
    strain : (T, C, G) array, optional
        Dimensionless strain of each core at each gauge; needs `gauge_position`.
    gauge_position : (G,) array, m, optional
    core : C names, optional
    arc_length : (S,) array, m, optional
    frame : {"tracker", "planar"}
    nominal_pressure : float, Pa gauge, optional
        Level of a pressure that was not recorded and whose edges are unknown.
    source, source_format, source_sha256 : str
        File name, format and checksum of what was read.
    history : str or list of str
        One line per step that led here.
    attrs : dict, optional
        Further attributes, kept as they are.

    Returns
    -------
    xarray.Dataset
        Float64 throughout; see `check_recording`.

    Raises
    ------
    InputError
        When an array has the wrong shape or breaks a rule of the schema.
    """
    variables: dict[str, Any] = {}
    coords: dict[str, Any] = {}
    if time is not None:
        coords["time"] = _floats("time", time, 1)
    if position is not None:
        array = _floats("position", position, 3)
        coords["station"] = _names(station, array.shape[1], "station", "s")
        coords["axis"] = _axes(array.shape[2])
        variables["position"] = (("time", "station", "axis"), array)
    for name, value, ndim in (("quaternion", quaternion, 3), ("angle", angle, 2)):
        if value is not None:
            variables[name] = (VARIABLES[name][0][0], _floats(name, value, ndim))
    if quaternion is not None:
        coords["component"] = list(COMPONENTS)
    if arc_length is not None:
        coords["arc_length"] = ("station", _floats("arc_length", arc_length, 1))
    _add_pressure(variables, coords, pressure, pressure_time, chamber)
    _add_strain(variables, coords, strain, gauge_position, core)
    ds = _assemble(variables, coords)
    if angle is not None:
        ds["angle"].attrs["reference"] = angle_reference
    lines = [history] if isinstance(history, str) else list(history)
    ds.attrs = {
        "schema": SCHEMA, "schema_version": SCHEMA_VERSION, "frame": frame, "source": source,
        "source_format": source_format, "source_sha256": source_sha256,
        "pressure_reference": "gauge", "history": "\n".join(line for line in lines if line),
    } | (attrs or {})  # fmt: skip
    if nominal_pressure is not None:
        ds.attrs["nominal_pressure"] = float(nominal_pressure)
    return check_recording(ds)


def append_history(ds: xr.Dataset, *lines: str) -> xr.Dataset:
    """Return the recording with more lines of history; the data are shared, `ds` stays as it was."""
    kept = [line for line in str(ds.attrs.get("history", "")).split("\n") if line]
    return ds.assign_attrs(history="\n".join([*kept, *(line.replace("\n", " ") for line in lines)]))


def check_recording(ds: xr.Dataset) -> xr.Dataset:
    """Return `ds` unchanged when it keeps the rules of the schema.

    Refused are: another schema or a newer version; a variable with unknown dimensions or without its
    units; a clock that is not finite and strictly increasing, by 1 ns at least; infinite values and those
    beyond `MOST`, such as 1e6 m (NaN is a drop-out and allowed); quaternions that are not of unit length;
    repeated station names; a planar recording with a z axis; a recording that holds neither position,
    strain nor pressure.

    Raises
    ------
    InputError
        Says which rule is broken, and where.
    """
    _check_attributes(ds)
    if not {"position", "strain", "pressure"} & set(ds.data_vars):
        raise InputError(
            "a recording holds position, strain or pressure, but this one holds "
            f"{', '.join(map(str, ds.data_vars)) or 'no variable'}"
        )
    for name, (allowed, units, _) in VARIABLES.items():
        if name in ds:
            _check_array(ds[name], name, allowed, units)
    for name, (dims, units, _) in COORDINATES.items():
        if name in ds.coords:
            _check_array(ds[name], name, (dims,), units)
    if "position" in ds or "strain" in ds:
        _check_clock(ds, "time")
    if "pressure" in ds:
        _check_clock(ds, "pressure_time")
    _check_stations(ds)
    _check_rotations(ds)
    return ds


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
        raise InputError(f"{count} {what}(s) need {count} names, but {len(names)} came")
    return np.array(names, dtype=str)


def _axes(count: int) -> list[str]:
    if count not in (2, 3):
        raise InputError(f"position needs 2 (planar) or 3 coordinates per station, but has {count}")
    return list("xyz"[:count])


def _add_pressure(variables: dict, coords: dict, pressure: Any, clock: Any, chamber: Any) -> None:
    if pressure is None:
        return
    array = np.asarray(pressure)
    array = _floats("pressure", pressure, min(max(array.ndim, 1), 2))
    if clock is None:
        clock = coords.get("time")
    if clock is None:
        raise InputError("pressure needs its clock: give pressure_time")
    coords["pressure_time"] = _floats("pressure_time", clock, 1)
    dims: tuple[str, ...] = ("pressure_time",)
    if array.ndim == 2:
        dims = ("pressure_time", "chamber")
        coords["chamber"] = _names(chamber, array.shape[1], "chamber", "c")
    variables["pressure"] = (dims, array)


def _add_strain(variables: dict, coords: dict, strain: Any, gauge_position: Any, core: Any) -> None:
    if strain is None:
        return
    array = _floats("strain", strain, 3)
    if gauge_position is None:
        raise InputError("strain needs gauge_position, the place of each gauge along the fibre in metres")
    coords["gauge_position"] = ("gauge", _floats("gauge_position", gauge_position, 1))
    coords["core"] = _names(core, array.shape[1], "core", "core")
    variables["strain"] = (("time", "core", "gauge"), array)


def _assemble(variables: dict, coords: dict) -> xr.Dataset:
    try:
        ds = xr.Dataset(variables, coords)
    except ValueError as error:
        shapes = {name: np.shape(value[1]) for name, value in variables.items()}
        raise InputError(f"the arrays of a recording do not fit together: {shapes}; {error}") from None
    for name, (_, units, long_name) in (VARIABLES | COORDINATES).items():
        if name in ds.variables:
            ds[name].attrs.update(units=units, long_name=long_name)
    return ds


def _check_attributes(ds: xr.Dataset) -> None:
    if ds.attrs.get("schema") != SCHEMA:
        raise InputError(
            f"expected a recording with attribute schema={SCHEMA!r}, but found {ds.attrs.get('schema')!r}; "
            "build one with make_recording or read one with read"
        )
    version = ds.attrs.get("schema_version")
    if not isinstance(version, (int, np.integer)) or not 1 <= int(version) <= SCHEMA_VERSION:
        raise InputError(f"recordings of schema_version 1 to {SCHEMA_VERSION} are known, not {version!r}")
    if ds.attrs.get("frame") not in FRAMES:
        raise InputError(f"frame of a recording is one of {', '.join(FRAMES)}, not {ds.attrs.get('frame')!r}")
    pressure = ds.attrs.get("nominal_pressure", 0.0)
    if not isinstance(pressure, (int, float, np.number)) or not np.isfinite(pressure):
        raise InputError(f"nominal_pressure must be a finite number of pascals, not {pressure!r}")


def _check_array(array: xr.DataArray, name: str, allowed: Sequence[tuple[str, ...]], units: str) -> None:
    if array.dims not in allowed:
        raise InputError(f"{name} must have dimensions {' or '.join(map(str, allowed))}, not {array.dims}")
    if array.dtype != np.float64:
        raise InputError(f"{name} must be float64, not {array.dtype}")
    if array.attrs.get("units") != units or not array.attrs.get("long_name"):
        raise InputError(f"{name} must carry units {units!r} and a long_name, but has {array.attrs}")
    if np.isinf(array.values).any():
        raise InputError(f"{name} holds {int(np.isinf(array.values).sum())} infinite value(s)")
    beyond = np.abs(array.values) > MOST.get(name, np.inf)  # NaN compares false
    if beyond.any():
        raise InputError(
            f"{name} holds {int(beyond.sum())} value(s) beyond {MOST[name]:g} {units}, such as "
            f"{array.values[beyond][0]:.3g}: check the unit, and leave a missing value empty or NaN"
        )


def _check_clock(ds: xr.Dataset, name: str) -> None:
    if name not in ds.coords:
        raise InputError(f"the recording has no coordinate {name}")
    clock = ds[name].values
    if clock.size == 0:
        raise InputError(f"the recording is empty: {name} has no sample")
    if not np.isfinite(clock).all():
        raise InputError(f"{name} holds {int((~np.isfinite(clock)).sum())} sample(s) that are not finite")
    back = np.diff(clock) < SHORTEST_STEP
    if back.any():
        row = int(np.argmax(back))
        raise InputError(
            f"{name} must increase strictly, but {int(back.sum())} step(s) do not; the first is at "
            f"sample {row + 1}: {clock[row]:.6g} s is followed by {clock[row + 1]:.6g} s"
        )


def _check_stations(ds: xr.Dataset) -> None:
    if "position" not in ds:
        return
    names = [str(n) for n in ds["station"].values] if "station" in ds.coords else []
    if not names or len(names) != ds.sizes["station"]:
        raise InputError("position needs at least one station and a name for each")
    repeated = sorted({n for n in names if names.count(n) > 1})
    if repeated:
        raise InputError(f"station names must differ, but these repeat: {', '.join(repeated)}")
    axes = [str(a) for a in ds["axis"].values] if "axis" in ds.coords else []
    expected = ["x", "y"] if ds.attrs["frame"] == "planar" else ["x", "y", "z"]
    if axes != expected:
        raise InputError(f"the axes of a recording in frame {ds.attrs['frame']!r} are {expected}, not {axes}")


def _check_rotations(ds: xr.Dataset) -> None:
    if "angle" in ds:
        if ds.attrs["frame"] != "planar":
            raise InputError("angle belongs to planar recordings only: align the recording first")
        if ds["angle"].attrs.get("reference") not in ("rest", "base"):
            raise InputError("angle must carry the attribute reference, 'rest' or 'base'")
    if "quaternion" in ds:
        norm = np.linalg.norm(ds["quaternion"].values, axis=-1)
        wrong = np.abs(norm - 1.0) > QUATERNION_NORM_TOLERANCE  # NaN compares false: no orientation
        if wrong.any():
            raise InputError(f"{int(wrong.sum())} quaternion(s) are not of unit length; normalise them")
