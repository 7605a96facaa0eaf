"""Read and write wide CSV: one row per sample, columns ``t,p_kpa,x_000,y_000,z_000,...``, metadata as JSON in the first
line or a file.

Columns: ``t`` (s), ``t_ms`` or ``t_us``; ``p_<unit>`` or ``<unit>`` for one gauge pressure, or ``p_<unit>_<chamber>``
for several; ``x_<station>``, ``y_<station>`` and, unless planar, ``z_<station>``; optional ``qx_ qy_ qz_ qw_<station>``
and ``angle_<station>`` (rad). Their order is free. `pliant.recording.column_names` translates other spellings
(``time_ms``, ``tip_x [mm]``, ``Pressure (mbar)``). The metadata are in a first line ``# {...}`` or in a JSON file of
the same name beside the table: ``length_unit`` (default m), ``station``, ``arc_length`` (m), ``frame``.
"""

from __future__ import annotations

import json
import re
from difflib import get_close_matches
from hashlib import sha256
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ConfigDict, Field

from pliant.errors import InputError, clipped, inside, shown
from pliant.files import whole
from pliant.recording.cells import empty_markers, with_seconds, without_marks, without_trailing
from pliant.recording.clock import parted_clock, unwrapped, without_repeats
from pliant.recording.column_arrays import pressure_unit, pressures_of
from pliant.recording.column_names import (
    CLOCKS,
    COARSE,
    pressures_named,
    refuse_pixels,
    standard_names,
    unit_of,
    unitless_pressures,
    unread_columns,
)
from pliant.recording.columns import changing_columns, first_cells, kept_rows, read_columns, without_idle
from pliant.recording.joined_runs import refuse_several
from pliant.recording.mapping import FileMapping, shorten
from pliant.recording.registry import ENDINGS, Reader
from pliant.recording.schema import COMPONENTS, check_recording, make_recording
from pliant.recording.stated import WARNING, Reading, Stated
from pliant.recording.tables import (
    COPY,
    WIDE,
    delimiter_of,
    find_delimiter,
    first_row,
    holds_number,
    preamble_of,
    read_rows,
    read_text,
    repeated_names,
    split_cells,
    whole_number,
)
from pliant.recording.tidy import table_lines
from pliant.recording.units_row import with_units
from pliant.recording.vocabulary import base_to_tip
from pliant.units import PASCAL, metre_per

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray

FEW = 4  # columns of a log that may all be sensors
KINDS = ("x", "y", "z", "qx", "qy", "qz", "qw", "angle")
HELD = frozenset((  # variables and coordinates that a table and its metadata hold
    "time", "station", "axis", "component", "position", "quaternion", "angle", "arc_length", "pressure",
    "pressure_time", "chamber",
))  # fmt: skip
OWN = frozenset((  # attributes of a recording that are not kept under `attributes`
    "schema", "schema_version", "frame", "source", "source_format", "source_sha256", "pressure_reference", "history",
    "nominal_pressure", "metadata",
))  # fmt: skip
STATION_COLUMN = re.compile(r"(x|y|z|qx|qy|qz|qw|angle)_(.+)")

class TableMetadata(FileMapping):
    """Metadata of a wide CSV file, such as the unit of length and the station names, from its first line or a JSON file
    beside it.
    """

    model_config = ConfigDict(extra="allow", coerce_numbers_to_str=True)

    length_unit: str = "m"
    station: list[str] | None = None
    arc_length: list[float] | None = None
    frame: str = "tracker"
    nominal_pressure: float | None = None
    rows: int | tuple[int, int] | None = None  # as pliant writes them; or [first, last] to keep
    na: list[str | float] = Field(default=[])
    pressure_unit: str | None = None  # of columns whose names say pressure and no unit
    history: str = ""
    source: str | None = None
    source_format: str | None = None
    source_sha256: str | None = None
    angle_reference: str | None = None
    table_sha256: str | None = None
    attributes: dict[str, str | int | float] = Field(default={})


BENT = re.compile(r"(?:curvature|curv|kappa)", re.IGNORECASE)  # beginning of names of curvatures
COLUMNS_ALONE = frozenset(("rate_hz", "time", "select", "time_unit", "input_time", "camera", "left_handed"))
KNOWN_METADATA = frozenset(TableMetadata.model_fields)


