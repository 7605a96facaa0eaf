"""Reader of plain tables of numbers, for which a mapping names the columns of time, pressure, position and orientation.

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

from collections import defaultdict
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError, clipped, inside
from pliant.recording.camera import in_plane
from pliant.recording.clock import unwrapped, without_repeats
from pliant.recording.column_mapping import Column, ColumnMapping, StationColumns
from pliant.recording.mapping import shorten
from pliant.recording.registry import ENDINGS, Reader
from pliant.recording.schema import make_recording
from pliant.recording.stated import WARNING
from pliant.recording.tables import judge_end, parse_numbers, read_text, split_cells, without_text
from pliant.units import metre_per, newton_per, pascal_per, radian_per

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray


CHANGING = "left-out column(s)"  # begins the sentence on columns that a mapping forgot


class ColumnHeader:
    """Header of a table: its file name, its column names (empty where the first row holds numbers) and the number of
    columns.
    """

    def __init__(self, names: list[str], width: int, file: str) -> None:
        self.names, self.width, self.file = names, width, file
        self.where: dict[str, list[int]] = defaultdict(list)
        for k, name in enumerate(names):
            self.where[name].append(k)

    def index(self, column: Column) -> int:
        """Return the index of a table column that is given by index or name; raise InputError where none or several
        match.
        """
        if isinstance(column, str):
            held = self.where.get(column, [])
            if not held:
                available = shorten(self.names, 40) or "none: header is false, so columns are given by index"
                raise InputError(f"{self.file} has no column {clipped(column)!r}: correct the mapping; available: "
                                 f"{available}")
            if len(held) > 1:
                raise InputError(f"{self.file} has {len(held)} columns named {clipped(column)!r}: give the index of "
                                 "one in the mapping")
            return held[0]
        if not 0 <= column < self.width:
            raise InputError(f"{self.file} has no column {column}, since its columns are 0 to {self.width - 1}: "
                             "correct the mapping")
        return column


def read_columns(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read a plain table of numbers as a recording; `mapping` states which columns hold what, and their units."""
    if not mapping:
        raise InputError(
            f"{path.name} is a plain table: give a mapping that names its columns (time or rate_hz, length_unit, "
            "stations or points)"
        )
    options = ColumnMapping.load(mapping, path.name)
    header, table, findings = _table(path, options)
    history = [*findings, *_unused(header, options, table)]
    table, kept = _rows(table, header, options)
    time, wrapped = _time(table, header, options)
    history += [*kept, *wrapped]
    whole = bool(options.stations) or options.points is not None
    if options.time is not None or not whole:
        keep, more = without_repeats(time, path.name, table[:, sorted(_used(header, options))] if whole else None)
        time, table, history = time[keep], table[keep], [*history, *more]
        if len(same := np.flatnonzero(np.diff(time) == 0)):
            raise InputError(f"{path.name}: time must increase strictly, but {len(same)} pair(s) of rows have the "
                             f"same time and different values, the first {time[same[0]]:.6g} s: write the times with "
                             "all digits, or keep one run by rows = [first, last] in the mapping")  # fmt: skip
    if whole:
        arrays, more = _stations(table, header, options)
        if options.camera is not None:
            arrays["position"], how = in_plane(arrays["position"], options.camera, path.parent)
            more.append(how)
    else:
        arrays, more = _turning(table, header, options) if options.angles else ({}, [])
    with inside(path.name):
        return make_recording(
            time if arrays else None, pressure_time=time, input_time=time, history=[*history, *more],
            **arrays, **_pressure(table, header, options), **_inputs(table, header, options),
        )  # fmt: skip


def _table(path: Path, options: ColumnMapping) -> tuple[ColumnHeader, NDArray, list[str]]:
    lines = read_text(path).split("\n")
    first = options.skip_lines
    while first < len(lines) and (not lines[first].strip() or lines[first].startswith("#")):
        first += 1
    if first >= len(lines):
        raise InputError(f"{path.name} has no table row after its first {options.skip_lines} line(s): reduce "
                         "skip_lines in the mapping")
    delimiter = None if options.delimiter == "space" else options.delimiter
    cells = split_cells(lines[first], delimiter)
    body = first + 1 if options.header else first
    rows, findings = judge_end(lines[body:], delimiter, path.name)
    header = ColumnHeader(cells if options.header else [], len(cells), path.name)
    if options.header:
        rows = without_text(rows, delimiter, _used(header, options), header.width)
    table = parse_numbers(rows, name=path.name, first_line=body + 1, delimiter=delimiter, columns=len(cells))
    return header, table, findings


