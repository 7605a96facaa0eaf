"""Recordings from the named arrays of HDF5 files that pliant did not write, in the units of their attributes."""

from __future__ import annotations

import re
from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError, shown
from pliant.recording.arrays import PRESSURE_NAMES, RATES, USUAL_NAMES, recording_from_arrays
from pliant.recording.clock import SECONDS
from pliant.recording.column_names import unit_of
from pliant.recording.mapping import named_in, shorten
from pliant.recording.schema import append_history
from pliant.units import METRE, PASCAL, standard_unit

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import xarray as xr
    from numpy.typing import NDArray

EMPTY, PACKED = ("_FillValue", "missing_value"), ("scale_factor", "add_offset")  # attributes of values
UNREAD = ("_Unsigned", "valid_min", "valid_max", "valid_range")  # change what values mean, and are not read
ROLES = (  # arrays of one unit, those that the file may hold, and the entry that states it
    (("position", "arc_length", "gauge_position"), METRE, "length_unit"), (("pressure",), PASCAL, "pressure_unit"),
    (("time",), SECONDS, ""), (("pressure_time",), SECONDS, ""), (("strain",), {"1": 1.0, "m/m": 1.0}, ""),
)  # fmt: skip
SINCE = re.compile(r"(.*?)\s+since\s.*", re.DOTALL)
BRACKETS = re.compile(r"\[(.*)\]|\((.*)\)", re.DOTALL)


def of_named(
    arrays: Mapping[str, NDArray], facts: Mapping[str, Any], mapping: Mapping[str, Any] | None, file: str
) -> xr.Dataset:
    """Return the recording of an HDF5 file that pliant did not write, whose arrays have the names ``group.array`` or
    ``table.column``; without the name of a group or table that holds all. Units that the mapping does not state are
    those of the attributes ``unit`` or ``units`` of the arrays that are read, or in their names.
    """
    names = {path: path.replace("/", ".").replace(":", ".") for path in facts["variables"]}
    while all("." in name for name in names.values()) and len({n.partition(".")[0] for n in names.values()}) == 1:
        names = {path: name.partition(".")[2] for path, name in names.items()}
    count = Counter(names.values())
    names = {path: name if count[name] == 1 else path for path, name in names.items()}
    stored = {names[path]: (arrays[key], said) for path, (key, _, said) in facts["variables"].items()}
    numeric = {name: array for name, (array, _) in stored.items() if array.dtype.kind in "iufb"}
    others = [*(path.replace("/", ".") for path in facts["others"]), *(n for n in stored if n not in numeric)]
    options, history, said_units = dict(mapping or {}), list[str](), list[str]()
    every = (*(role for roles, _, _ in ROLES for role in roles), "quaternion", "actuation")
    for name in dict.fromkeys([*(n for role in every for n in names_of(role, options, numeric)), *RATES]):
        if name in numeric:
            numeric[name], said = unpacked(name, *stored[name], file)
            history += said
    for roles, known, entry in ROLES:
        listed = [names_of(role, options, numeric) for role in roles]
        read = [name for some in listed for name in some]
        if not read or (entry and entry in options):
            continue
        units = {name: stated_unit(name, stored[name][1], known, entry, file) for name in read}
        unit = one_unit(units, roles[0], entry, file)
        if unit and entry:
            options[entry] = unit
        elif unit and not unit_of(last_part(read[0]), known):  # a unit in a name is read with the array
            numeric |= {name: numeric[name] * known[unit] for name in read}
        said_units += [f"{name} [{unit}]" for name, unit in units.items() if unit]
    history += [f"units of {file} by attributes and names: {shorten(said_units)}"] if said_units else []
    return append_history(recording_from_arrays(numeric, options or None, file, others=others), *history)


def last_part(name: str) -> str:
    """Return the name of an array without those of its groups."""
    return re.split(r"[./:]", name)[-1]


def names_of(role: str, options: Mapping[str, Any], numeric: Mapping[str, NDArray]) -> list[str]:
    """Return the arrays of numbers that are read in a role."""
    named = named_in(options.get(role)) or {*USUAL_NAMES.get(role, ())}
    usual = role == "pressure" and not options.get(role)
    return [name for name in numeric if name in named or (usual and name.lower() in PRESSURE_NAMES)]


def unpacked(name: str, values: NDArray, attributes: Mapping[str, Any], file: str) -> tuple[NDArray, list[str]]:
    """Return the values of an array that netCDF packed, gaps as NaN, and a sentence on it for the history."""
    if strange := [key for key in UNREAD if key in attributes]:
        raise InputError(f"the array {name} of {file} has the attribute {strange[0]}, which is not read: store its "
                         "values as floating-point numbers without it")
    used = [key for key in (*EMPTY, *PACKED) if key in attributes]
    if not used:
        return values, []
    try:
        gaps = [np.asarray(attributes[key]["array"] if isinstance(attributes[key], dict) else attributes[key],
                           np.float64).ravel() for key in used if key in EMPTY]  # fmt: skip
        scale, zero = (float(attributes.get(key, default)) for key, default in zip(PACKED, (1.0, 0.0), strict=True))
    except (TypeError, ValueError):
        raise InputError(f"the array {name} of {file} has an attribute {', '.join(used)} that is not a number: store "
                         "its values as floating-point numbers without it") from None
    plain = values.astype(np.float64)
    empty = np.isin(plain, np.concatenate(gaps)) if gaps else np.zeros(plain.shape, bool)
    said = f"{name} is stored value * {scale:g} + {zero:g}, with {int(empty.sum())} gap(s), by its attributes"
    return np.where(empty, np.nan, plain * scale + zero), [said]


def stated_unit(
    name: str, attributes: Mapping[str, Any], known: Mapping[str, float], entry: str, file: str
) -> str:
    """Return the unit of an array that its attribute or its name states; "" for none. Raise InputError where the
    attribute states an unknown one, or another one than the name.
    """
    text = str(attributes.get("unit", attributes.get("units", ""))).strip()
    if match := SINCE.fullmatch(text):
        text = match[1]
    if match := BRACKETS.fullmatch(text):
        text = match[1] or match[2] or ""
    unit, by_name = standard_unit(text), unit_of(last_part(name), known)
    remedy = f"state {entry} in the mapping" if entry else "correct the attribute, or store the array in another unit"
    if unit and unit not in known:
        raise InputError(f"the array {name} of {file} has the unit {shown(text)}, which is none of {', '.join(known)}: "
                         f"{remedy}")
    if unit and by_name and unit != by_name:
        raise InputError(f"the array {name} of {file} has the unit {shown(text)} by its attribute, but {by_name} by "
                         f"its name: {remedy}")
    return unit or by_name


def one_unit(units: Mapping[str, str], role: str, entry: str, file: str) -> str:
    """Return the one unit of the arrays of a role; raise InputError where they state several, or only some state it."""
    several: Sequence[str] = sorted({*units.values()} - {""})
    if len(several) > 1:
        raise InputError(f"the arrays of {role} in {file} state several units ({', '.join(several)}): write them in "
                         f"one, or state {entry} in the mapping if the attributes are wrong")
    missing = [name for name, unit in units.items() if not unit]
    if several and missing:
        raise InputError(f"of the arrays of {role} in {file}, {shorten(missing)} state no unit, others {several[0]}: "
                         f"state {entry} in the mapping if it is that of all")
    return several[0] if several else ""
