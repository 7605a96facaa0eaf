"""First reading of files whose scale or units are not stated: values are assumed, and the assumptions returned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr

from pliant.errors import InputError
from pliant.files import regular_file
from pliant.recording import read, readers
from pliant.recording.registry import HEAD_BYTES, is_bag_folder
from pliant.sensing import read_shape
from pliant.study.column_guess import TableGuess, guessed_table

TRACKERS = ("deeplabcut", "sleap")
MADE_UP = {"rate_hz": 30.0, "pixels_per_mm": 1.0}
UNITS = {"angle_unit": "deg", "pressure_unit": "kPa"}


class FirstReading(NamedTuple):
    """A recording, and what was assumed to read it."""

    recording: xr.Dataset
    assumed: dict[str, Any]  # entries of the mapping: a camera, or units of angle and pressure
    guess: TableGuess | None = None  # the whole mapping of a table that nobody described


def read_or_guess(path: Path, mapping: dict[str, Any] | None) -> FirstReading:
    """Read a recording as its format and mapping state. If that fails, or finds no input in a table that has some, read
    it with assumed entries.
    """
    stated = mapping or {}
    try:
        recording = read_shape(path, mapping)
    except InputError:
        for entries in guesses(path, stated):
            try:
                return FirstReading(read_shape(path, {**stated, **entries}), entries)
            except InputError:
                continue
        if (guess := guessed_table(path, stated)) is None:
            raise
        return FirstReading(read_shape(path, guess.neutral), {}, guess)
    if {"pressure", "actuation", "angle"} & set(recording) or "position" not in recording:
        return FirstReading(recording, {})
    guess = guessed_table(path, stated)
    return FirstReading(read_shape(path, guess.neutral), {}, guess) if guess and guess.has_inputs else \
        FirstReading(recording, {})


def guesses(path: Path, stated: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the mapping entries (camera or units) to try on a file that cannot be read without a mapping; empty if
    there are none.
    """
    if not path.is_file():
        return []
    with regular_file(path, "recording") as file:
        head = file.read(HEAD_BYTES)
    known, named = readers(), stated.get("format")
    fits = [n for n in (*TRACKERS, "angles") if n == named
            or (named is None and path.suffix.lower() in known[n].suffixes and known[n].recognises(head))]
    if "angles" in fits:
        units = {k: v for k, v in UNITS.items() if k not in stated}
        return [*({k: v} for k, v in units.items()), units]
    return [] if not fits or {"camera", "length_unit"} & set(stated) else [{"camera": MADE_UP}]


def several(recording: xr.Dataset) -> list[str]:
    """Return the names of the chambers if a recording has more than one, else an empty list."""
    names = [str(c) for c in recording["chamber"].values] if "chamber" in recording.dims else []
    return names if len(names) > 1 else []


LOGS = (".csv", ".txt", ".tsv", ".log", ".dat", ".mat", ".npz", ".lvm", ".tdms", ".mcap", ".db3")


def with_logs(files: Sequence[Path]) -> list[tuple[Path, Path | None]]:
    """Pair each file that holds a shape with the file that holds its pressure alone, or with None.

    A log belongs to the recording whose name begins with the log's name, or the reverse; of several, the longest name.

    Raises
    ------
    InputError
        When a log's name matches no recording, or one that has another log already.
    """
    logs = [f for f in files if holds_pressure_alone(f)]
    shapes: dict[Path, Path | None] = {f: None for f in files if f not in logs}
    for log in logs:
        named = [f for f in shapes if log.stem.startswith(f.stem) or f.stem.startswith(log.stem)]
        best = max(named, key=lambda f: len(f.stem), default=None)
        if best is None or shapes[best] is not None:
            raise InputError(f"{log.name} holds pressure alone, and a study needs the shape too: add the recording to "
                             f"which it belongs, with the same start of its name, such as push.csv for push_log.csv")
        shapes[best] = log
    return list(shapes.items())


def holds_pressure_alone(path: Path) -> bool:
    """Return whether a file can be read without a mapping and holds pressure alone."""
    if path.suffix.lower() not in LOGS and not is_bag_folder(path):
        return False
    try:
        return set(read(path)) == {"pressure"}
    except InputError:
        return False
