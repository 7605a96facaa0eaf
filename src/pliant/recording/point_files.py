"""Readers of text files from the point trackers Tracker (physlets.org) and Kinovea.

A data table of Tracker has the name of the track, a row ``t x y`` (further columns are left out) and the numbers,
separated by tabs, commas or semicolons. It has one file per point; further files are named under ``more``. A trajectory
text of Kinovea has ``#Kinovea Trajectory data export``, ``#T X Y``, then for each trajectory ``# name`` and rows of
time and position, separated by spaces. Both programs write lengths when they were calibrated, else pixels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.registry import ENDINGS, Reader, begins_with
from pliant.recording.tables import judge_end, parse_numbers, read_rows, read_text, split_cells
from pliant.recording.trackers import TrackerMapping, seconds, tracked

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray

SPARSEST = 100  # cells of the joint table per sample
Track = tuple["NDArray", "NDArray"]  # times (T,) and positions (T, 2)


def read_tracker(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read tracks of the program Tracker (physlets.org), one file per track, and return them as a recording."""
    options = TrackerMapping.load(mapping, path.name)
    tracks: dict[str, Track] = {}
    findings: list[str] = []
    for file in (path, *(path.parent / name for name in options.more)):
        if not file.is_file():
            raise InputError(f"there is no file {file.name!r} beside {path.name}: correct `more` in its mapping")
        name, track, more = one_track(file)
        findings += more
        tracks[name if name not in tracks else file.stem] = track
    return together(path, options, tracks, "s", findings)


def one_track(path: Path) -> tuple[str, Track, list[str]]:
    """Read one file of the program Tracker: return the name of its track, the times (T,) and positions (T, 2) of T
    samples in the units of the file, and history lines.
    """
    lines = read_text(path).split("\n")
    at = next((k for k, line in enumerate(lines[:4]) if header_of(line)), None)
    if at is None:
        raise InputError(f"{path.name} is not a data table of Tracker: a row t, x, y is missing in its header; "
                         "export the track again with t, x and y")
    delimiter, cells = header_of(lines[at]) or ("", [])
    table, findings = read_rows(lines, at + 1, delimiter, path.name, len(cells))
    name = split_cells(lines[0], delimiter)[0] if at else path.stem
    return name or path.stem, (table[:, cells.index("t")], table[:, [cells.index("x"), cells.index("y")]]), findings


def header_of(line: str) -> tuple[str, list[str]] | None:
    """Return the delimiter and the column names of a line that is a header with t, x and y; None for any other line."""
    for delimiter in ("\t", ";", ","):
        cells = split_cells(line, delimiter)
        if {"t", "x", "y"} <= set(cells) and len(set(cells)) == len(cells):
            return delimiter, cells
    return None


def read_kinovea(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read trajectories that Kinovea exported and return them as a recording; times are in ms unless the options state
    another unit.
    """
    options = TrackerMapping.load(mapping, path.name)
    blocks: dict[str, tuple[int, list[str]]] = {}
    name = ""
    lines, findings = judge_end(read_text(path).split("\n"), None, path.name)
    for number, line in enumerate(lines, 1):
        if line.startswith("#"):
            name = line.lstrip("# ").strip() if number > 2 else ""
        elif line.strip():
            if ":" in line.split()[0]:
                raise InputError(f"{path.name} has timecodes: export times from Kinovea as numbers (milliseconds)")
            blocks.setdefault(name or "track", (number, []))[1].append(line)
    tracks = {}
    for label, (first, rows) in blocks.items():
        table = parse_numbers(rows, name=path.name, first_line=first, delimiter=None, columns=3)
        tracks[label] = (table[:, 0], table[:, 1:])
    if not tracks:
        raise InputError(f"{path.name} holds no trajectory: export one from Kinovea")
    return together(path, options, tracks, "ms", findings)


def together(
    path: Path, options: TrackerMapping, tracks: dict[str, Track], unit: str, findings: list[str]
) -> xr.Dataset:
    """Return a recording of all tracks at every time that occurs in any of them. A track without a sample at a time is
    NaN there.
    """
    samples = sum(len(t) for t, _ in tracks.values())
    clock = np.unique(np.concatenate([np.round(t, 9) for t, _ in tracks.values()]))
    if clock.size * len(tracks) > SPARSEST * samples:
        raise InputError(f"the {len(tracks)} tracks of {path.name} have hardly any times in common: {samples} "
                         f"samples at {clock.size} times; export all tracks from the same video")  # fmt: skip
    points = np.full((clock.size, len(tracks), 2), np.nan)
    for k, (t, place) in enumerate(tracks.values()):
        points[np.searchsorted(clock, np.round(t, 9)), k] = place
    gaps = int(np.isnan(points[..., 0]).sum())
    history = [*findings, *([f"{gaps} points are gaps: not every track has a sample at every time"] if gaps else [])]
    return tracked(path, options, list(tracks), points, time=seconds(clock, options, unit), history=history)


def is_tracker(head: bytes) -> bool:
    """Return whether the first bytes of a file, `head`, are those of a table of the program Tracker: a track name above
    a row t, x, y.
    """
    lines = head[:4000].decode("utf-8", "replace").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return any(header_of(line) for line in lines[1:4]) and header_of(lines[0]) is None


TRACKER = Reader("tracker", ENDINGS["tracker"], read_tracker, is_tracker)
KINOVEA = Reader("kinovea", ENDINGS["kinovea"], read_kinovea, begins_with(b"#Kinovea"))