def read_wide_csv(path: Path, mapping: Mapping[str, Any] | None = None) -> Reading:
    """Read a wide CSV file as a recording; the options in `mapping` replace metadata in the file. With options that
    only a table of columns has, such as ``rate_hz``, it is read as such a table.
    """
    if COLUMNS_ALONE & set(mapping or {}):
        return Reading(read_columns(path, mapping))
    lines, tidied, runs = table_lines(path)
    metadata, start = _metadata(path, lines)
    metadata = {key: value for key, value in (metadata | dict(mapping or {})).items() if value is not None}
    metadata = TableMetadata.load(metadata, path.name, "metadata of").model_dump(exclude_unset=True)
    delimiter = find_delimiter(lines[start], path.name)
    lines, united = with_units(lines, start, delimiter, path.name)
    cells = split_cells(lines[start], delimiter)
    names, unit, renamed = standard_names(cells[:-1] if cells[-1] == "" else cells, path.name)
    if "pressure_unit" in metadata:
        names, more = pressures_named(names, metadata["pressure_unit"], path.name)
        renamed = [*renamed, *more]
    if fraction := None if set(CLOCKS) & set(names) else parted_clock(names):
        names[fraction.seconds] = "t"
    _check_names(names, cells, path.name)
    if not isinstance(metadata.get("rows"), tuple):
        refuse_several(runs, path.name, drafted=any(name.startswith("x_") for name in names))
    refuse_pixels(unit, path.name)
    if unit and metadata.setdefault("length_unit", unit) != unit:
        raise InputError(f"{path.name}: the column names state {unit}, but length_unit is "
                         f"{metadata['length_unit']}: correct one")
    used = [k for k, name in enumerate(names) if is_known(name) or (fraction and k == fraction.fraction)]
    table, findings = _numbers(lines, start + 1, delimiter, names, used, metadata, path.name)
    if fraction:
        table[:, fraction.seconds] = fraction.joined(table)
        names.pop(fraction.fraction)
        table = np.delete(table, fraction.fraction, axis=1)
    above = sum(bool(line.strip()) and not line.lstrip().startswith("#") for line in lines[:start])
    findings += [f"{above} line(s) above the table of {path.name} were skipped"] if above else []
    findings += tidied + united + renamed + _changed(metadata, lines[start:]) + _misspelt(metadata)
    rows = metadata.get("rows")
    if isinstance(rows, tuple):
        table, row_notes = kept_rows(table, rows, path.name)
        findings += row_notes
    columns = dict(zip(names, table.T, strict=True))
    stated = [Stated("rows", "its metadata", rows, len(table))] if isinstance(rows, int) else []
    return Reading(_recording(columns, metadata, path.name, findings), tuple(stated))


def _numbers(
    lines: list[str], first: int, delimiter: str, names: list[str], used: list[int], metadata: dict[str, Any], file: str
) -> tuple[NDArray, list[str]]:
    """Return the numbers (R, K) of the rows from ``lines[first]`` on, and sentences for the history."""
    rows, findings = without_trailing(lines[first:], delimiter, len(names), file)
    if metadata.get("na"):
        rows, marked = without_marks(rows, delimiter, used, metadata["na"], file)
        findings += marked
    rows, clock = with_seconds(rows, delimiter, names.index(clock_name(names)), file)
    table, cut = read_rows([*lines[:first], *rows], first, delimiter, file, len(names), used)
    table, untimed = without_idle(table, names.index(clock_name(names)), used, file)
    return table, [*findings, *clock, *cut, *empty_markers(table, file), *untimed]


