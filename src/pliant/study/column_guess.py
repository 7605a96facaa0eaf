"""Proposal of a mapping for a table whose columns nobody described, from their names, units, ranges and integer steps.

What only the laboratory knows, such as the unit of a pressure or the frame rate of a table without times, is an open
question "?" in the proposal. Entries of the user's own mapping take precedence.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from pliant.errors import InputError, shown
from pliant.preprocessing.plausibility.shape import ORDERS, shown_order
from pliant.recording.clock import SECONDS, parted_clock
from pliant.recording.column_names import COUNTERS, bracketed_unit, is_time, parted, unit_of, words_of
from pliant.recording.inclination import hanging
from pliant.recording.joined_runs import LONGEST, TRIAL
from pliant.recording.registry import describes_columns
from pliant.study.curvature_columns import curvature_columns
from pliant.study.input_guess import input_entries, pressure_question
from pliant.study.long_tables import refuse_long
from pliant.study.shorthand import OPEN
from pliant.study.table_columns import (
    PlainTable,
    parted_by_unit,
    parted_times,
    plain_table,
    sensors_by_name,
    stations_by_name,
    stations_by_standard,
)
from pliant.units import METRE, PIXEL

Array = np.ndarray
TABLES = (".csv", ".tsv", ".trc", ".txt", ".dat", ".log")
NUMBERED = re.compile(r"p\d+|base|tip")
CLOCKS = ("t", "time")  # names of times that come before others, such as clock
MILLIMETRES = 5.0  # a smaller range of positions is in metres: no soft arm moves by 5 m
MILLISECONDS, ROUGH = 5, 0.8  # least whole step of such times; change of successive steps of a motion, at most
FAR_MS = 1e14  # later times are no ms since any date
OF_CLOCKS = {"tick", "ticks", "count", "system", "cpu", "timer", "computer", "clock", "time", "pc"}  # words of ticks
SLOW = 10  # least constant whole step of times that may be seconds as well, as in the log of a creep
RIGID = 0.3  # fraction by which the distance of neighbours on one body may change
INPUTS = ("pressure", "inputs", "linear")  # entries of a mapping that name the inputs and convert their values
SCALES = ("camera", "length_unit")  # a mapping states one of them


@dataclass(frozen=True)
class TableGuess:
    """A proposed mapping of a table.

    Attributes
    ----------
    mapping : dict
        Entries for the study, with "?" for open questions.
    neutral : dict
        The same entries with an assumed value for each open question, by which the file can be read.
    questions : dict
        Question by the name of the entry.
    notes : tuple of str
        Sentences on the proposal.
    trials : (column, values) or None
        Column that numbers the trials of the table, and its values.
    """

    mapping: dict[str, Any]
    neutral: dict[str, Any]
    questions: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    trials: tuple[str, list[int]] | None = None

    def beside(self, stated: Mapping[str, Any]) -> TableGuess:
        """Return the proposal with the entries that the user states. If they name inputs, no others are proposed."""
        named = {**dict.fromkeys(INPUTS if set(INPUTS[:2]) & set(stated) else ()),
                 **dict.fromkeys(SCALES if set(SCALES) & set(stated) else ()), **stated}
        mapping, neutral = ({**{k: v for k, v in entries.items() if k not in named}, **stated}
                            for entries in (self.mapping, self.neutral))  # fmt: skip
        units = {"time_unit", "length_unit"} & set(named)
        return replace(self, mapping=mapping, neutral=neutral,
                       notes=tuple(n for n in self.notes if not units & set(n.split())),
                       questions={k: q for k, q in self.questions.items() if k not in named})  # fmt: skip

    @property
    def has_inputs(self) -> bool:
        """Return whether the table holds actuation inputs."""
        return bool({"pressure", "inputs"} & set(self.mapping))

    @property
    def numbered(self) -> bool:
        """Return whether the stations have numbers for names, which say nothing about the parts on which they sit."""
        return all(NUMBERED.fullmatch(name) for name in self.mapping.get("stations", ["angle"]))

    @property
    def readable(self) -> dict[str, Any]:
        """Return the entries by which the file can be read: the neutral ones, and the first of several trials."""
        first = {"select": {"column": self.trials[0], "value": self.trials[1][0]}} if self.trials else {}
        return {**self.neutral, **first}

    @property
    def assumed(self) -> dict[str, Any]:
        """Return the assumed scale of positions in pixels."""
        return {k: v for k, v in self.neutral.items() if k == "camera" and self.mapping.get(k) != v}


def guessed_table(path: Path, stated: Mapping[str, Any] | None = None) -> TableGuess | None:
    """Return a mapping for a text table that holds positions; None for another file, or if its columns do not show
    what they hold.

    Parameters
    ----------
    path : Path
    stated : mapping, optional
        Entries that the user states. If they describe the columns of the shape, there is nothing to propose.
    """
    stated = stated or {}
    shape = {k: v for k, v in stated.items() if k not in INPUTS}
    if path.suffix.lower() not in TABLES or not path.is_file() or "format" in stated or describes_columns(shape):
        return None
    try:
        table = plain_table(path)
        guess = None if table is None else (named if table.names else unnamed)(table, stated)
    except InputError:
        return None
    refuse_bodies_in_rows(path, stated, table)
    if guess is not None and table is not None and not {"camera", "length_unit"} & set(stated):
        refuse_units(table.names, guess.mapping, path.name)
    return None if guess is None else guess.beside(stated)


def refuse_bodies_in_rows(path: Path, stated: Mapping[str, Any], table: PlainTable | None = None) -> None:
    """Raise InputError if each row of a text table holds one of several bodies, and nothing stated chooses one."""
    if path.suffix.lower() not in TABLES or not path.is_file() or {"select", "stations", "format"} & set(stated):
        return
    with suppress(InputError):
        table = table or plain_table(path)
    if table is not None:
        refuse_long(table, path.name)


def refuse_units(names: Sequence[str], mapping: Mapping[str, Any], file: str) -> None:
    """Raise InputError if the names of the columns of positions state several units, or a unit that is unknown."""
    known, stations = set(names), mapping.get("stations", {})
    words = {*(label.lower() for label in stations), "-"}  # of x (base), whose brackets hold no unit
    stated = {c: "" if (unit := bracketed_unit(c)) in words else unit or unit_of(c, METRE)
              for station in stations.values() for c in station["position"] if c in known}  # fmt: skip
    unknown = next((name for name, unit in stated.items() if unit not in ("", *METRE, PIXEL)), None)
    if unknown is not None:
        raise InputError(f"the column {shown(unknown)} of {file} states no known unit of length, which are "
                         f"{', '.join(METRE)}: state length_unit in the mapping")
    first = {next(filter(None, map(stated.get, s["position"])), "") for s in stations.values()}  # x [mm], y, z
    if len(units := {*first, *filter(None, stated.values())}) > 1:
        listed = ", ".join(sorted(unit or "no unit" for unit in units))
        raise InputError(f"{file} states several units of length in its column names ({listed}): convert the columns "
                         "to one unit, or state length_unit in the mapping")


def stated_columns(table: PlainTable, stated: Mapping[str, Any]) -> set[int]:
    """Return the indices of the columns that the user names as inputs."""
    groups = [g for name in INPUTS[:2] for g in as_list(stated.get(name)) if isinstance(g, Mapping)]
    columns = [c for group in groups for c in as_list(group.get("columns"))]
    return {c if isinstance(c, int) else table.names.index(c) for c in columns
            if isinstance(c, int) or c in table.names}  # fmt: skip


def as_list(value: Any) -> list[Any]:
    """Return a list as it is, None as an empty list, and anything else as a list of it."""
    return value if isinstance(value, list) else [] if value is None else [value]


def named(table: PlainTable, stated: Mapping[str, Any]) -> TableGuess | None:
    """Return the proposal for a table with a header, beside what the user states."""
    if len(set(table.names)) < len(table.names):
        return None
    stations = stations_by_name(table.names) or stations_by_standard(table.names)
    sensors = {} if stations else sensors_by_name(table)
    if not stations and not sensors:
        return curved(table)
    positions = {name: {part: [table.names[k] for k in columns] for part, columns in at.items()}
              for name, at in stations.items()}  # fmt: skip
    used = {k for at in stations.values() for columns in at.values() for k in columns} | stated_columns(table, stated)
    used |= {k for columns in sensors.values() for k in columns}
    clocks = [k for k, name in enumerate(table.names) if k not in used and (is_time(name) or k in table.of_day)]
    clocks.sort(key=lambda k: parted(table.names[k])[0] not in CLOCKS)
    clock = next((k for k in clocks if runs(table.values[:, k])), None)
    if clock is None:  # read as stated, it is refused by the rows in which it goes back
        clock = next((k for k in clocks if parted(table.names[k])[0] in CLOCKS and table.changes(k)), None)
    ticks = counter_of(table, used) if clock is None and not {"time", "rate_hz"} & set(stated) else None
    clock = ticks if clock is None else clock
    parts = parted_clock(table.names) if clock is None else parted_by_unit(table)
    parts = parts if parts and clock in (None, parts.seconds, parts.fraction) else None  # not beside a whole clock
    used |= {parts.seconds, parts.fraction} if parts else set()
    rest = [k for k in range(len(table.names)) if k not in used and k != clock and table.changes(k)]
    trial = next((k for k in rest if set(words_of(table.names[k])) <= TRIAL and table.whole(k)), None)
    rest = [k for k in rest if k != trial]
    timed, of_times = clock_entries(table, clock, stations)
    timed |= {"time_unit": OPEN} if ticks is not None else {}
    clock = None if parts else clock
    if parts:
        timed = {"time": [table.names[parts.seconds], table.names[parts.fraction]], "time_unit": parts.unit}
    mapping: dict[str, Any] = {"header": True, **delimited(table), **timed}
    shape, note = shape_entries(table, stations, sensors)
    mapping |= {**shape, **({"stations": positions} if positions else {})}
    inputs, left, notes = input_entries(table, rest)
    left = [k for k in left if not counts(table.values[:, k])]
    if left:
        listed = ", ".join(table.names[k] for k in left[:12])
        notes.append(f"{len(left)} column(s) change and are not used: {listed}{' ...' if len(left) > 12 else ''}")
    trials = None
    if trial is not None and (values := blocks(table.values[:, trial])):
        trials = (table.names[trial], values)
    return asked({**mapping, **inputs}, table, [note, of_times, *notes], trials)


def counter_of(table: PlainTable, used: set[int]) -> int | None:
    """Return the column of the ticks of a computer, not of an encoder, in a unit that the laboratory knows, or None."""
    return next((k for k, name in enumerate(table.names) if k not in used and {"tick", "ticks"} & {*words_of(name)}
                 and {*words_of(name)} <= OF_CLOCKS and rises(table.values[:, k])), None)  # fmt: skip


def curved(table: PlainTable) -> TableGuess | None:
    """Return the proposal for a table of curvatures along a fibre; None for any other table."""
    mapping, questions = curvature_columns(table.names)
    assumed = {"curvature_unit": "1/m", "arc_unit": "mm", "direction_unit": "deg", "pressure_unit": "kPa"}
    neutral = {name: assumed[name] if name in questions else value for name, value in mapping.items()}
    return TableGuess(mapping, neutral, questions) if mapping else None


def shape_entries(
    table: PlainTable, stations: Mapping[str, Mapping[str, Sequence[int]]], sensors: Mapping[str, Sequence[int]],
) -> tuple[dict[str, Any], str]:
    """Return the entries of a mapping for what shows the shape, beside its stations: the unit of the positions, or the
    columns of sensors; and a sentence on it.
    """
    if sensors:
        listed = {name: [table.names[k] for k in columns] for name, columns in sensors.items()}
        if mounted := hanging({name: table.values[:, columns] for name, columns in sensors.items()}, "the table"):
            return {"angles": listed, "inclination": mounted}, (
                "accelerations and orientations without positions show the direction of gravity, and the body leaves a "
                "plane; without inclination they become angles in one plane")
        return {"angles": listed}, "accelerations and orientations without positions become angles in one plane"
    unit, note = length_unit(table, stations)
    return {"camera": {"pixels_per_mm": OPEN}} if unit == PIXEL else {"length_unit": unit}, note


def delimited(table: PlainTable) -> dict[str, Any]:
    """Return the entry of the delimiter, if it is not the default."""
    return {} if table.delimiter == "," else {"delimiter": table.delimiter}


def clock_entries(
    table: PlainTable, clock: int | None, stations: Mapping[str, Mapping[str, Sequence[int]]],
) -> tuple[dict[str, Any], str]:
    """Return the entries of the time column, or an open question for the frame rate; and a sentence on the unit.

    Times without a unit in whole steps of 5 or more are milliseconds if the stations move smoothly from row to row. If
    the steps are all equal and 10 or more, their unit is an open question: they may be seconds.
    """
    if clock is None:
        return {"rate_hz": OPEN}, ""
    entry = {"time": table.names[clock] if table.names else clock}
    if unit := clock_unit(table.names[clock]) if table.names else "":
        return (entry if unit == "s" else {**entry, "time_unit": unit}), ""
    times = table.values[np.isfinite(table.values[:, clock]), clock]
    if not table.whole(clock) or len(times) < 2:
        return entry, ""
    step = float(np.median(np.diff(times)))
    if not (MILLISECONDS <= step < 1000 * MILLISECONDS and stations and is_smooth(table, stations)):
        return entry, "times are taken in s, by their steps: correct time_unit if they are not"
    if step >= SLOW and counts(times):
        return {**entry, "time_unit": OPEN}, "times are taken in ms until time_unit is stated"
    return {**entry, "time_unit": "ms"}, "times are taken in ms, by their steps: correct time_unit if they are not"


def clock_unit(name: str) -> str:
    """Return the unit of time that the name of a column states, or ""."""
    unit = COUNTERS.get(name.lower()) or parted(name)[1]
    return unit if unit in SECONDS else ""


def is_smooth(table: PlainTable, stations: Mapping[str, Mapping[str, Sequence[int]]]) -> bool:
    """Return whether the last station moves smoothly from row to row."""
    last = table.values[:, [*stations.values()][-1]["position"]]
    moves = np.diff(last[np.isfinite(last).all(axis=1)], axis=0)
    return bool((np.diff(moves, axis=0) ** 2).sum() < ROUGH**2 * (moves**2).sum())


def length_unit(table: PlainTable, stations: Mapping[str, Mapping[str, Sequence[int]]]) -> tuple[str, str]:
    """Return the unit of the positions, by the names of their columns or else by their range, and a sentence on it."""
    columns = [k for parts in stations.values() for k in parts["position"]]
    if table.names:
        units = {unit_of(table.names[k], (*METRE, PIXEL)) for k in columns}
        if units == {""} and {"frame_idx", "instance.score"} <= {*table.names}:
            return PIXEL, "points of SLEAP are in pixels"
        if len(units) == 1 and (unit := units.pop()):
            return unit, ""
    axes = zip_longest(*(parts["position"] for parts in stations.values()))
    widest = max(extent(table.values[:, [k for k in axis if k is not None]]) for axis in axes)
    unit = "mm" if widest > MILLIMETRES or np.nanmedian(np.abs(table.values[:, columns])) > 10 * MILLIMETRES else "m"
    return unit, f"positions are taken in {unit}, by their range: correct length_unit if they are not"


def extent(coordinate: Array) -> float:
    """Return the range of a coordinate of all stations (T, S) together, without the lowest and highest 1 %; 0 if no
    value is known.
    """
    known = coordinate[np.isfinite(coordinate)]
    return float(np.ptp(np.percentile(known, [1, 99]))) if known.size else 0.0


def unnamed(table: PlainTable, stated: Mapping[str, Any]) -> TableGuess | None:
    """Return the proposal for a table of numbers alone, beside what the user states: a clock, positions (with
    quaternions) side by side, and steps of motors, which are whole numbers.
    """
    values, width = table.values, table.values.shape[1]
    inputs = stated_columns(table, stated)
    counters = [k for k in range(min(2, width)) if table.whole(k) and counts(values[:, k])]
    clock = next((k for k in range(min(3, width)) if k not in {*counters, *inputs} and rises(values[:, k])), None)
    parts = parted_times(table)
    clock = parts[0] if parts else clock
    rest = [k for k in range(width) if k not in {*counters, *inputs, clock, *(parts or ())}]
    stations, of_turns = posed(table)
    steps = [] if stations or inputs else [k for k in rest if table.whole(k) and table.changes(k)]
    positions = [k for k in rest if k not in steps]
    if not stations and positions and len(positions) % 3 == 0:
        stations = {f"p{i // 3 + 1}": {"position": positions[i : i + 3]} for i in range(0, len(positions), 3)}
        if not on_one_body(values[:, positions].reshape(len(values), -1, 3)):
            return None
    if not stations:
        return None
    unit, note = length_unit(table, stations)
    timed, of_times = clock_entries(table, clock, stations)
    if parts:
        timed, of_times = {"time": [*parts[:2]], "time_unit": parts[2]}, ""
    mapping: dict[str, Any] = {**delimited(table), **timed, "length_unit": unit, "stations": stations}
    used = {k for parts in stations.values() for columns in parts.values() for k in columns}
    left = [k for k in rest if k not in {*used, *steps} and table.changes(k)]
    notes = [note, of_times, of_turns]
    if steps:
        mapping |= {"inputs": [{"columns": steps, "kind": "displacement", "unit": "mm"}],
                    "linear": {"actuation": {"scale": OPEN}}}  # fmt: skip
        notes.append(f"whole numbers in the columns {', '.join(map(str, steps))} (from 0): steps of motors")
    elif left and not inputs:
        mapping["pressure"] = {"columns": OPEN, "unit": OPEN}
    return asked(mapping, table, notes, None, left)


def posed(table: PlainTable) -> tuple[dict[str, dict[str, list[int]]], str]:
    """Return the stations whose positions have a quaternion beside them, as name -> column indices, and a sentence on
    the order of its components, which the positions show or which is taken as x, y, z, w.
    """
    begins: list[int] = []
    for k in range(3, table.values.shape[1] - 3):
        if k >= (begins[-1] if begins else -4) + 7 and table.turns(range(k, k + 4)):
            begins.append(k)
    if not begins:
        return {}, ""
    shape = (len(table.values), len(begins))
    place = table.values[:, [j for k in begins for j in range(k - 3, k)]].reshape(*shape, 3)
    turn = table.values[:, [j for k in begins for j in range(k, k + 4)]].reshape(*shape, 4)
    order = shown_order(place, turn)
    components = ORDERS.get(order, ORDERS["x, y, z, w"])
    note = f"quaternions are read as {order}, as the positions show" if order in ORDERS else \
        "quaternions are taken as x, y, z, w, which the motion does not show: correct their order if it is another"
    return {f"p{s + 1}": {"position": [k - 3, k - 2, k - 1], "quaternion": [k + c for c in components]}
            for s, k in enumerate(begins)}, note  # fmt: skip


def counts(values: Array) -> bool:
    """Return whether values (T,) grow by the same step in every row."""
    step = np.diff(values)
    return bool(step.size and step[0] > 0 and np.allclose(step, step[0], rtol=1e-6, atol=0.0))


def rises(values: Array) -> bool:
    """Return whether values (T,) can be times: they never fall, and rise in most rows."""
    step = np.diff(values)
    return bool(np.isfinite(values).all() and (step >= 0).all() and np.mean(step > 0) > 0.5)


def runs(values: Array) -> bool:
    """Return whether values (T,) can be times of one or several trials: they rise, and fall in few rows."""
    step = np.diff(values[np.isfinite(values)])
    rising, falling = int(np.sum(step > 0)), int(np.sum(step < 0))
    return rising >= max(1, 2 * falling)


def on_one_body(position: Array) -> bool:
    """Return whether points (T, S, 3) can lie on one body: each keeps its distance from its neighbour to 30 %."""
    if position.shape[1] == 1:
        return True
    apart = np.linalg.norm(position[:, :, None] - position[:, None], axis=-1)  # (T, S, S)
    usual = np.nanmedian(apart, axis=0) + np.diag(np.full(position.shape[1], np.inf))
    nearest = np.argmin(usual, axis=1)
    gaps = apart[:, np.arange(len(nearest)), nearest]
    return bool((np.nanpercentile(np.abs(gaps - np.median(gaps, axis=0)), 95, axis=0) <= RIGID * np.median(gaps)).all())


def blocks(values: Array) -> list[int]:
    """Return the trial numbers in a column, if they come in blocks of at least 3 rows; [] for one trial or none."""
    numbers, rows = np.unique(values[np.isfinite(values)], return_counts=True)
    changes = np.count_nonzero(np.diff(values))
    good = 1 < len(numbers) <= LONGEST and changes == len(numbers) - 1 and rows.min() >= 3
    return [int(n) for n in numbers] if good else []


def asked(
    mapping: dict[str, Any], table: PlainTable, notes: Sequence[str], trials: tuple[str, list[int]] | None,
    changing: Sequence[int] = (),
) -> TableGuess:
    """Return the proposal, with its open questions and the values assumed for them. `changing` are the columns without
    a name among which the inputs are.
    """
    neutral, questions = dict(mapping), {}
    if mapping.get("rate_hz") == OPEN:
        neutral["rate_hz"] = 100.0
        questions["rate_hz"] = "rows a second: the table has no column of time"
    if mapping.get("time_unit") == OPEN:
        clock = mapping["time"] if isinstance(mapping["time"], int) else table.names.index(mapping["time"])
        neutral["time_unit"] = "ms" if np.nanmax(table.values[:, clock]) < FAR_MS else "100ns"
        questions["time_unit"] = "unit of the times, whole numbers without a unit: s, ms, us, ns or 100ns"
    if "inclination" in mapping:
        questions["inclination"] = ("down is gravity in the base frame, axes are those of each sensor along x, y and z "
                                    "of its link: as if the body hung in its first frames")  # fmt: skip
    if mapping.get("camera"):
        neutral["camera"] = {"pixels_per_mm": 1.0}
    if (pressure := mapping.get("pressure")) and pressure["columns"] == OPEN:
        del neutral["pressure"]
        questions["pressure"] = (
            f"columns (from 0) of the measured pressures, as [4, 5], and their unit; "
            f"{', '.join(map(str, changing))} change; of tendons: inputs = {{ columns = [4, 5], "
            'kind = "displacement", unit = "mm" }')
    elif pressure:
        neutral["pressure"], question = pressure_question(table, pressure)
        questions |= {"pressure": question} if question else {}
    if "linear" in mapping:
        counted = [c for entry in mapping["inputs"] for c in entry["columns"]
                   if "actuation" in mapping["linear"] or c in mapping["linear"]]  # fmt: skip
        columns = [c if isinstance(c, int) else table.names.index(c) for c in counted]
        width = max(float(np.nanmax(table.values[:, k]) - np.nanmin(table.values[:, k])) for k in columns)
        neutral["linear"] = {name: {"scale": 10.0 / max(width, 1.0)} for name in mapping["linear"]}
        questions["linear"] = "mm of tendon for each step of the motor"
    return TableGuess(mapping, neutral, questions, tuple(n for n in notes if n), trials)

