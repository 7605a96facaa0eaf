"""First reading of files whose scale or units are not stated: values are assumed, and the assumptions returned."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr

from pliant.errors import InputError
from pliant.files import regular_file
from pliant.recording import read, readers
from pliant.recording.column_names import PERHAPS_A_PLACE
from pliant.recording.mapping import options_of, refuse_idle
from pliant.recording.mat import trials_of
from pliant.recording.registry import HEAD_BYTES, is_bag_folder
from pliant.recording.rules import shape_variable
from pliant.recording.schema import history_of
from pliant.sensing import read_shape
from pliant.study.column_guess import MILLIMETRES, TableGuess, extent, guessed_table, refuse_bodies_in_rows

TRACKERS = ("deeplabcut", "sleap")
MADE_UP = {"rate_hz": 30.0, "pixels_per_mm": 1.0}
UNITS = {"angle_unit": "deg", "pressure_unit": "kPa"}


class FirstReading(NamedTuple):
    """A recording, and what was assumed to read it."""

    recording: xr.Dataset
    assumed: dict[str, Any]  # entries of the mapping: a camera, or units of angle and pressure
    guess: TableGuess | None = None  # the whole mapping of a table that nobody described


def read_or_guess(path: Path, mapping: dict[str, Any] | None) -> FirstReading:
    """Read a recording as its format and mapping state. If that fails, or misses the inputs or trials of a table, read
    it with assumed entries.
    """
    stated = mapping or {}
    try:
        recording = read_shape(path, mapping)
    except InputError:
        for entries in guesses(path, stated):
            try:
                assumed = FirstReading(read_shape(path, {**stated, **entries}), entries)
                return (curved(path, stated) if "angle" in assumed.recording else None) or assumed
            except InputError:
                continue
        if (guess := guessed_table(path, stated)) is None:
            raise
        return FirstReading(read_shape(path, guess.readable), guess.assumed, guess)
    shown = shape_variable(recording)
    shape = bool(shown) or "strain" in recording
    dotted = not stated and named_by_a_path(recording)
    unfit = dotted or (not stated and too_large(recording))
    if shown == "angle" and (directed := curved(path, stated)):
        return directed
    if recording.sizes.get("station") == 1 and shown == "position":
        refuse_bodies_in_rows(path, stated)
    if shape and not unfit and (shown != "position" or {"pressure", "actuation", "strain"} & set(recording)):
        return FirstReading(recording, {})
    guess = guessed_table(path, stated)
    if guess is None or (shape and not (guess.has_inputs or guess.trials or unfit)) or "select" in stated:
        return FirstReading(recording, {})
    again = read_shape(path, guess.readable)
    kept = not dotted or holds_as_much(again, recording)
    return FirstReading(again, guess.assumed, guess) if kept else FirstReading(recording, {})


def holds_as_much(guessed: xr.Dataset, recording: xr.Dataset) -> bool:
    """Return whether a guessed reading holds all variables, sizes and the frame of what the file states."""
    return ({*recording.variables} <= {*guessed.variables} and recording.sizes.items() <= guessed.sizes.items()
            and recording.attrs.get("frame") == guessed.attrs.get("frame"))


def curved(path: Path, stated: Mapping[str, Any]) -> FirstReading | None:
    """Return the reading of a table of curvatures whose angles are their directions; None for another file."""
    guess = None if stated else guessed_table(path)
    if guess is None or "direction" not in guess.mapping:
        return None
    return FirstReading(read_shape(path, guess.readable), guess.assumed, guess)


def too_large(recording: xr.Dataset) -> bool:
    """Return whether positions are too far apart for metres, for example in a table of millimetres without a unit."""
    if "position" not in recording:
        return False
    position = recording["position"].values
    return max(extent(position[..., axis]) for axis in range(position.shape[-1])) > MILLIMETRES


def named_by_a_path(recording: xr.Dataset) -> bool:
    """Return whether a station has a dot in its name, as in field.pose, by which no parameter can be named."""
    return "station" in recording.dims and any("." in str(name) for name in recording["station"].values)


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


UNUSED = re.compile(r"\d+ (?:array|topic|channel)\(s\) of ")  # begins the sentence on what was not read
WORD = re.compile(r"[a-z]+|[0-9]+")
LOGS = (".csv", ".txt", ".tsv", ".log", ".dat", ".mat", ".npz", ".lvm", ".tdms", ".mcap", ".db3")


class WithLog(NamedTuple):
    """A file that holds a shape, the file of its inputs alone (None: no such file), the options of both files, and the
    name of the trial if the file of the shape holds several.
    """

    shape: Path
    options: dict[str, Any] | None = None
    log: Path | None = None
    log_options: dict[str, Any] | None = None
    trial: str = ""


def with_logs(files: Sequence[Path], mapping: Mapping[str, Any] | None = None) -> list[WithLog]:
    """Pair each file that holds a shape with the file that holds its inputs alone, if there is one.

    A log belongs to the recording whose name begins with the log's name, or the reverse (of several, the longest);
    otherwise to the recording whose name shares most words and numbers with the log's. A single log belongs to a single
    recording.

    Raises
    ------
    InputError
        When a log fits no recording or several, or two logs fit one.
    """
    refuse_idle(mapping, files)
    logs = {file: options for file in files if (options := inputs_alone(file, options_of(file, mapping))) is not None}
    if len(logs) == len(files):  # a sensor that is logged beside the inputs may show the shape
        logs = {file: options for file, options in logs.items() if guessed_table(file, options) is None}
    pairs = {file: WithLog(file, options_of(file, mapping)) for file in files if file not in logs}
    for log, options in logs.items():
        shape = shape_of(log, [*pairs])
        if shape is None or pairs[shape].log is not None:
            other = pairs[shape].log if shape is not None else None
            both = f"; {shape.name} has {other.name} already" if shape is not None and other is not None else ""
            raise InputError(f"{log.name} holds inputs alone, and a study needs the shape too: add the recording to "
                             f"which it belongs, with a similar name, such as push_3.csv for push_3_log.csv{both}, or "
                             f"name its positions in a mapping{perhaps_a_place(read(log, mapping=options or None))}")
        pairs[shape] = pairs[shape]._replace(log=log, log_options=options or None)
    return [part for pair in in_folders([*pairs.values()]) for part in by_trial(pair)]


def perhaps_a_place(log: xr.Dataset) -> str:
    """Return the lines of the history of a log that name columns, arrays or topics which may be a place."""
    return "".join(f" ({line})" for line in history_of(log) if line.startswith(PERHAPS_A_PLACE) or UNUSED.match(line))


def in_folders(pairs: list[WithLog]) -> list[WithLog]:
    """Return the pairs with the name of its folder as the trial of each file whose name another file has, as where each
    trial has a folder of its own.
    """
    count = Counter(pair.shape.stem for pair in pairs)
    return [pair._replace(trial=pair.shape.resolve().parent.name) if count[pair.shape.stem] > 1 else pair
            for pair in pairs]  # fmt: skip


def by_trial(pair: WithLog) -> list[WithLog]:
    """Return a pair for each trial in the file of the shape, or the pair alone if the file holds one."""
    trials = trials_of(pair.shape, pair.options)
    if trials and pair.log is not None:
        raise InputError(f"{pair.shape.name} holds {len(trials)} trials, and {pair.log.name} belongs to one of them: "
                         "save each trial in a file of its own")
    return [pair._replace(options=options, trial=f"{pair.trial}_{name}".lstrip("_"))
            for name, options in trials.items()] or [pair]  # fmt: skip


def shape_of(log: Path, shapes: Sequence[Path]) -> Path | None:
    """Return the recording to which a log belongs, by its folder if only one recording is there, otherwise by its name;
    None if there is none, or several fit alike.
    """
    beside = [f for f in shapes if f.parent == log.parent]
    if len(beside) == 1:
        return beside[0]
    shapes = beside or shapes
    begins = [f for f in shapes if log.stem.startswith(f.stem) or f.stem.startswith(log.stem)]
    if begins or len(shapes) == 1:
        return max(begins or shapes, key=lambda f: len(f.stem))
    words = Counter(WORD.findall(log.stem.lower()))
    shared = {f: (words & Counter(WORD.findall(f.stem.lower()))).total() for f in shapes}
    most = max(shared.values(), default=0)
    best = [f for f, count in shared.items() if count == most]
    begin = WORD.findall(log.stem.lower())  # words and numbers of both: cam1_log belongs to cam1DLC_resnet50_1
    alike = {f: sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1],
                                         zip(begin, WORD.findall(f.stem.lower()), strict=False))) for f in best}
    longest = [f for f in best if alike[f] == max(alike.values())]
    return longest[0] if most and len(longest) == 1 else None


def inputs_alone(path: Path, options: dict[str, Any] | None) -> dict[str, Any] | None:
    """Return the options by which a file is read as inputs alone, such as a log of pressures: `options` or, if it
    cannot be read by them, none. Return None if it holds a shape or cannot be read.
    """
    if path.suffix.lower() not in LOGS and not is_bag_folder(path):
        return None
    for tried in [options or {}] + [{}] * bool(options):
        try:
            return tried if set(read(path, mapping=tried or None)) <= {"pressure", "actuation"} else None
        except InputError:
            continue
    return None
