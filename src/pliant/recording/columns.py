"""Any table of numbers, described by a mapping: which column is time, pressure, position, orientation.

The mapping is a plain dict, so that a study file can hold it. Columns are given by index (from 0) or, when
the first row holds names, by name. Example::

    rate_hz = 100.0
    delimiter = ","
    header = true
    length_unit = "m"
    select = { column = "ID", value = 3 }
    stations = { top = { position = ["x1", "y1", "z1"] }, tip = { position = ["x3", "y3", "z3"] } }
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from pliant.errors import InputError
from pliant.recording.camera import Camera, in_plane
from pliant.recording.clock import unwrapped, without_repeats
from pliant.recording.mapping import FileMapping, shorten
from pliant.recording.registry import Reader
from pliant.recording.schema import make_recording
from pliant.recording.tables import judge_end, parse_numbers, read_text, split_cells
from pliant.units import metre_per, pascal_per

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray

Column = int | str


class StationColumns(FileMapping):
    """Columns of one station: position x, y, z (or x, y) and, optionally, quaternion x, y, z, w."""

    position: list[Column] = Field(min_length=2, max_length=3)
    quaternion: list[Column] | None = Field(default=None, min_length=4, max_length=4)


class Points(FileMapping):
    """Regular layout: `count` points side by side, each with its coordinates in `order`."""

    count: int = Field(gt=0)
    order: Literal["xyz", "xy", "yx", "xzy", "yxz", "yzx", "zxy", "zyx"] = "xyz"
    first: int = Field(default=0, ge=0)


class PressureColumns(FileMapping):
    """Columns of gauge pressure, their unit and the names of the chambers."""

    columns: list[Column] = Field(min_length=1)
    unit: str
    chamber: list[str] | None = None


class Select(FileMapping):
    """Keep the rows where `column` has `value`, such as one trial of several."""

    column: Column
    value: float


class ColumnMapping(FileMapping):
    """Description of a table without a header of our own.

    Attributes
    ----------
    delimiter : str
        One character, or ``"space"`` for any white space.
    header : bool
        Whether the first row holds the names of the columns.
    skip_lines : int
        Lines before the table.
    time : column, optional
        Column of time in `time_unit`; without it `rate_hz` is needed.
    rate_hz : float, optional
        Frame rate of a table without a time column.
    length_unit : str
        Of positions.
    camera : Camera, optional
        Instead of `length_unit`, where positions are pixels, x right and y down.
    stations : dict of StationColumns, optional
    points : Points, optional
        Instead of `stations`. A table without either is a log of pressure.
    arc_length : list of float, m, optional
        From base to tip, one per station.
    pressure : PressureColumns, optional
    select : Select, optional
    rows : (first, last), optional
        Rows to keep after `select`, counted from 0, the last excluded.
    """

    delimiter: str = ","
    header: bool = False
    skip_lines: int = Field(default=0, ge=0)
    time: Column | None = None
    time_unit: Literal["s", "ms", "us"] = "s"
    rate_hz: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    length_unit: str = ""
    camera: Camera | None = None
    stations: dict[str, StationColumns] | None = None
    points: Points | None = None
    arc_length: list[float] | None = None
    pressure: PressureColumns | None = None
    select: Select | None = None
    rows: tuple[int, int] | None = None

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        rate = self.rate_hz or (self.camera.rate_hz if self.camera and self.time is None else None)
        if (self.time is None) == (rate is None):
            raise ValueError("give either time, a column, or rate_hz")
        if self.stations and self.points is not None:
            raise ValueError("give either stations or points")
        if not self.stations and self.points is None and self.pressure is None:
            raise ValueError("give stations or points, or pressure for a log of pressure alone")
        if (self.stations or self.points is not None) and bool(self.length_unit) == (self.camera is not None):
            raise ValueError("positions need length_unit, such as 'mm', or camera where they are pixels")
        if self.delimiter != "space" and len(self.delimiter) != 1:
            raise ValueError('delimiter is one character, or "space" for any white space')
        return self


def read_columns(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read the table `path` as a `ColumnMapping` describes it."""
    if not mapping:
        raise InputError(
            f"{path.name} is a plain table: a mapping must say its columns (time or rate_hz, length_unit, "
            "stations or points)"
        )
    options = ColumnMapping.load(mapping, path.name)
    names, table, doubt = _table(path, options)
    history = [*doubt, *_unused(names, table.shape[1], options, path.name)]
    table, kept = _rows(table, names, options, path.name)
    time, wrapped = _time(table, names, options, path.name)
    history += [*kept, *wrapped]
    if not options.stations and options.points is None:
        return _log(time, _pressure(table, names, options, path.name), history, path.name)
    arrays, more = _stations(table, names, options, path.name)
    if options.camera is not None:
        arrays["position"], how = in_plane(arrays["position"], options.camera, path.parent)
        more.append(how)
    try:
        return make_recording(
            time, **arrays, **_pressure(table, names, options, path.name), arc_length=options.arc_length,
            history=[*history, *more],
        )  # fmt: skip
    except InputError as error:
        raise InputError(f"{path.name}: {error}") from None


