"""Reader of OptiTrack Motive CSV exports: rigid bodies and labelled markers become stations, in metres.

Layout of the export (versions 1.2x to 3.x): a first row of key, value pairs (frame rate, length unit, rotation
type), an empty row, then rows of Type, Name, ID (3.x also Parent), the quantity of each column, the coordinate
of each column, and the frames: number, time in seconds, values; empty cells where a marker was not seen.
"""

from __future__ import annotations

import re
from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError, clipped, inside
from pliant.recording.mapping import FileMapping, shorten
from pliant.recording.registry import ENDINGS, Reader, begins_with
from pliant.recording.schema import make_recording
from pliant.recording.stated import Reading, Stated, stated_rate
from pliant.recording.tables import read_rows, read_text, split_cells, whole_number
from pliant.units import metre_per

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

UNLABELLED = re.compile(r"unlabell?ed[ _#]?\d*", re.IGNORECASE)  # names of markers that Motive has not identified
SPACES = ("", "global")  # of coordinates; others refer to the skeleton of the asset
UNITS = {"meters": "m", "metres": "m", "centimeters": "cm", "millimeters": "mm", "inches": "in"}
TYPES = ("Rigid Body", "Bone", "Marker")


class MotiveMapping(FileMapping):
    """Options of the Motive reader: the unit of length where the file states none, the types of tracked assets to
    read, and whether to read markers without a label, such as ``Unlabeled 1001``.
    """

    length_unit: str | None = None
    types: tuple[str, ...] = TYPES
    unlabelled: bool = False


class _Header:
    """Header rows of a Motive export, and the columns of each station."""

    def __init__(self, lines: list[str], options: MotiveMapping, name: str) -> None:
        cells = split_cells(lines[0], ",")
        self.keys = dict(zip(cells[::2], cells[1::2], strict=False))
        table = [split_cells(line, ",") for line in lines[1:15]]
        frame_row = next((i for i, row in enumerate(table) if row[0].lower() == "frame"), None)
        labelled = {row[1].lower(): row for row in table[:frame_row] if len(row) > 1 and row[1]}
        if frame_row is None or frame_row == 0 or "type" not in labelled or "name" not in labelled:
            raise InputError(f"{name} is not a Motive export: rows Type, Name and Frame are missing in its header; "
                             "export it from Motive as CSV")
        self.first = frame_row + 2
        self.axis, self.quantity = table[frame_row], table[frame_row - 1]
        self.width = len(self.axis)
        types, names = labelled["type"], labelled["name"]
        self.names = names
        if min(len(types), len(names), len(self.quantity)) < self.width:
            raise InputError(f"the header rows of {name} differ in length: the file is damaged, so export it again")
        if nameless := [i + 1 for i in range(2, self.width) if types[i] in options.types and not names[i]]:
            raise InputError(f"row Name of {name} is empty in column {nameless[0]}: name the asset in Motive or in "
                             "this cell")
        self.columns: dict[str, dict[tuple[str, str], int]] = {}
        self.left_out = [i for i in range(2, self.width) if types[i] not in options.types]
        self.unlabelled = set() if options.unlabelled else {i for i in range(2, self.width) if types[i] in options.types
                                                            and UNLABELLED.fullmatch(names[i])}  # fmt: skip
        self.renamed: list[str] = []
        self.same: Counter[str] = Counter()  # names that are taken -> how many were
        of: dict[tuple[str, ...], str] = {}  # type, name and ID of an asset -> the name of its station
        ids = labelled.get("id", [])
        for i in (i for i in range(2, self.width) if types[i] in options.types and i not in self.unlabelled):
            asset = (types[i], names[i], ids[i] if i < len(ids) else "")
            if asset in of and (self.quantity[i], self.axis[i]) in self.columns[of[asset]]:
                del of[asset]  # the same column once more: another asset of the same name
            if asset not in of:
                of[asset] = self._new_name(names[i])
            self.columns[of[asset]][self.quantity[i], self.axis[i]] = i

    def _new_name(self, name: str) -> str:
        """Return a unique station name, with a number appended where `name` exists already."""
        fresh = name
        while fresh in self.columns:
            self.same[name] += 1
            fresh = f"{name} #{self.same[name] + 1}"
        if fresh != name:
            self.renamed.append(fresh)
        self.columns[fresh] = {}
        return fresh