def write_wide_csv(recording: xr.Dataset, path: Path) -> None:
    """Write a recording as wide CSV with full precision; shape and pressure must have the same sample times.

    Raises
    ------
    InputError
        When one table cannot hold the recording: it has no positions, other sample times of shape and pressure, or a
        variable beside positions, orientations, angles and pressure, such as strain.
    """
    check_recording(recording)
    if "position" not in recording:
        raise InputError("a wide CSV holds positions, and the recording has none: write netCDF (.nc) instead")
    if strange := [str(name) for name in recording.variables if name not in HELD]:
        raise InputError(f"a wide CSV cannot hold {shorten(strange)}, only positions, orientations, angles and "
                         "pressure: write netCDF (.nc) instead")
    columns: dict[str, Any] = {"t": recording["time"].values}
    if "pressure" in recording:
        columns |= _pressure_columns(recording)
    labels = [f"{i:03d}" for i in range(recording.sizes["station"])]
    for i, label in enumerate(labels):
        columns |= {
            f"{a}_{label}": recording["position"].values[:, i, k] for k, a in enumerate(recording["axis"].values)
        }
        if "quaternion" in recording:
            q = recording["quaternion"].values[:, i]
            columns |= {f"q{c}_{label}": q[:, k] for k, c in enumerate(COMPONENTS)}
        if "angle" in recording:
            columns[f"angle_{label}"] = recording["angle"].values[:, i]
    rows = np.column_stack(list(columns.values())).tolist()
    table = [",".join(columns), *(",".join("" if v != v else repr(v) for v in row) for row in rows), ""]  # noqa: PLR0124
    metadata = _written_metadata(recording) | {"table_sha256": _checksum(table)}
    with whole(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.write("# " + json.dumps(metadata, ensure_ascii=False) + "\n")
        file.write("\n".join(table))


def _checksum(lines: list[str]) -> str:
    return sha256("\n".join(lines).encode()).hexdigest()


def _changed(metadata: dict[str, Any], lines: list[str]) -> list[str]:
    """Return a sentence where a table that pliant wrote was edited or damaged since, by its checksum."""
    if metadata.get("table_sha256") in (None, _checksum(lines)):
        return []
    return ["the table is not the one that was written: its checksum differs, so it was edited or damaged since"]


def _misspelt(metadata: dict[str, Any]) -> list[str]:
    """Return sentences about unknown metadata entries whose names resemble those of known entries."""
    near = {name: get_close_matches(name[:80].lower().replace("-", "_"), KNOWN_METADATA, 1, 0.8)
            for name in metadata if name not in KNOWN_METADATA}
    return [f"the metadata entry {shown(name)} is unknown and was not used: did you mean {match[0]!r}?"
            for name, match in near.items() if match]


def _metadata(path: Path, lines: list[str]) -> tuple[dict[str, Any], int]:
    """Return the metadata and the index of the header line."""
    start = next((i for i, line in enumerate(lines) if line.strip() and line.lstrip()[0] != "#"), None)
    if start is None:
        raise InputError(f"{path.name} holds only comments, no header and no rows: copy or export it again")
    start = max(start, preamble_of(lines))
    text = next((c for c in (line.lstrip()[1:].strip() for line in lines[:start]) if c.startswith("{")), "")
    origin = "its comment line"
    sidecar = path.with_suffix(".json")
    if not text and sidecar.is_file():
        text, origin = read_text(sidecar), sidecar.name
    if not text:
        return {}, start
    try:
        metadata = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"the metadata of {path.name} in {origin} are not JSON: {clipped(str(error))}; correct or "
                         "remove them") from None
    if not isinstance(metadata, dict):
        raise InputError(f"the metadata of {path.name} in {origin} must be a JSON object: correct or remove them")
    return metadata, start


def _check_names(names: list[str], cells: list[str], file: str) -> None:
    if names and all(map(holds_number, names)):
        raise InputError(f"the first row of {file} holds numbers and no names: give a mapping that names its columns "
                         f"by index, 0 to {len(names) - 1}")
    if repeated := repeated_names(names):
        twice = {*repeated}
        written = [cell for cell, name in zip(cells, names, strict=False) if name in twice]
        raise InputError(f"{file} has repeated column names: {shorten(repeated_names(written) or written, 5)}: rename "
                         "them, or give a mapping that names the columns by index")
    clocks = [n for n in names if n in CLOCKS]
    fine = [n for n in clocks if n not in COARSE] or clocks  # minutes beside seconds are the same clock again
    if len(fine) != 1:
        listing = shorten(names, 8)
        raise InputError(
            f"{file} must have one column t (seconds), t_ms or t_us in its first row, but that row is: {listing}; "
            "a table without such a header needs a mapping"
        )


def clock_name(names: Iterable[str]) -> str:
    """Return the name of the column by which a table is timed: the first of `CLOCKS` among its columns."""
    listed = {*names}
    return next(name for name in CLOCKS if name in listed)


