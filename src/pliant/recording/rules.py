"""Rules that the variables, units and attributes of every recording must follow, and the function that checks them."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.equations.observation import FURTHER, KINDS, kinds_of
from pliant.errors import InputError, clipped
from pliant.text import is_line
from pliant.units import KIND_OF

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import xarray as xr
    from numpy.typing import NDArray

SCHEMA = "pliant-recording"
SCHEMA_VERSION = 1
FRAMES = ("tracker", "planar", "spatial")
REFERENCES = ("rest", "base")  # what angles and orientations of an aligned recording are measured from
COMPONENTS = ("x", "y", "z", "w")
INPUT_UNITS = {kind: unit for unit, kind in KIND_OF.items() if kind != "pressure"}  # of inputs beside gauge pressure
QUATERNION_NORM_TOLERANCE = 1e-3
TEXTS = ("schema", "frame", "source", "source_format", "source_sha256", "pressure_reference", "history")
SHORTEST_STEP = 1e-9  # s between two samples
# generous bounds of measured values: a larger value is a marker of missing data, has a wrong unit or is damaged
MOST = {
    "position": 1e6, "arc_length": 1e6, "gauge_position": 1e6, "angle": 1e6, "pressure": 1e12, "strain": 1e3,
    "base_position": 1e6, "base_angle": 1e6,
    "time": 1e13, "pressure_time": 1e13, "input_time": 1e13, "actuation": 1e9,
}  # fmt: skip

# name -> (dimensions that may carry it, units, long name)
COORDINATES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "time": (("time",), "s", "time on the clock of the shape"),
    "pressure_time": (("pressure_time",), "s", "time on the clock of the pressure"),
    "input_time": (("input_time",), "s", "time on the clock of the inputs other than pressure"),
    "arc_length": (("station",), "m", "arc length of the station from the base"),
    "gauge_position": (("gauge",), "m", "position of the strain gauge along the fibre"),
}
CONSTANTS = "_constants"  # behind the name of a measured variable: the constants of its stations
VARIABLES: dict[str, tuple[tuple[tuple[str, ...], ...], str, str]] = {
    "position": ((("time", "station", "axis"),), "m", "position of the stations"),
    "quaternion": ((("time", "station", "component"),), "1", "orientation of the stations, x y z w"),
    "angle": ((("time", "station"),), "rad", "rotation of the stations about the normal of the plane"),
    "pressure": ((("pressure_time",), ("pressure_time", "chamber")), "Pa", "gauge pressure"),
    "actuation": ((("input_time", "input"),), "SI", "inputs other than pressure, in the SI unit of their kind"),
    "strain": ((("time", "core", "gauge"),), "1", "strain of the fibre cores"),
    "base_position": ((("time", "axis"),), "m", "position of the moving base, in its axes at rest"),
    "base_angle": ((("time",),), "rad", "rotation of the moving base about the normal of the plane since rest"),
    "base_quaternion": ((("time", "component"),), "1", "rotation of the moving base since rest, x y z w"),
    **{name: ((("time", "station", "axis")[: 2 + (len(kinds_of(name, 3)) > 1)],), KINDS[kind].unit, KINDS[kind].meaning)
       for name, kind in FURTHER.items()},
    **{f"{name}{CONSTANTS}": ((("station", "constant"),), "SI", f"constants of {name}") for name in FURTHER},
}


def shape_variable(recording: xr.Dataset) -> str:
    """Return the name of the variable that shows the motion of the stations: the position or, in a recording without
    positions, the angle or a further variable; "" if there is none.
    """
    return next((name for name in ("position", "angle", *FURTHER) if name in recording), "")


def shape_values(recording: xr.Dataset) -> NDArray:
    """Return the values (T, S, k) of the variable `shape_variable`, for S stations in T frames."""
    values = recording[shape_variable(recording)].values
    return values if values.ndim == 3 else values[..., None]


def check_recording(recording: xr.Dataset) -> xr.Dataset:
    """Check that a recording follows the rules for its variables, units and attributes, and return it unchanged; raise
    InputError otherwise.

    Refused are:

    - another schema or a newer version;
    - a variable with unknown dimensions or without its units;
    - times that are not finite or do not increase by at least 1 ns;
    - infinite values and values beyond `MOST`, such as 1e6 m (NaN is allowed and marks a drop-out);
    - quaternions that are not of unit length;
    - repeated station names;
    - a planar recording with a z axis;
    - a direction of gravity that is no unit vector, or is not known in the base frame;
    - an input of an unknown kind;
    - a recording without position, angle, inclination, strain, pressure or another input.

    Raises
    ------
    InputError
        When a rule is broken; the message names the rule and the variable.
    """
    _check_attributes(recording)
    if not shape_variable(recording) and not {"strain", "pressure", "actuation"} & set(recording.data_vars):
        raise InputError(
            "a recording must hold position, angle, strain, pressure or another input, but this one holds "
            f"{', '.join(map(str, recording.data_vars)) or 'no variable'}"
        )
    for name, (allowed, units, _) in VARIABLES.items():
        if name in recording:
            _check_array(recording[name], name, allowed, units)
    for name, (dims, units, _) in COORDINATES.items():
        if name in recording.coords:
            _check_array(recording[name], name, (dims,), units)
    if shape_variable(recording) or "strain" in recording:
        _check_clock(recording, "time")
    if "pressure" in recording:
        _check_clock(recording, "pressure_time")
    if "actuation" in recording:
        _check_clock(recording, "input_time")
        _check_inputs(recording)
    _check_names(recording)
    _check_stations(recording)
    _check_rotations(recording)
    _check_base(recording)
    return recording


def _check_attributes(recording: xr.Dataset) -> None:
    _check_texts("the recording", recording.attrs, TEXTS)
    if recording.attrs.get("schema") != SCHEMA:
        raise InputError(
            f"expected a recording with attribute schema={SCHEMA!r}, but found {recording.attrs.get('schema')!r}; "
            "build one with make_recording or read one with read"
        )
    version = recording.attrs.get("schema_version")
    if not isinstance(version, (int, np.integer)) or not 1 <= int(version) <= SCHEMA_VERSION:
        raise InputError(f"schema_version of a recording must be 1 to {SCHEMA_VERSION}, not {version!r}: a newer "
                         "version needs a newer pliant")  # fmt: skip
    if recording.attrs.get("frame") not in FRAMES:
        raise InputError(f"frame of a recording must be one of {', '.join(FRAMES)}, not "
                         f"{recording.attrs.get('frame')!r}")
    pressure = recording.attrs.get("nominal_pressure", 0.0)
    if not isinstance(pressure, (int, float, np.number)) or not np.isfinite(pressure):
        raise InputError(f"nominal_pressure must be a finite number of pascals, not {pressure!r}")


def _check_texts(what: str, attributes: Mapping[Any, Any], names: Sequence[str]) -> None:
    for name in names:
        value = attributes.get(name, "")
        if not isinstance(value, str):
            raise InputError(f"the attribute {name} of {what} must be a text, not {clipped(repr(value), 60)}")
        if name != "history" and not is_line(value):
            raise InputError(f"the attribute {name} of {what} must be one printable line: {clipped(repr(value), 60)}")


def _check_array(array: xr.DataArray, name: str, allowed: Sequence[tuple[str, ...]], units: str) -> None:
    _check_texts(name, array.attrs, ("units", "long_name", "reference"))
    if array.dims not in allowed:
        raise InputError(f"{name} must have dimensions {' or '.join(map(str, allowed))}, not {array.dims}")
    if array.dtype != np.float64:
        raise InputError(f"{name} must be float64, not {array.dtype}")
    if array.attrs.get("units") != units or not array.attrs.get("long_name"):
        raise InputError(f"{name} must carry units {units!r} and a long_name, but has {array.attrs}")
    if np.isinf(array.values).any():
        raise InputError(f"{name} holds {int(np.isinf(array.values).sum())} infinite value(s): replace them by NaN")
    beyond = np.abs(array.values) > MOST.get(name, np.inf)  # NaN compares false
    if beyond.any():
        raise InputError(
            f"{name} holds {int(beyond.sum())} value(s) beyond {MOST[name]:g} {units}, such as "
            f"{array.values[beyond][0]:.3g}: check the unit, and leave a missing value empty or NaN"
        )


def _check_clock(recording: xr.Dataset, name: str) -> None:
    if name not in recording.coords:
        raise InputError(f"the recording has no coordinate {name}: build recordings with make_recording")
    clock = recording[name].values
    if clock.size == 0:
        raise InputError(f"the recording is empty: {name} has no sample")
    if not np.isfinite(clock).all():
        raise InputError(f"{name} holds {int((~np.isfinite(clock)).sum())} time(s) that are not finite: remove "
                         "these samples")
    back = np.diff(clock) < SHORTEST_STEP
    if back.any():
        row = int(np.argmax(back))
        raise InputError(
            f"{name} must increase strictly, but {int(back.sum())} step(s) do not; the first is after "
            f"sample {row + 1}: {clock[row]:.6g} s is followed by {clock[row + 1]:.6g} s; write the times with all "
            "digits, and each sample once"
        )


def _check_names(recording: xr.Dataset) -> None:
    """Check that each name is one printable line, so that it fits in a line, a table or a figure, and that no two
    stations, chambers, cores or inputs have the same name.
    """
    for kind in ("station", "chamber", "core", "input"):
        names = [str(name) for name in recording[kind].values] if kind in recording.coords else []
        if strange := [name for name in names if not is_line(name)]:
            raise InputError(f"the name of a {kind} must be one printable line: {clipped(repr(strange[0]), 60)}")
        if repeated := sorted(name for name, count in Counter(names).items() if count > 1):
            raise InputError(f"{kind} names must differ, but these repeat: {clipped(', '.join(repeated), 200)}; give "
                             f"each {kind} a name of its own")  # fmt: skip


def _check_inputs(recording: xr.Dataset) -> None:
    """Check that every input has a name and a known kind."""
    if "input" not in recording.coords or "kind" not in recording.coords or recording["kind"].dims != ("input",):
        raise InputError("actuation needs the coordinates input (names of the inputs) and kind (one per input)")
    if strange := [str(k) for k in recording["kind"].values if str(k) not in INPUT_UNITS]:
        kinds = ", ".join(INPUT_UNITS)
        raise InputError(f"the kind of an input must be one of {kinds}, not {clipped(repr(strange[0]), 60)}")


def _check_stations(recording: xr.Dataset) -> None:
    variable = shape_variable(recording)
    if not variable:
        return
    names = [str(n) for n in recording["station"].values] if "station" in recording.coords else []
    if not names or len(names) != recording.sizes["station"]:
        raise InputError(f"{variable} needs at least one station and a name for each")
    if "axis" not in recording[variable].dims:
        return
    axes = [str(a) for a in recording["axis"].values] if "axis" in recording.coords else []
    expected = ["x", "y"] if recording.attrs["frame"] == "planar" else ["x", "y", "z"]
    if axes != expected:
        raise InputError(f"the axes of a recording in frame {recording.attrs['frame']!r} must be {expected}, not "
                         f"{axes}")


def _check_rotations(recording: xr.Dataset) -> None:
    if "angle" in recording:
        if recording.attrs["frame"] != "planar":
            raise InputError("angle is allowed in planar recordings only: align the recording first")
        if recording["angle"].attrs.get("reference") not in REFERENCES:
            raise InputError("the variable angle must have the attribute reference = 'rest' or 'base': add it")
    if "quaternion" in recording:
        if recording.attrs["frame"] == "spatial" and recording["quaternion"].attrs.get("reference") not in REFERENCES:
            raise InputError("the variable quaternion of an aligned recording must have the attribute reference = "
                             "'rest' or 'base': add it")
        _check_norm(recording, "quaternion")
    if "gravity" in recording:
        if f"gravity{CONSTANTS}" not in recording or recording["gravity"].attrs.get("reference") not in REFERENCES:
            raise InputError(f"gravity in the axes of links needs its direction in the base frame, gravity{CONSTANTS} "
                             "(one unit vector for each station), and the attribute reference = 'rest' or 'base'")
        _check_norm(recording, "gravity")
        _check_norm(recording, f"gravity{CONSTANTS}")


def _check_norm(recording: xr.Dataset, name: str) -> None:
    norm = np.linalg.norm(recording[name].values, axis=-1)
    wrong = np.abs(norm - 1.0) > QUATERNION_NORM_TOLERANCE  # NaN compares false: no orientation
    if wrong.any():
        raise InputError(f"{int(wrong.sum())} {name}(s) are not of unit length: normalise them")


def _check_base(recording: xr.Dataset) -> None:
    """Check that the motion of a base is that of an aligned recording, in its plane or in space."""
    turn = {"planar": "base_angle", "spatial": "base_quaternion"}.get(recording.attrs["frame"])
    poses = [name for name in ("base_position", "base_angle", "base_quaternion") if name in recording]
    if not poses:
        return
    if turn is None or "position" not in recording:
        raise InputError(f"{poses[0]} needs positions in the base frame: align the recording with base_motion = true")
    if "base_position" not in poses or poses[1:] not in ([], [turn]):
        raise InputError(f"the motion of a base in the frame {recording.attrs['frame']} is stated by base_position, "
                         f"alone or with {turn}, but the recording holds {', '.join(poses)}")
    if turn == "base_quaternion" and turn in recording:
        _check_norm(recording, turn)