def _table(path: Path, options: ColumnMapping) -> tuple[list[str], NDArray, list[str]]:
    lines = read_text(path).split("\n")
    first = options.skip_lines
    while first < len(lines) and (not lines[first].strip() or lines[first].startswith("#")):
        first += 1
    if first >= len(lines):
        raise InputError(f"{path.name} has no row after its first {options.skip_lines} line(s)")
    delimiter = None if options.delimiter == "space" else options.delimiter
    cells = split_cells(lines[first], delimiter)
    body = first + 1 if options.header else first
    rows, doubt = judge_end(lines[body:], delimiter, path.name)
    table = parse_numbers(rows, name=path.name, first_line=body + 1, delimiter=delimiter, columns=len(cells))
    return (cells if options.header else []), table, doubt


def _unused(names: list[str], width: int, options: ColumnMapping, file: str) -> list[str]:
    """Which columns the mapping does not speak of."""
    wanted: list[Column | None] = [options.time, options.select.column if options.select else None]
    wanted += options.pressure.columns if options.pressure else []
    for station in _layout(options).values():
        wanted += [*station.position, *(station.quaternion or [])]
    used = {_index(column, names, width, file) for column in wanted if column is not None}
    left = [names[i] if names else i for i in range(width) if i not in used]
    told = f"{len(left)} column(s) of {file} are not in the mapping and were left out: {shorten(left)}"
    return [told] if left else []


def _index(column: Column, names: list[str], width: int, file: str) -> int:
    if isinstance(column, str):
        if column not in names:
            available = ", ".join(names[:40]) or "none: header is false, so columns are given by index"
            raise InputError(f"{file} has no column {column!r}; available: {available}")
        if names.count(column) > 1:
            raise InputError(f"{file} has {names.count(column)} columns named {column!r}: give it by index")
        return names.index(column)
    if not 0 <= column < width:
        raise InputError(f"{file} has {width} columns, 0 to {width - 1}: there is no column {column}")
    return column


def _rows(
    table: NDArray, names: list[str], options: ColumnMapping, file: str
) -> tuple[NDArray, list[str]]:
    history = []
    if options.select is not None:
        values = table[:, _index(options.select.column, names, table.shape[1], file)]
        keep = values == options.select.value
        if not keep.any():
            found = ", ".join(f"{v:g}" for v in np.unique(values[np.isfinite(values)])[:20])
            raise InputError(f"no row of {file} has {options.select.value:g} in column "
                             f"{options.select.column!r}; it holds {found}")  # fmt: skip
        history.append(f"kept {int(keep.sum())} of {len(table)} rows: {options.select.column} = "
                       f"{options.select.value:g}")  # fmt: skip
        table = table[keep]
    if options.rows is not None:
        first, last = options.rows
        if not 0 <= first < last <= len(table):
            raise InputError(f"rows {first} to {last} do not lie within the {len(table)} rows of {file}")
        history.append(f"kept rows {first} to {last - 1} of {len(table)}")
        table = table[first:last]
    return table, history