def _used(header: ColumnHeader, options: ColumnMapping) -> set[int]:
    """Return the indices of the columns that the mapping uses."""
    wanted: list[Column | None] = [options.time, options.select.column if options.select else None]
    wanted += options.pressure.columns if options.pressure else []
    wanted += [column for group in options.inputs for column in group.columns]
    wanted += list((options.angles or {}).values())
    for station in _layout(options, header).values():
        wanted += [*station.position, *(station.quaternion or [])]
    return {header.index(column) for column in wanted if column is not None}


def _unused(header: ColumnHeader, options: ColumnMapping, table: NDArray) -> list[str]:
    """Return one sentence that lists the columns that the mapping does not use, and one that names those of them whose
    values change; none where it uses all.
    """
    used = _used(header, options)
    left = {i: header.names[i] if header.names else i for i in range(header.width) if i not in used}
    if not left:
        return []
    names = shorten([*left.values()])
    finding = f"{len(left)} column(s) of {header.file} are not in the mapping and were left out: {names}"
    return [finding, *changing_columns({name: table[:, i] for i, name in left.items()}, header.file)]


def changing_columns(columns: Mapping[Any, NDArray], file: str) -> list[str]:
    """Return a sentence that names the columns (T,) whose values change, such as a sensor that a mapping forgot; an
    empty list if there are none. Counters, which grow by the same step in every row, are left out.
    """
    moving = []
    for name, values in columns.items():
        known = values[np.isfinite(values)]
        step = np.diff(known)
        if step.any() and np.ptp(step) > 1e-6 * np.abs(step).max():
            moving.append(name)
    verb = "changes" if len(moving) == 1 else "change"
    return [f"{CHANGING} of {file} {verb} during the recording: {shorten(moving)}"] if moving else []


def _rows(table: NDArray, header: ColumnHeader, options: ColumnMapping) -> tuple[NDArray, list[str]]:
    history, file = [], header.file
    if options.select is not None:
        values = table[:, header.index(options.select.column)]
        keep = values == options.select.value
        if not keep.any():
            found = ", ".join(f"{v:g}" for v in np.unique(values[np.isfinite(values)])[:20])
            raise InputError(f"no row of {file} has {options.select.value:g} in column {options.select.column!r}: "
                             f"correct select in the mapping; the column holds {found}")  # fmt: skip
        history.append(f"kept {int(keep.sum())} of {len(table)} rows: {options.select.column} = "
                       f"{options.select.value:g}")  # fmt: skip
        table = table[keep]
    if options.rows is not None:
        first, last = options.rows
        if not 0 <= first < last <= len(table):
            raise InputError(f"rows = [{first}, {last}] of the mapping is not within the {len(table)} rows of "
                             f"{file}: correct rows")
        history.append(f"kept rows {first} to {last - 1} of {len(table)}")
        if last == len(table) - 1:
            history.append(f"{WARNING}rows = [{first}, {last}] leaves out the last row of {file}: the second number is "
                           f"the first row that is not read, {len(table)} for all")  # fmt: skip
        table = table[first:last]
    return table, history


def _time(table: NDArray, header: ColumnHeader, options: ColumnMapping) -> tuple[NDArray, list[str]]:
    if options.time is None:
        rate = options.rate_hz or (options.camera.rate_hz if options.camera else None)
        return np.arange(len(table)) / float(rate or np.nan), []
    return unwrapped(table[:, header.index(options.time)], options.time_unit, header.file)


def _turning(table: NDArray, header: ColumnHeader, options: ColumnMapping) -> tuple[dict[str, Any], list[str]]:
    """Return the arguments of `make_recording` for stations of which only the angles were measured."""
    angles = options.angles or {}
    columns = [header.index(column) for column in angles.values()]
    angle, turns = whole_turns(table[:, columns] * radian_per(options.angle_unit or "rad"))
    return {"angle": angle, "station": list(angles), "frame": "planar", "arc_length": options.arc_length}, turns


