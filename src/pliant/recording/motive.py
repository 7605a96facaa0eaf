"""OptiTrack Motive CSV: rigid bodies and labelled markers become stations, in metres.

Layout of the export (versions 1.2x to 3.x): a first row of key, value pairs (frame rate, length unit, rotation
type), an empty row, then rows of Type, Name, ID (3.x also Parent), the quantity of each column, the coordinate
of each column, and the frames: number, time in seconds, values; empty cells where a marker was not seen.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.columns import unit_quaternions
from pliant.recording.mapping import FileMapping
from pliant.recording.registry import Reader
from pliant.recording.schema import make_recording
from pliant.recording.tables import parse_numbers, read_text, split_cells
from pliant.units import metre_per

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray

UNITS = {"meters": "m", "metres": "m", "centimeters": "cm", "millimeters": "mm", "inches": "in"}
TYPES = ("Rigid Body", "Bone", "Marker")


class MotiveMapping(FileMapping):
    """Options: `length_unit` where the file does not state it; `types` of assets to read."""

    length_unit: str | None = None
    types: tuple[str, ...] = TYPES


class _Header:
    """Rows above the numbers, and where each station's columns are."""

    def __init__(self, lines: list[str], options: MotiveMapping, name: str) -> None:
        cells = split_cells(lines[0], ",")
        self.keys = dict(zip(cells[::2], cells[1::2], strict=False))
        table = [split_cells(line, ",") for line in lines[1:15]]
        at = next((i for i, row in enumerate(table) if row[0].lower() == "frame"), None)
        labelled = {row[1].lower(): row for row in table[:at] if len(row) > 1 and row[1]}
        if at is None or at == 0 or "type" not in labelled or "name" not in labelled:
            raise InputError(f"{name} is no Motive export: rows Type, Name and Frame are missing in its header")
        self.first = at + 2
        self.axis, self.quantity = table[at], table[at - 1]
        self.width = len(self.axis)
        types, names = labelled["type"], labelled["name"]
        if min(len(types), len(names), len(self.quantity)) < self.width:
            raise InputError(f"the header rows of {name} differ in length: the file is damaged")
        self.columns: dict[str, dict[tuple[str, str], int]] = {}
        self.left_out = 0
        for i in range(2, self.width):
            if types[i] in options.types:
                self.columns.setdefault(names[i], {}).setdefault((self.quantity[i], self.axis[i]), i)
            else:
                self.left_out += 1


def read_motive(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read a Motive export; options are those of `MotiveMapping`."""
    options = MotiveMapping.load(mapping, path.name)
    lines = read_text(path).split("\n")
    if not lines[0].startswith("Format Version"):
        raise InputError(f"{path.name} is no Motive export: it does not begin with Format Version")
    header = _Header(lines, options, path.name)
    table = parse_numbers(
        lines[header.first :], name=path.name, first_line=header.first + 1, delimiter=",",
        columns=header.width,
    )  # fmt: skip
    scale = _scale(header, options, path.name)
    names = [n for n, c in header.columns.items() if all(("Position", a) in c for a in "XYZ")]
    if not names:
        raise InputError(f"{path.name} holds no {' or '.join(options.types)} with a position")
    columns = [[header.columns[n]["Position", a] for a in "XYZ"] for n in names]
    quaternion, history = _rotations(table, header, names)
    if header.left_out:
        history.append(f"{header.left_out} columns of other kinds than {', '.join(options.types)} were not read")
    return make_recording(
        table[:, 1], table[:, columns] * scale, station=names, quaternion=quaternion, history=history
    )


def _scale(header: _Header, options: MotiveMapping, name: str) -> float:
    stated = header.keys.get("Length Units", "").lower()
    unit = options.length_unit or UNITS.get(stated)
    if unit is None:
        raise InputError(f"{name} does not state a known unit of length ({stated!r}): give length_unit")
    return metre_per(unit)


def _rotations(table: NDArray, header: _Header, names: list[str]) -> tuple[NDArray | None, list[str]]:
    quaternion = np.full((len(table), len(names), 4), np.nan)
    history = []
    for s, name in enumerate(names):
        columns = header.columns[name]
        if not all(("Rotation", a) in columns for a in "XYZW"):
            if ("Rotation", "X") in columns:
                history.append(f"the rotation of {name} is not a quaternion and was not read")
            continue
        quaternion[:, s], lost = unit_quaternions(table[:, [columns["Rotation", a] for a in "XYZW"]])
        if lost:
            history.append(f"{lost} quaternion(s) of {name} are far from unit length and became NaN")
    return (quaternion if np.isfinite(quaternion).any() else None), history


def _recognises(head: bytes) -> bool:
    return head.startswith((b"Format Version", b"\xef\xbb\xbfFormat Version"))


READER = Reader("motive", (".csv",), read_motive, _recognises)