def read_motive(path: Path, mapping: Mapping[str, Any] | None = None) -> Reading:
    """Read the markers and rigid bodies of an OptiTrack Motive CSV export as stations and return a recording."""
    options = MotiveMapping.load(mapping, path.name)
    lines = read_text(path).split("\n")
    if not lines[0].startswith("Format Version"):
        raise InputError(f"{path.name} is not a Motive export: it does not begin with Format Version; export it from "
                         "Motive as CSV")
    header = _Header(lines, options, path.name)
    if (space := header.keys.get("Coordinate Space", "")).lower() not in SPACES:
        raise InputError(f"{path.name} states its coordinates in the space {clipped(space, 40)!r}, not Global: export "
                         "it from Motive with global coordinates")
    table, findings = read_rows(lines, header.first, ",", path.name, header.width)
    scale = _scale(header, options, path.name)
    names = [n for n, c in header.columns.items() if all(("Position", a) in c for a in "XYZ")]
    if not names:
        only = ", as its markers have no label: label them, or set unlabelled = true" if header.unlabelled else \
            ": export positions, or change types"
        raise InputError(f"{path.name} holds no {' or '.join(options.types)} with a position{only} in the mapping")
    columns = [[header.columns[n]["Position", a] for a in "XYZ"] for n in names]
    quaternion, history = _rotations(table, header, names)
    history = [*findings, *_numbering(table), *history]
    if header.left_out:
        history.append(f"{len(header.left_out)} columns of assets other than {', '.join(options.types)} were not read")
    if header.unlabelled:
        lost = {header.names[i] for i in header.unlabelled}
        history.append(f"{len(lost)} marker(s) without a label were left out: {shorten(sorted(lost))}; unlabelled = "
                       "true in the mapping reads them")  # fmt: skip
    if header.renamed:
        history.append(f"{len(header.renamed)} asset(s) have a repeated name and got a number: "
                       f"{shorten(header.renamed)}")  # fmt: skip
    history += _other_columns(header, names)
    with inside(path.name):
        recording = make_recording(
            table[:, 1], table[:, columns] * scale, station=names, quaternion=quaternion, history=history
        )
    return Reading(recording, tuple(_stated(table, header)))


def _numbering(table: NDArray) -> list[str]:
    """Return a sentence where frame numbers do not increase by one."""
    lost = int((np.diff(table[:, 0]) != 1).sum())
    said = f"the frame numbers do not increase by one at {lost} frame(s): frames were lost or reordered"
    return [said] if lost else []


def _stated(table: NDArray, header: _Header) -> list[Stated]:
    """Return the number of frames and the rate that the header states, beside those of the table."""
    count = whole_number(header.keys.get("Total Exported Frames", ""))
    frames = [] if count is None else [Stated("frames", "Total Exported Frames", count, len(table))]
    key = next((k for k in ("Export Frame Rate", "Capture Frame Rate") if header.keys.get(k)), "")
    try:
        rate = float(header.keys.get(key, "nan"))
    except ValueError:
        rate = float("nan")
    return frames + stated_rate("frames", key, rate, table[:, 1])


def _other_columns(header: _Header, names: list[str]) -> list[str]:
    """Return one sentence that lists the columns of the read assets that no station uses."""
    read, used = set(names), {*(("Position", a) for a in "XYZ"), *(("Rotation", a) for a in "XYZW")}
    left = [f"{name}: {' '.join(filter(None, key))}" for name, columns in header.columns.items()
            for key in columns if name not in read or key not in used]  # fmt: skip
    return [f"{len(left)} column(s) were left out: {shorten(left)}"] if left else []


def _scale(header: _Header, options: MotiveMapping, name: str) -> float:
    stated = header.keys.get("Length Units", "").lower()
    unit = options.length_unit or UNITS.get(stated)
    if unit is None:
        raise InputError(f"{name} does not state a known unit of length ({stated!r}): set length_unit in the mapping")
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
        quaternion[:, s] = table[:, [columns["Rotation", a] for a in "XYZW"]]
    return (None if np.isnan(quaternion).all() else quaternion), history


READER = Reader("motive", ENDINGS["motive"], read_motive, begins_with(b"Format Version"))