def _time(table: NDArray, names: list[str], options: ColumnMapping, file: str) -> tuple[NDArray, list[str]]:
    if options.time is None:
        rate = options.rate_hz or (options.camera.rate_hz if options.camera else None)
        return np.arange(len(table)) / float(rate or np.nan), []
    column = _index(options.time, names, table.shape[1], file)
    return unwrapped(table[:, column], options.time_unit, file)


def _log(time: NDArray, pressure: dict[str, Any], history: list[str], file: str) -> xr.Dataset:
    """A recording of pressure alone."""
    keep, repeats = without_repeats(time, file)
    values = pressure.pop("pressure")[keep]
    try:
        return make_recording(pressure=values, pressure_time=time[keep], history=[*history, *repeats], **pressure)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None


def _layout(options: ColumnMapping) -> dict[str, StationColumns]:
    if options.points is None:
        return options.stations or {}
    points, width = options.points, len(options.points.order)
    stations = {}
    for i in range(points.count):
        at = points.first + i * width
        columns = [at + points.order.index(axis) for axis in "xyz"[:width]]
        stations[f"s{i:03d}"] = StationColumns(position=list(columns))
    return stations


def _stations(
    table: NDArray, names: list[str], options: ColumnMapping, file: str
) -> tuple[dict[str, Any], list[str]]:
    stations = _layout(options)
    position = np.zeros((len(table), len(stations), 3))
    quaternion = np.full((len(table), len(stations), 4), np.nan)
    history = []
    for s, (name, columns) in enumerate(stations.items()):
        indices = [_index(c, names, table.shape[1], file) for c in columns.position]
        position[:, s, : len(indices)] = table[:, indices] * metre_per(options.length_unit or "m")
        if columns.quaternion is not None:
            raw = table[:, [_index(c, names, table.shape[1], file) for c in columns.quaternion]]
            quaternion[:, s], lost = unit_quaternions(raw)
            if lost:
                history.append(f"{lost} quaternion(s) of {name} are incomplete or far from unit length and became NaN")
    if any(len(c.position) == 2 for c in stations.values()):
        history.append("stations with two coordinates got z = 0")
    arrays: dict[str, Any] = {"position": position, "station": list(stations)}
    if np.isfinite(quaternion).any():
        arrays["quaternion"] = quaternion
    return arrays, history


def unit_quaternions(raw: NDArray) -> tuple[NDArray, int]:
    """Normalise (T, 4) quaternions that are rounded; others with any number in them become NaN, counted."""
    with np.errstate(over="ignore", invalid="ignore"):  # 1e999 is no quaternion either
        norm = np.linalg.norm(raw, axis=-1, keepdims=True)
    good = np.abs(norm - 1.0) < 0.05
    lost = int((~good[:, 0] & ~np.isnan(raw).all(-1)).sum())
    return np.where(good, raw / np.where(good, norm, 1.0), np.nan), lost


def _pressure(table: NDArray, names: list[str], options: ColumnMapping, file: str) -> dict[str, Any]:
    if options.pressure is None:
        return {}
    indices = [_index(c, names, table.shape[1], file) for c in options.pressure.columns]
    values = table[:, indices] * pascal_per(options.pressure.unit)
    if len(indices) == 1 and options.pressure.chamber is None:
        return {"pressure": values[:, 0]}
    chamber = options.pressure.chamber or [str(c) for c in options.pressure.columns]
    return {"pressure": values, "chamber": chamber}


READER = Reader("columns", (".txt", ".dat"), read_columns, needs_mapping=True)