def _recording(columns: dict[str, NDArray], metadata: dict[str, Any], file: str, findings: list[str]) -> xr.Dataset:
    clock = clock_name(columns)
    labels = _station_labels(columns)
    history = list(findings)
    if empty := [n for n, values in columns.items() if pressure_unit(n) and np.isnan(values).all()]:
        columns = {n: values for n, values in columns.items() if n not in empty}
        history.append(f"{len(empty)} column(s) of pressure of {file} hold no number, left out: {shorten(empty)}")
    pressure, chamber = pressures_of(columns)
    ignored = [n for n in columns if not is_known(n) and not n.startswith(COPY)]
    if ignored:
        history.append(f"{len(ignored)} column(s) of {file} have unknown names and were left out: {shorten(ignored)}")
        if len(bent := [name for name in ignored if BENT.match(name)]) > 1:
            history.append(f"{WARNING}{len(bent)} column(s) of {file} seem to hold curvatures, such as "
                           f"{shown(bent[0])}: state curvature (the beginning of these names) and curvature_unit in "
                           "its mapping")  # fmt: skip
        if bare := unitless_pressures(ignored):
            history.append(f"{WARNING}{len(bare)} column(s) of {file} seem to hold pressures without a unit, such as "
                           f"{shown(bare[0])}: state pressure_unit in its mapping to read them")  # fmt: skip
        history += [*changing_columns({n: columns[n] for n in ignored}, file),
                    *unread_columns(ignored, file, measured=pressure is not None)]  # fmt: skip
    arrays: dict[str, Any] = {}
    if labels:
        arrays, more = _stations(columns, labels, metadata, file)
        history += more
    elif pressure is None:
        raise InputError(f"{file} has neither columns of stations (x_000, ...) nor of pressure (p_kpa): "
                         f"{remedy(ignored, file)}")
    time, wrapped = unwrapped(columns[clock], CLOCKS[clock], file)
    history += wrapped
    used = np.stack([columns[name] for name in columns if is_known(name) and name not in CLOCKS], axis=1)
    keep, repeats = without_repeats(time, file, used if labels else None)
    time, history = time[keep], [*history, *repeats]
    pressure = None if pressure is None else np.asarray(pressure)[keep]
    arrays |= {name: arrays[name][keep] for name in ("position", "quaternion", "angle") if name in arrays}
    with inside(file):
        return make_recording(
            time if labels else None, pressure=pressure, pressure_time=None if pressure is None else time,
            chamber=chamber, history=[metadata.get("history", ""), *history], **arrays, **_kept(metadata),
        )  # fmt: skip


def remedy(unread: list[str], file: str) -> str:
    """Return the advice of a message on how to read a pressure from the columns that were not read."""
    bare = [f"state pressure_unit in its mapping for {shown(name)}" for name in unitless_pressures(unread)]
    unit = next(filter(None, (unit_of(name, PASCAL) for name in unread)), "kPa")
    hint = f"its columns are {shorten(unread, 12)}" if len(unread) > FEW else (
        f"for sensors: pressure = {{ columns = {json.dumps(unread, ensure_ascii=False)}, unit = {unit!r}, "
        "scale = 1.0, zero = 0.0 }")
    return [*bare, *unread_columns(unread, file), f"rename them or give a mapping; {hint}"][0]


def _station_labels(columns: dict[str, NDArray]) -> list[str]:
    station_columns = [m.group(2) for m in map(STATION_COLUMN.fullmatch, columns) if m]
    labels = list(dict.fromkeys(station_columns))
    numbers = {label: number for label in labels if (number := whole_number(label)) is not None}
    if len(numbers) < len(labels):
        return base_to_tip(labels)
    labels = sorted(labels, key=numbers.__getitem__)
    for before, after in pairwise(labels):
        if numbers[after] > numbers[before] + 1:
            missing = f"x_{numbers[before] + 1:0{len(labels[0])}d}"
            raise InputError(f"station columns are not numbered consecutively: x_{after} follows x_{before}, but "
                             f"column {missing} is missing: add it, or number the stations without gaps")  # fmt: skip
    return labels


def _stations(
    columns: dict[str, NDArray], labels: list[str], metadata: dict[str, Any], file: str
) -> tuple[dict[str, Any], list[str]]:
    flat = not any(f"z_{label}" in columns for label in labels)
    planar = metadata.get("frame", "tracker") == "planar"
    scale = metre_per(metadata.get("length_unit", "m"))
    wanted = {"position": ["x", "y"] if flat else ["x", "y", "z"]}
    if any(f"q{c}_{label}" in columns for label in labels for c in COMPONENTS):
        wanted["quaternion"] = ["qx", "qy", "qz", "qw"]
    if any(f"angle_{label}" in columns for label in labels):
        wanted["angle"] = ["angle"]
    arrays: dict[str, Any] = {}
    for variable, kinds in wanted.items():
        missing = [f"{k}_{s}" for s in labels for k in kinds if f"{k}_{s}" not in columns]
        if missing:
            raise InputError(f"{file} lacks the column(s) {shorten(missing, 5)}, which other stations have: add "
                             "them, or give a mapping that names the columns")
        stack = [np.stack([columns[f"{k}_{s}"] for k in kinds], -1) for s in labels]
        arrays[variable] = np.stack(stack, 1)
    arrays["position"] = arrays["position"] * scale
    if "angle" in arrays:
        arrays["angle"] = arrays["angle"][..., 0]
    history = []
    if flat and not planar:
        shape = (*arrays["position"].shape[:2], 1)
        arrays["position"] = np.concatenate([arrays["position"], np.zeros(shape)], -1)
        history.append("the table has no z columns: z = 0 at every station")
    arrays["station"] = metadata.get("station") or [f"s{s}" if s[0].isdigit() else s for s in labels]
    return arrays, history