ONE_TURN = 2.1 * np.pi  # rad: a sensor that wraps after one turn reads no more; one that reads more does not wrap


def whole_turns(angle: NDArray) -> tuple[NDArray, list[str]]:
    """Remove the jumps of 360 degrees from the angles (T, S) [rad] of S sensors over T frames, and return them with a
    history line that counts the jumps.
    """
    seen = np.isfinite(angle)
    result, jumps = angle.copy(), 0
    for s in range(angle.shape[1]):
        read = angle[seen[:, s], s]
        if read.size and np.ptp(read) > ONE_TURN:
            continue
        steady = np.unwrap(read)
        jumps += int((np.abs(np.diff(steady) - np.diff(angle[seen[:, s], s])) > 1.0).sum())
        result[seen[:, s], s] = steady
    return result, [f"{jumps} jump(s) of an angle by a full turn were removed"] if jumps else []


def _layout(options: ColumnMapping, header: ColumnHeader) -> dict[str, StationColumns]:
    """Return the columns of each station."""
    if options.points is None:
        return options.stations or {}
    points, width = options.points, len(options.points.order)
    if (last := points.first + points.count * width) > header.width:
        raise InputError(f"the mapping's points take columns {points.first} to {last - 1}, but {header.file} has "
                         f"{header.width} columns: correct points.count, points.first or points.order")
    stations = {}
    for i in range(points.count):
        at = points.first + i * width
        place: list[Column] = [at + points.order.index(axis) for axis in "xyz"[:width]]
        stations[f"s{i:03d}"] = StationColumns(position=place)
    return stations


def _stations(table: NDArray, header: ColumnHeader, options: ColumnMapping) -> tuple[dict[str, Any], list[str]]:
    stations = _layout(options, header)
    position = np.zeros((len(table), len(stations), 3))
    quaternion = np.full((len(table), len(stations), 4), np.nan)
    history = []
    for s, columns in enumerate(stations.values()):
        indices = [header.index(c) for c in columns.position]
        position[:, s, : len(indices)] = table[:, indices] * metre_per(options.length_unit or "m")
        if columns.quaternion is not None:
            quaternion[:, s] = table[:, [header.index(c) for c in columns.quaternion]]
    if any(len(c.position) == 2 for c in stations.values()):
        history.append("stations with two coordinates got z = 0")
    arrays: dict[str, Any] = {"position": position, "station": list(stations), "arc_length": options.arc_length}
    if not np.isnan(quaternion).all():
        arrays["quaternion"] = quaternion
    return arrays, history


def _pressure(table: NDArray, header: ColumnHeader, options: ColumnMapping) -> dict[str, Any]:
    if options.pressure is None:
        return {}
    indices = [header.index(c) for c in options.pressure.columns]
    values = table[:, indices] * pascal_per(options.pressure.unit)
    chamber = [str(c) for c in options.pressure.columns] if len(indices) > 1 else None
    return {"pressure": values, "chamber": options.pressure.chamber or chamber}


INPUT_SI = {"tension": newton_per, "displacement": metre_per, "angle": radian_per}


def _inputs(table: NDArray, header: ColumnHeader, options: ColumnMapping) -> dict[str, Any]:
    """Return the arguments of `make_recording` for the inputs other than pressure."""
    if not options.inputs:
        return {}
    values, names, kinds = [], [], []
    for group in options.inputs:
        indices = [header.index(c) for c in group.columns]
        given = group.names or [header.names[i] if header.names else f"column_{i}" for i in indices]
        if len(given) != len(indices):
            raise InputError(f"the mapping for {header.file} gives {len(given)} names to {len(indices)} columns of "
                             "inputs: give one name to each column")  # fmt: skip
        values.append(table[:, indices] * INPUT_SI[group.kind](group.unit))
        names += given
        kinds += [group.kind] * len(indices)
    return {"actuation": np.concatenate(values, axis=1), "input_names": names, "input_kind": kinds}


READER = Reader("columns", ENDINGS["columns"], read_columns, needs_mapping=True)
