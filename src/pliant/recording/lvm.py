"""Reader of LabVIEW measurement files (.lvm): two headers, then columns of numbers and of comments.

A header has one ``Key<separator>value`` per line and ends with ``***End_of_Header***``. The first header describes the
file, the second the channels. Time is the first column (``X_Columns`` One), one column before each channel (Multi), or
computed from ``X0`` and ``Delta_X`` (No). The last column holds comments and is left out. A file of several segments is
refused: export one file per segment.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.logger_channels import Channel, pressure_log
from pliant.recording.registry import ENDINGS, Reader, begins_with
from pliant.recording.tables import judge_end, parse_numbers, read_text

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray

END = "***End_of_Header***"
SEPARATORS = {"tab": "\t", "comma": ",", "semicolon": ";"}
LONGEST_HEADER = 200  # lines


def read_lvm(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read the pressures in a LabVIEW measurement file (.lvm) and return them as a recording without shape."""
    lines = read_text(path).split("\n")
    ends = [k for k, line in enumerate(lines) if line.startswith(END)]
    if len(ends) < 2:
        raise InputError(f"{path.name} has {len(ends)} headers, but a LabVIEW measurement has two: it may be "
                         "truncated, so copy or export it again")
    if len(ends) > 2:
        raise InputError(f"{path.name} has {len(ends) - 1} segments: export one file per segment")
    separator = separator_of(lines, path.name)
    facts, about = (entries(part, separator) for part in (lines[: ends[0]], lines[ends[0] + 1 : ends[1]]))
    names = [c.strip() for c in lines[ends[1] + 1].split(separator)] if ends[1] + 1 < len(lines) else []
    decimal, layout = (facts.get(key, [usual])[0] for key, usual in (("Decimal_Separator", "."), ("X_Columns", "One")))
    table, findings = table_of(lines[ends[1] + 2 :], names, separator, decimal, path.name, ends[1] + 3)
    channels = channels_of(table, names, about, layout, path.name)
    return pressure_log(channels, mapping, path.name, findings)


def entries(lines: list[str], separator: str) -> dict[str, list[str]]:
    """Return the header of a LabVIEW measurement file as a dict from the name in the first cell of a line to the values
    after it.
    """
    cells = [[cell.strip() for cell in line.split(separator)] for line in lines]
    return {row[0]: row[1:] for row in cells if len(row) > 1 and row[0]}


def separator_of(lines: list[str], file: str) -> str:
    """Return the column separator that the header of a LabVIEW measurement file states; a tab where it states none."""
    for line in lines[:LONGEST_HEADER]:
        if line.startswith("Separator"):
            word = line[len("Separator") :].strip().strip(",;").lower()
            if word in SEPARATORS:
                return SEPARATORS[word]
            raise InputError(f"{file} has the separator {word[:20]!r}: export it with one of {', '.join(SEPARATORS)}")
    return "\t"


def table_of(
    body: list[str], names: list[str], separator: str, decimal: str, file: str, first: int,
) -> tuple[NDArray[np.float64], list[str]]:
    """Return the data of a LabVIEW measurement file as numbers (T, C), T rows of C columns without the comments, and
    lines for the history.
    """
    columns = len(names) - (names[-1:] == ["Comment"])
    if columns < 1:
        raise InputError(f"{file} has no column names after its second header: it may be truncated, so copy or "
                         "export it again")
    rows, comments = [], 0
    for line in body:
        cells = line.split(separator)
        comments += bool(separator.join(cells[columns:]).strip())
        rows.append(separator.join(cells[:columns]) if line.strip() else "")
    if separator != "," and decimal == ",":
        rows = [row.replace(",", ".") for row in rows]
    rows, findings = judge_end(rows, separator, file)
    findings += [f"{comments} rows of {file} have a comment"] if comments else []
    return parse_numbers(rows, name=file, first_line=first, delimiter=separator, columns=columns), findings


def channels_of(
    table: NDArray[np.float64], names: list[str], about: Mapping[str, list[str]], layout: str, file: str,
) -> dict[str, Channel]:
    """Return the channels of a LabVIEW measurement file by name, each with its own times. `layout` says whether the
    file has a time column for each channel, one for all, or none.
    """
    units = about.get("Y_Unit_Label", [])
    starts, steps = about.get("X0", []), about.get("Delta_X", [])
    stride, first = (2, 1) if layout == "Multi" else (1, 1)
    channels: dict[str, Channel] = {}
    for k, column in enumerate(range(first, table.shape[1], stride)):
        if layout == "No":
            try:
                time = float(starts[k]) + float(steps[k]) * np.arange(len(table))
            except (IndexError, ValueError):
                raise InputError(f"{file} does not state the start time X0 and the time step Delta_X of channel "
                                 f"{names[column]}: export it with X columns") from None
        else:
            time = table[:, column - 1 if layout == "Multi" else 0]
        name = names[column] or f"channel {k + 1}"
        seen = np.isfinite(time)
        unit = units[k] if k < len(units) else ""
        channels[name if name not in channels else f"{name} {k + 1}"] = Channel(time[seen], table[seen, column], unit)
    return channels


READER = Reader("lvm", ENDINGS["lvm"], read_lvm, begins_with(b"LabVIEW Measurement"))