def is_known(name: str) -> bool:
    """Return whether the name of a column is that of a time, a coordinate of a station or a pressure."""
    return name in (*CLOCKS, "p") or bool(STATION_COLUMN.fullmatch(name)) or pressure_unit(name) is not None


def _kept(metadata: dict[str, Any]) -> dict[str, Any]:
    names = ("frame", "nominal_pressure", "arc_length", "source", "source_format", "source_sha256",
             "angle_reference")  # fmt: skip
    options = {name: metadata[name] for name in names if name in metadata}
    other = {k: v for k, v in metadata.items() if k not in KNOWN_METADATA}
    options["attrs"] = {k: v for k, v in metadata.get("attributes", {}).items() if k not in OWN}
    if other:
        options["attrs"]["metadata"] = json.dumps(other, ensure_ascii=False)
    return options


def _pressure_columns(recording: xr.Dataset) -> dict[str, NDArray]:
    if not np.array_equal(recording["pressure_time"].values, recording["time"].values):
        raise InputError(
            "a wide CSV has one time column, but pressure and shape have different times: write netCDF (.nc)"
        )
    values = recording["pressure"].values
    if values.ndim == 1:
        return {"p_pa": values}
    return {f"p_pa_{c}": values[:, k] for k, c in enumerate(recording["chamber"].values)}


def _written_metadata(recording: xr.Dataset) -> dict[str, Any]:
    metadata = {"rows": recording.sizes["time"], "length_unit": "m", "station": recording["station"].values.tolist()}
    for name in ("frame", "nominal_pressure", "history", "source", "source_format", "source_sha256"):
        if recording.attrs.get(name) not in (None, ""):
            metadata[name] = recording.attrs[name]
    if "arc_length" in recording.coords:
        metadata["arc_length"] = recording["arc_length"].values.tolist()
    for name in ("angle", "quaternion"):
        if name in recording and "reference" in recording[name].attrs:
            metadata["angle_reference"] = recording[name].attrs["reference"]
    if attributes := {k: as_json(k, v) for k, v in recording.attrs.items() if k not in OWN}:
        metadata["attributes"] = attributes
    other = recording.attrs.get("metadata")
    return metadata | (json.loads(other) if isinstance(other, str) else {})


def as_json(name: str, value: Any) -> str | int | float:
    """Return the value of the attribute `name` of a recording as JSON holds it; raise InputError if it is neither a
    text nor a number.
    """
    plain = value.item() if isinstance(value, np.generic) else value
    if not isinstance(plain, str | int | float) or plain != plain:  # noqa: PLR0124  NaN is not itself
        raise InputError(f"a wide CSV cannot hold the attribute {name}, {shown(value)}: write netCDF (.nc) instead")
    return plain


def _recognises(head: bytes) -> bool:
    zeros = b"\0" in head[:512] and not head.startswith(tuple(WIDE))
    return not (head.startswith((b"Format Version", b"\xef\xbb\xbfFormat Version")) or zeros)


def read_text_table(path: Path, mapping: Mapping[str, Any] | None = None) -> Reading | xr.Dataset:
    """Read a text table by a mapping of its columns or, without one, as a wide CSV if its first row names the time."""
    if not mapping:
        names, lines = first_cells(path, {}), table_lines(path).lines
        separated = delimiter_of(lines[first_row(lines, preamble_of(lines))], None) is not None
        if separated and any(name in CLOCKS for name in standard_names(names, path.name).names):
            return read_wide_csv(path)
    return read_columns(path, mapping)


READER = Reader("csv", ENDINGS["csv"], read_wide_csv, _recognises)
COLUMNS = Reader("columns", ENDINGS["columns"], read_text_table, needs_mapping=True)
