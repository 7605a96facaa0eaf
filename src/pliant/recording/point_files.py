"""Text of point trackers: Tracker (physlets.org) and Kinovea.

Tracker's data table, as its users' scripts read it: the track's name, a row ``t x y`` (more columns are left out), the
numbers, parted by tabs, commas or semicolons; one file for a point, the others under ``more``. Kinovea's trajectory
text, as its exporter writes it: ``#Kinovea Trajectory data export``, ``#T X Y``, then for each trajectory ``# name``
and rows of time and places, parted by spaces. Both write lengths when they were calibrated, else pixels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.registry import ENDINGS, Reader
from pliant.recording.tables import judge_end, parse_numbers, read_text, split_cells
from pliant.recording.trackers import TrackerMapping, seconds, tracked

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray

SPARSEST = 100  # places of a table for each sample in it
Track = tuple["NDArray", "NDArray"]  # times (T,) and places (T, 2)


def read_tracker(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read tracks of Tracker, one file for each; options are those of `TrackerMapping`."""
    options = TrackerMapping.load(mapping, path.name)
    tracks: dict[str, Track] = {}
    findings: list[str] = []
    for file in (path, *(path.parent / name for name in options.more)):
        if not file.is_file():
            raise InputError(f"{path.name} names a further file {file.name!r}, which is absent")
        name, track, more = one_track(file)
        findings += more
        tracks[name if name not in tracks else file.stem] = track
    return together(path, options, tracks, "s", findings)


def one_track(path: Path) -> tuple[str, Track, list[str]]:
    """Name, times and places of the one track in a file of Tracker, and what was found at its end."""
    lines = read_text(path).split("\n")
    at = next((k for k, line in enumerate(lines[:4]) if header_of(line)), None)
    if at is None:
        raise InputError(f"{path.name} is no data table of Tracker: a row t, x, y is missing in its header")
    delimiter, cells = header_of(lines[at]) or ("", [])
    rows, findings = judge_end(lines[at + 1 :], delimiter, path.name)
    table = parse_numbers(rows, name=path.name, first_line=at + 2, delimiter=delimiter, columns=len(cells))
    name = split_cells(lines[0], delimiter)[0] if at else path.stem
    return name or path.stem, (table[:, cells.index("t")], table[:, [cells.index("x"), cells.index("y")]]), findings


def header_of(line: str) -> tuple[str, list[str]] | None:
    """Delimiter and names of a row t, x, y; None where it is none."""
    for delimiter in ("\t", ";", ","):
        cells = split_cells(line, delimiter)
        if {"t", "x", "y"} <= set(cells) and len(set(cells)) == len(cells):
            return delimiter, cells
    return None


def read_kinovea(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read the trajectories of Kinovea; options are those of `TrackerMapping`, times are in ms unless it says else."""
    options = TrackerMapping.load(mapping, path.name)
    blocks: dict[str, tuple[int, list[str]]] = {}
    name = ""
    lines, findings = judge_end(read_text(path).split("\n"), None, path.name)
    for number, line in enumerate(lines, 1):
        if line.startswith("#"):
            name = line.lstrip("# ").strip() if number > 2 else ""
        elif line.strip():
            if ":" in line.split()[0]:
                raise InputError(f"{path.name} has timecodes: let Kinovea write time as numbers (milliseconds)")
            blocks.setdefault(name or "track", (number, []))[1].append(line)
    tracks = {}
    for label, (first, rows) in blocks.items():
        table = parse_numbers(rows, name=path.name, first_line=first, delimiter=None, columns=3)
        tracks[label] = (table[:, 0], table[:, 1:])
    if not tracks:
        raise InputError(f"{path.name} holds no trajectory")
    return together(path, options, tracks, "ms", findings)


def together(
    path: Path, options: TrackerMapping, tracks: dict[str, Track], unit: str, findings: list[str]
) -> xr.Dataset:
    """Tracks on the union of their times; a point that has no sample there is a gap."""
    samples = sum(len(t) for t, _ in tracks.values())
    clock = np.unique(np.concatenate([np.round(t, 9) for t, _ in tracks.values()]))
    if clock.size * len(tracks) > SPARSEST * samples:
        raise InputError(f"the {len(tracks)} tracks of {path.name} share hardly any times: {samples} samples at "
                         f"{clock.size} times; export tracks of one film")  # fmt: skip
    points = np.full((clock.size, len(tracks), 2), np.nan)
    for k, (t, place) in enumerate(tracks.values()):
        points[np.searchsorted(clock, np.round(t, 9)), k] = place
    gaps = int(np.isnan(points[..., 0]).sum())
    history = [*findings, *([f"{gaps} points are not in every track's times: gaps"] if gaps else [])]
    return tracked(path, options, list(tracks), points, time=seconds(clock, options, unit), history=history)


def is_tracker(head: bytes) -> bool:
    """A row t, x, y among the first lines, with a name above it."""
    lines = head[:4000].decode("utf-8", "replace").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return any(header_of(line) for line in lines[1:4]) and header_of(lines[0]) is None


TRACKER = Reader("tracker", ENDINGS["tracker"], read_tracker, is_tracker)
KINOVEA = Reader(
    "kinovea", ENDINGS["kinovea"], read_kinovea, lambda head: head.lstrip(b"\xef\xbb\xbf").startswith(b"#Kinovea")
)
