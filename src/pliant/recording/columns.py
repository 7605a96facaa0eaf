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

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError, clipped, inside
from pliant.recording.camera import in_plane
from pliant.recording.cells import (
    cells_of,
    empty_markers,
    ends_alike,
    is_one_of,
    with_seconds,
    with_states,
    without_marks,
    without_trailing,
)
from pliant.recording.clock import PartedClock, unwrapped, without_repeats
from pliant.recording.column_arrays import (
    Column,
    ColumnHeader,
    ColumnMapping,
    InputColumns,
    PressureColumns,
    StationColumns,
    calibrated,
    input_arrays,
    pressure_arrays,
    station_arrays,
)
from pliant.recording.column_names import completed
from pliant.recording.inclination import gravity_rows, turning_angles, whole_turns
from pliant.recording.joined_runs import RUN, refuse_several
from pliant.recording.mapping import shorten
from pliant.recording.schema import make_recording
from pliant.recording.stated import WARNING
from pliant.recording.tables import (
    COPY,
    NUMBER,
    delimiter_of,
    first_row,
    holds_number,
    judge_end,
    parse_numbers,
    preamble_of,
    split_cells,
    without_text,
)
from pliant.recording.tidy import holds_rows, table_lines
from pliant.recording.units_row import with_units
from pliant.units import radian_per

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray


CHANGING = "left-out column(s)"  # begins the sentence on columns that a mapping forgot


