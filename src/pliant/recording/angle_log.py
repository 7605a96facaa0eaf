"""Reader of logs of angle and pressure from a flex sensor, an IMU or an encoder.

The first row names the columns, such as ``time;angle;pressure;set_point``. Time is ``time`` or ``t``, an angle has
``angle`` in its name, the pressure is ``pressure`` or ``p``. A unit may follow each name: ``angle_deg``, ``pressure
(kPa)``, ``t_ms``. Other columns, such as a set point, are left out. Cells are separated by semicolons, tabs or commas;
decimal commas and carriage returns as line ends are read.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pliant.errors import InputError
from pliant.recording.clock import SECONDS
from pliant.recording.column_names import parted, standard_names, stations_of
from pliant.recording.columns import read_columns
from pliant.recording.mapping import FileMapping
from pliant.recording.registry import ENDINGS, Reader
from pliant.recording.tables import find_delimiter, read_text, split_cells
from pliant.units import PASCAL, RADIAN

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    import xarray as xr

Role = Literal["time", "angle", "pressure"]
NAMES: dict[Role, re.Pattern[str]] = {
    "time": re.compile(r"t|time|timestamp|millis"),
    "angle": re.compile(r"(?:(.+)_)?(?:angle|angles|theta|flex|imu)(?:_(.+))?"),
    "pressure": re.compile(r"p|pressure|pressures"),
}
BEND = re.compile(r"(?:(.+)_)?(?:bend|bending)(?:_(.+))?")  # an angle if it states a unit, and no other name says one
UNITS: dict[Role, Iterable[str]] = {"time": SECONDS, "angle": RADIAN, "pressure": PASCAL}
SLOWEST = 1.0  # s between two samples of a log whose header does not say the unit of time


class AngleLogMapping(FileMapping):
    """Options of the reader of angle logs: units that the column names lack, arc lengths of the sensors, and the rows
    to read.

    Attributes
    ----------
    angle_unit : {"deg", "rad"}, optional
    pressure_unit : str, optional
        Unit of the gauge pressure.
    time_unit : {"s", "ms", "us"}, optional
        Default: the unit in the name of the time column, else seconds.
    arc_length : list of float, m, optional
        Arc length at which each angle was measured, from base to tip; that of the tip is the body's length.
    rows : (first, last), optional
        Rows to keep, counted from 0, the last excluded.
    """

    angle_unit: Literal["deg", "rad", "rev"] | None = None
    pressure_unit: str | None = None
    time_unit: Literal["s", "ms", "us", "ns"] | None = None
    arc_length: list[float] | None = None
    rows: tuple[int, int] | None = None


def read_angle_log(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read a text log of measured angles and pressure and return it as a recording."""
    options = AngleLogMapping.load(mapping, path.name)
    lines = read_text(path).split("\n")
    first = next((i for i, line in enumerate(lines) if line.strip() and not line.startswith("#")), 0)
    delimiter = find_delimiter(lines[first], path.name)
    names = split_cells(lines[first], delimiter)
    columns = roles(names)
    angles = {n: c for n, c in columns.items() if c[0] == "angle"}
    clocks, pressures = ([n for n, c in columns.items() if c[0] == role] for role in ("time", "pressure"))
    if len(clocks) != 1 or not angles or len(pressures) > 1:
        raise InputError(
            f"{path.name} is not a log of angle and pressure: its first row must name one time, angles and at most one "
            f"pressure, but it is {', '.join(names[:8])[:200]}"
        )
    units = {role: unit_of(role, columns, getattr(options, f"{role}_unit"), path.name) for role in UNITS
             if role != "pressure" or pressures}  # fmt: skip
    stations = station_names(list(angles))
    table: dict[str, Any] = {
        "delimiter": delimiter, "header": True, "skip_lines": first, "time": clocks[0], "time_unit": units["time"],
        "angles": dict(zip(stations, angles, strict=True)), "angle_unit": units["angle"], "rows": options.rows,
        "arc_length": options.arc_length,
    }  # fmt: skip
    if pressures:
        table["pressure"] = {"columns": pressures, "unit": units["pressure"]}
    recording = read_columns(path, table)
    step = float(np.median(np.diff(recording["time"].values))) if recording.sizes["time"] > 1 else 0.0
    if step > SLOWEST and not (options.time_unit or columns[clocks[0]][1]):
        raise InputError(f"{path.name}: the times are {step:.4g} apart, too long for seconds: set time_unit in its "
                         "mapping to 's', 'ms' or 'us'")  # fmt: skip
    return recording


def roles(names: Sequence[str]) -> dict[str, tuple[Role, str]]:
    """Return, for each column whose name is recognised, its role (time, angle or pressure) and its unit ("" where the
    name states none).
    """
    recognised: dict[str, tuple[Role, str]] = {}
    for translated in (False, True):  # names in other languages where no other name has the role
        known = {role for role, _ in recognised.values()}
        for name in names:
            bare, unit = parted(name, translated=translated)
            role = next((role for role, pattern in NAMES.items()
                         if pattern.fullmatch(bare) and (not unit or unit in UNITS[role])), None)  # fmt: skip
            if role is not None and role not in known and (unit or not translated or role != "angle"):
                recognised.setdefault(name, (role, unit or ("ms" if bare == "millis" else "")))
    if not any(role == "angle" for role, _ in recognised.values()):
        recognised |= {name: ("angle", unit) for name in names for bare, unit in [parted(name)]
                       if unit in RADIAN and BEND.fullmatch(bare)}  # fmt: skip
    return recognised


def unit_of(role: Role, found: Mapping[str, tuple[Role, str]], stated: str | None, file: str) -> str:
    """Return the unit of all columns of one role (time, angle or pressure), as stated in their names or in the mapping
    of the file.
    """
    named = {unit for kind, unit in found.values() if kind == role and unit}
    if stated is not None:
        named.add(stated.lower())
    if len(named) > 1:
        raise InputError(f"{file} has several units of {role}, {' and '.join(sorted(named))}: use one unit in its "
                         "columns and mapping")
    if not named and role != "time":
        known = ", ".join(UNITS[role])
        raise InputError(f"{file} does not state the unit of {role}: set {role}_unit in its mapping to one of {known}")
    return named.pop() if named else "s"


def station_names(columns: list[str]) -> list[str]:
    """Return station names for the angle columns of a log: ``tip`` for a single column, else the rest of each column
    name without ``angle``.
    """
    if len(columns) == 1:
        return ["tip"]
    names = []
    for k, column in enumerate(columns):
        match = NAMES["angle"].fullmatch(parted(column)[0]) or BEND.fullmatch(parted(column)[0])
        names.append((match and (match[1] or match[2])) or f"angle_{k + 1}")
    return names if len(set(names)) == len(names) else columns


def recognises(head: bytes) -> bool:
    """Return whether the first bytes of a file are the header of an angle log: one time, at least one angle, and no x,
    y or z position.
    """
    text = head.removeprefix(b"\xef\xbb\xbf")[:4000].decode("utf-8", "replace")
    line = next((line for line in re.split("[\r\n]+", text) if line.strip() and not line.startswith("#")), "")
    names = [split_cells(line, delimiter) for delimiter in (";", "\t", ",") if delimiter in line]
    if not names or any(re.match(r"[xyz](_|$)", n) for n in names[0]):
        return False
    try:
        if stations_of(standard_names(names[0], "").names, names[0]):
            return False
    except InputError:  # positions in several units
        return False
    kinds = [role for role, _ in roles(names[0]).values()]
    return kinds.count("time") == 1 and "angle" in kinds


READER = Reader("angles", ENDINGS["angles"], read_angle_log, recognises)