def read_columns(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read a plain table of numbers as a recording; `mapping` states which columns hold what, and their units."""
    if not mapping:
        if not holds_rows(path):
            raise InputError(f"{path.name} holds text and no rows of numbers: leave it out, or export the table again")
        raise InputError(f"{path.name} is a plain table: give a mapping that names its columns (time or rate_hz, "
                         f"length_unit, stations or points){_listed(path)}")  # fmt: skip
    mapping, named = completed(mapping, first_cells(path, mapping), path.name)
    options = ColumnMapping.load(mapping, path.name)
    if options.select is not None and options.select.value is None:
        example = f"select = {{ column = {options.select.column!r}, value = 1 }}"
        raise InputError(f"select in the mapping for {path.name} has no value: state which trial to read, such as "
                         f"{example}; `pliant new` makes a recording of each")
    header, table, texts, findings = _table(path, options)
    history = [*named, *findings, *_unused(header, options, table)]
    table, row_notes = _rows(_valid(table, texts, header, options, history), texts, header, options)
    history += row_notes
    whole = bool(options.stations) or options.points is not None
    time, shape, more = _timed(table, options.time, header, options, whole=whole)
    history += more
    if options.input_time is None:
        input_time, inputs = time, shape
    else:
        input_time, inputs, more = _timed(table, options.input_time, header, options, whole=False)
        history += more
    if whole:
        arrays, more = station_arrays(shape, header, _layout(options, header), options)
        if options.camera is not None:
            arrays["position"], how = in_plane(arrays["position"], options.camera, path.parent)
            more.append(how)
    else:
        arrays, more = _turning(shape, header, options) if options.angles else ({}, [])
    groups: list[PressureColumns | InputColumns] = [*options.inputs, *([options.pressure] if options.pressure else [])]
    for group in groups:
        history += calibrated(group.columns, group.scale, group.zero, group.unit)
    with inside(path.name):
        return make_recording(
            time if arrays else None, pressure_time=input_time, input_time=input_time, history=[*history, *more],
            **arrays, **pressure_arrays(inputs, header, options.pressure), **input_arrays(inputs, header, options),
        )  # fmt: skip


def first_cells(path: Path, mapping: Mapping[str, Any]) -> list[str]:
    """Return the cells of the first row of a table behind the lines that its mapping skips."""
    skipped, stated, header = mapping.get("skip_lines"), mapping.get("delimiter"), mapping.get("header")
    skipped, stated = skipped if isinstance(skipped, int) else None, stated if isinstance(stated, str) else None
    lines, _, _ = table_lines(path, skip_lines=skipped, delimiter=stated or None,
                              header=header if isinstance(header, bool) else None)  # fmt: skip
    first = first_row(lines, preamble_of(lines) if skipped is None else skipped)
    line = lines[first] if first < len(lines) else ""
    delimiter = delimiter_of(line, stated or None)
    lines, _ = with_units(lines, first, delimiter, path.name)
    cells = split_cells(lines[first], delimiter) if line else []
    return cells[:-1] if cells[-1:] == [""] else cells


def _listed(path: Path) -> str:
    """Return what the first row of a plain table shows of its columns, for a message."""
    cells = first_cells(path, {})
    named = not any(map(holds_number, filter(None, cells)))
    return f"; they are {shorten(cells, 12)}" if named else f"; they are 0 to {len(cells) - 1}"


def _table(path: Path, options: ColumnMapping) -> tuple[ColumnHeader, NDArray, dict[int, NDArray], list[str]]:
    """Return the header of a table, its numbers (R, K) with NaN for texts, the texts (R,) of the columns that the
    mapping uses as texts, and sentences for the history.
    """
    lines, tidied, runs = table_lines(path, skip_lines=options.skip_lines, delimiter=options.delimiter,
                                      header=options.header, events=not options.rows and not options.na)  # fmt: skip
    if options.select is None and options.rows is None:
        refuse_several(runs, path.name, drafted=not options.angles)
    first = preamble_of(lines) if options.skip_lines is None else options.skip_lines
    above = [*tidied, f"{first} line(s) above the table of {path.name} were skipped"] \
        if first and not options.skip_lines else tidied
    first = first_row(lines, first)
    if first >= len(lines):
        raise InputError(f"{path.name} has no table row after its first {first} line(s): reduce "
                         "skip_lines in the mapping")
    delimiter, name = delimiter_of(lines[first], options.delimiter), path.name
    lines, united = with_units(lines, first, delimiter, name)
    cells = split_cells(lines[first], delimiter)
    named = header_of(cells, options, f"line {first + 1}, cell 1 of {name}")
    body = first + 1 if named else first
    rows = lines[body:]
    if cells[-1] == "" and (named or ends_alike(rows, delimiter)):  # a delimiter behind the last cell
        cells.pop()
    rows, findings = without_trailing(rows, delimiter, len(cells), name)
    rows, cut = judge_end(rows, delimiter, name)
    header = ColumnHeader(cells if named else [], len(cells), name)
    worded, used = _worded(header, options), _used(header, options)
    texts = cells_of(rows, delimiter, worded) if worded else {}
    if options.na:
        rows, marked = without_marks(rows, delimiter, used - worded, options.na, name)
        findings += marked
    for column in {header.index(c) for c in (*_clocks(options), options.input_time) if c is not None}:
        rows, clock = with_seconds(rows, delimiter, column, name)
        findings += clock
        header.in_seconds |= {column} if clock else set()
    rows, states = with_states(rows, delimiter, {header.index(column) for column in _inputs(options)}, name)
    findings += states
    rows = without_text(rows, delimiter, used - worded, header.width, header=named, words=worded)
    table = parse_numbers(rows, name=name, first_line=body + 1, delimiter=delimiter, columns=len(cells))
    return header, table, texts, [*above, *united, *findings, *empty_markers(table, name), *cut]


def header_of(cells: list[str], options: ColumnMapping, where: str) -> bool:
    """Return whether the first row of a table holds the names of the columns: as `header` of the mapping states or,
    without this entry, if none of its cells holds a number.

    Raises
    ------
    InputError
        When the mapping states that the row holds numbers, and it holds none.
    """
    filled = [cell for cell in cells if cell]
    words = bool(filled) and not any(map(holds_number, filled))
    if options.header is False and words:
        raise InputError(f"{where} is not a number: {clipped(cells[0])!r}; the row seems to hold names: remove "
                         "header = false from the mapping")
    return words if options.header is None else options.header


def _clocks(options: ColumnMapping) -> tuple[Column, ...]:
    """Return the columns of the time of the shape: none, one, or that of the seconds and that of their fraction."""
    if options.time is None:
        return ()
    return options.time if isinstance(options.time, tuple) else (options.time,)


def _inputs(options: ColumnMapping) -> list[Column]:
    """Return the columns of the pressures and of the other inputs."""
    pressures = options.pressure.columns if options.pressure else []
    return [*pressures, *(column for group in options.inputs for column in group.columns)]


def _worded(header: ColumnHeader, options: ColumnMapping) -> set[int]:
    """Return the indices of the columns whose texts the mapping uses: the status of stations, and a text to select."""
    columns = [station.status for station in (options.stations or {}).values() if station.status is not None]
    if options.select is not None and isinstance(options.select.value, str):
        columns.append(options.select.column)
    return {header.index(column) for column in columns}


def _valid(
    table: NDArray, texts: Mapping[int, NDArray], header: ColumnHeader, options: ColumnMapping, history: list[str]
) -> NDArray:
    """Return the numbers (R, K) of a table with gaps where the status of a station is not valid, and add a sentence to
    `history` for each such station.
    """
    table = table.copy()
    for name, station in (options.stations or {}).items():
        if station.status is None:
            continue
        words = texts[header.index(station.status)]
        lost = ~is_one_of(words, station.valid)
        if lost.all():
            raise InputError(f"{header.file}: no row has {shorten(station.valid)} in the status of {clipped(name)}, "
                             f"which holds {shorten(sorted(set(words)), 6)}: correct valid in the mapping")
        columns = [*station.position, *(station.quaternion or []), *(station.euler.columns if station.euler else [])]
        table[np.ix_(lost, np.array([header.index(c) for c in columns]))] = np.nan
        others = shorten(sorted(set(words[lost])), 6)
        history += [f"{int(lost.sum())} frame(s) of {name} are gaps by their status: {others}"] if lost.any() else []
    return table


def _used(header: ColumnHeader, options: ColumnMapping) -> set[int]:
    """Return the indices of the columns that the mapping uses."""
    wanted: list[Column | None] = [*_clocks(options), options.input_time]
    wanted += [options.select.column] if options.select else []
    wanted += _inputs(options)
    for columns in (options.angles or {}).values():
        wanted += columns if isinstance(columns, list) else [columns]
    for station in _layout(options, header).values():
        wanted += [*station.position, *(station.quaternion or []), *(station.euler.columns if station.euler else [])]
        wanted.append(station.status)
    return {header.index(column) for column in wanted if column is not None}


def _unused(header: ColumnHeader, options: ColumnMapping, table: NDArray) -> list[str]:
    """Return one sentence that lists the columns that the mapping does not use, and one that names those of them whose
    values change; none where it uses all.
    """
    used = _used(header, options)
    left = {i: name for i, name in enumerate(header.names or range(header.width))
            if i not in used and not str(name).startswith(COPY)}
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


def _rows(
    table: NDArray, texts: Mapping[int, NDArray], header: ColumnHeader, options: ColumnMapping
) -> tuple[NDArray, list[str]]:
    history, file = [], header.file
    if options.select is not None:
        column, value = options.select.column, options.select.value
        worded = isinstance(value, str)
        values = texts[header.index(column)] if worded else table[:, header.index(column)]
        keep = values == value
        if not keep.any():
            listing = shorten(sorted(set(values))) if worded else \
                ", ".join(f"{v:g}" for v in np.unique(values[np.isfinite(values)])[:20])
            raise InputError(f"no row of {file} has {_word(value)} in column {column!r}: correct select in the mapping;"
                             f" the column holds {listing}")  # fmt: skip
        history.append(f"kept {int(keep.sum())} of {len(table)} rows: {column} = {_word(value)}")
        table = table[keep]
    if options.rows is not None:
        table, more = kept_rows(table, options.rows, file)
        history += more
    return table, history


def kept_rows(table: NDArray, rows: tuple[int, int], file: str) -> tuple[NDArray, list[str]]:
    """Return the rows of a table (R, K) from the first number up to the second, excluded, and sentences for the
    history.
    """
    first, last = rows
    if not 0 <= first < last <= len(table):
        raise InputError(f"rows = [{first}, {last}] of the mapping is not within the {len(table)} rows of {file}: "
                         "correct rows")
    history = [f"kept rows {first} to {last - 1} of {len(table)}"]
    if last == len(table) - 1:
        history.append(f"{WARNING}rows = [{first}, {last}] leaves out the last row of {file}: the second number is "
                       f"the first row that is not read, {len(table)} for all")  # fmt: skip
    return table[first:last], history


def _word(value: float | str | None) -> str:
    return clipped(value) if isinstance(value, str) else f"{value:g}"


def _timed(
    table: NDArray, clock: Column | tuple[Column, Column] | None, header: ColumnHeader, options: ColumnMapping, *,
    whole: bool,
) -> tuple[NDArray, NDArray, list[str]]:
    """Return the times [s] of a table's rows by the column `clock`, the rows with a time of their own, and sentences
    for the history. With `whole`, for a shape, only equal rows at equal times are left out.
    """
    if clock is None:
        rate = options.rate_hz or (options.camera.rate_hz if options.camera else None)
        time = np.arange(len(table)) / float(rate or np.nan)
        history: list[str] = []
        if whole:
            return time, table, history
    else:
        columns = [header.index(c) for c in (clock if isinstance(clock, tuple) else (clock,))]
        table, history = without_idle(table, columns[0], _timed_by(header, options, whole=whole), header.file)
        ticks = table[:, columns[0]]
        if len(columns) > 1:
            ticks = PartedClock(columns[0], columns[1], options.time_unit).joined(table)
        unit = "s" if isinstance(clock, tuple) else header.unit_of_time(clock, options)
        time, wrapped = unwrapped(ticks, unit, header.file)
        history += wrapped
    keep, more = without_repeats(time, header.file, table[:, sorted(_numeric(header, options))] if whole else None)
    time, table = time[keep], table[keep]
    if len(same := np.flatnonzero(np.diff(time) == 0)):
        raise InputError(f"{header.file}: time must increase strictly, but {len(same)} pair(s) of rows have the "
                         f"same time and different values, the first {time[same[0]]:.6g} s: write the times with "
                         "all digits, or keep one run by rows = [first, last] in the mapping")  # fmt: skip
    return time, table, [*history, *more]


def without_idle(table: NDArray, clock: int, columns: Collection[int], file: str) -> tuple[NDArray, list[str]]:
    """Return the rows of a table (R, K) without those that have neither a time in the column `clock` nor a value in
    `columns`, such as the end of a shorter column, and a sentence for the history that counts them.
    """
    others = sorted(set(columns) - {clock})
    idle = np.isnan(table[:, clock]) & np.isnan(table[:, others]).all(axis=1)
    count = int(idle.sum())
    if not count or idle.all():
        return table, []
    return table[~idle], [f"{count} row(s) of {file} have neither a time nor values and are left out"]


def _timed_by(header: ColumnHeader, options: ColumnMapping, *, whole: bool) -> set[int]:
    """Return the indices of the columns whose times are those of the shape (`whole`) or else of the inputs."""
    clocked = {header.index(column) for column in _inputs(options)}
    if options.input_time is None:
        return _numeric(header, options)
    shape = _numeric(header, options) - clocked - {header.index(options.input_time)}
    return shape if whole else clocked


def _numeric(header: ColumnHeader, options: ColumnMapping) -> set[int]:
    return _used(header, options) - _worded(header, options)


def _turning(table: NDArray, header: ColumnHeader, options: ColumnMapping) -> tuple[dict[str, Any], list[str]]:
    """Return the arguments of `make_recording` for stations of which only the angles or inclinations were measured."""
    angles = options.angles or {}
    listed = {name: columns if isinstance(columns, list) else [columns] for name, columns in angles.items()}
    measured = {name: table[:, [header.index(column) for column in columns]] for name, columns in listed.items()}
    if options.inclination is not None:
        arrays, history = gravity_rows(measured, options.inclination, header.file)
        return {**arrays, "arc_length": options.arc_length}, history
    if any(len(columns) > 1 for columns in listed.values()):
        angle, turns = turning_angles(measured, header.file)
    else:
        stored = np.concatenate([*measured.values()], axis=1)
        angle, turns = whole_turns(stored * radian_per(options.angle_unit or "rad"))
    return {"angle": angle, "station": list(angles), "frame": "planar", "arc_length": options.arc_length}, turns


def _layout(options: ColumnMapping, header: ColumnHeader) -> dict[str, StationColumns]:
    """Return the columns of each station."""
    if options.points is None:
        return options.stations or {}
    points, width = options.points, len(options.points.order)
    if (last := points.first + points.count * width) > header.width:
        raise InputError(f"the mapping's points take columns {points.first} to {last - 1}, but those of "
                         f"{header.file} are 0 to {header.width - 1}: correct points.count, points.first or "
                         "points.order")
    stations = {}
    for i in range(points.count):
        begin = points.first + i * width
        axes: list[Column] = [begin + points.order.index(axis) for axis in "xyz"[:width]]
        stations[f"s{i:03d}"] = StationColumns(position=axes)
    return stations


def trials_in_table(path: Path, mapping: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the options of each trial of a table by the trial's value in the column of `select`, where the mapping
    states no value, or by the number of its run, where the table holds several; empty otherwise.
    """
    mapping, _ = completed(mapping, first_cells(path, mapping), path.name)
    options = ColumnMapping.load(mapping, path.name)
    if options.select is None and options.rows is None:
        runs = table_lines(path, skip_lines=options.skip_lines, delimiter=options.delimiter, header=options.header).runs
        return {str(k): {**mapping, "select": {"column": RUN, "value": k}} for k in range(1, len(runs) + 1)}
    if options.select is None or options.select.value is not None:
        return {}
    column = options.select.column
    probe = options.model_copy(update={"select": options.select.model_copy(update={"value": ""})})
    header, _, texts, _ = _table(path, probe)
    words = list(dict.fromkeys(word for word in texts[header.index(column)] if word))
    numbers = all(NUMBER.fullmatch(word) for word in words)
    return {word: {**mapping, "select": {"column": column, "value": float(word) if numbers else word}}
            for word in words}  # fmt: skip

