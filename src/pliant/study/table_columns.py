"""Numbers of a text table that nobody described, and the stations and sensors that the names of its columns show."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pliant.errors import InputError
from pliant.recording.arrays import are_quaternions
from pliant.recording.cells import (
    cells_of,
    empty_markers,
    ends_alike,
    is_time_of_day,
    with_seconds,
    with_states,
    without_trailing,
)
from pliant.recording.clock import PartedClock
from pliant.recording.column_names import (
    NUMBERED,
    is_no_place,
    is_time,
    parted,
    standard_names,
    stations_of,
    words_of,
    written_words,
)
from pliant.recording.tables import (
    DELIMITERS,
    holds_number,
    parse_numbers,
    preamble_of,
    split_cells,
    without_text,
)
from pliant.recording.tidy import table_lines
from pliant.recording.units_row import with_units
from pliant.recording.vocabulary import base_to_tip
from pliant.units import METRE

Array = np.ndarray
A_YEAR, FAR = 3.2e7, 1e10  # s: clocks that count seconds and their fraction since 1970 are between these
TURNING = {"q", "quat", "quaternion", "orientation"}
ACCELERATIONS = {"a", "acc", "accel", "acceleration", "linear_acceleration"}
TURNS = {*TURNING, "ori", "rot"}
SENSOR = (r"(?P<kind>q|quat|quaternion|orientation|ori|rot|a|acc|accel|acceleration|linear_acceleration|g|grav|gravity)"
          r"_?(?P<axis>[xyzw])")  # fmt: skip
SENSED = (re.compile(rf"(?:(?P<owner>.+?)_)?(?:imu_)?{SENSOR}(?:_m_s_?2?)?"),
          re.compile(rf"{SENSOR}_(?P<owner>.+?)(?:_m_s_?2?)?"))  # fmt: skip
COMPONENT = re.compile(rf"(?:(?P<owner>.+?)_)?(?:imu_)?(?P<kind>{'|'.join(sorted(TURNS))})_?(?P<axis>[0-3])")


@dataclass(frozen=True)
class PlainTable:
    """Numbers (T, C) of a text table, the names of its columns ([] without a header), its delimiter, the columns that
    hold times of day, and the texts (T,) of the columns without numbers.
    """

    names: list[str]
    values: Array
    delimiter: str
    of_day: frozenset[int] = frozenset()
    texts: Mapping[int, Array] = field(default_factory=dict)

    def changes(self, k: int) -> bool:
        """Return whether column k changes."""
        known = self.values[np.isfinite(self.values[:, k]), k]
        return bool(known.size and np.ptp(known) > 0)

    def turns(self, columns: Sequence[int]) -> bool:
        """Return whether four columns are quaternions of norm 1 in nearly all rows."""
        return are_quaternions(self.values[:, list(columns)])

    def whole(self, k: int) -> bool:
        """Return whether column k holds whole numbers alone."""
        known = self.values[np.isfinite(self.values[:, k]), k]
        return bool(known.size and (known == np.rint(known)).all())


def plain_table(path: Path) -> PlainTable | None:
    """Return the numbers of a text table whose first row may name its columns; None if it has fewer than 3 rows."""
    lines = [line for line in table_lines(path).lines if line.strip() and not line.startswith("#")]
    lines = lines[preamble_of(lines) :]
    if len(lines) < 3:
        return None
    delimiter = next((d for d in DELIMITERS if d in lines[0]), None)
    lines, _ = with_units(lines, 0, delimiter, path.name)
    first = split_cells(lines[0], delimiter)
    if first[-1] == "" and ends_alike(lines, delimiter):
        first.pop()
    names = first if not any(holds_number(cell) for cell in first if cell) else []
    rows, _ = without_trailing(lines[1:] if names else lines, delimiter, len(first), path.name)
    of_day = {k for k, cell in enumerate(split_cells(next(row for row in rows if row), delimiter))
              if is_time_of_day(cell)}  # fmt: skip
    for k in of_day:
        rows, _ = with_seconds(rows, delimiter, k, path.name)
    rows = with_states(rows, delimiter, range(len(first)))[0]
    numbers = without_text(rows, delimiter, (), len(first)) if names else rows
    values = parse_numbers(numbers, name=path.name, first_line=1, delimiter=delimiter, columns=len(first))
    empty_markers(values, path.name)
    texts = cells_of(rows, delimiter, np.flatnonzero(np.isnan(values).all(axis=0)).tolist())
    return PlainTable(names, values, delimiter or "space", frozenset(of_day), texts)


def parted_times(table: PlainTable) -> tuple[int, int, str] | None:
    """Return the columns of whole seconds and of their fraction, and the unit of the fraction (us or ns), if they are
    side by side among the first three columns of a table without names; None for other tables. Most seconds have
    several rows, in which the fraction rises, and begin it anew.
    """
    for k in range(min(2, table.values.shape[1] - 1)):
        whole, part = table.values[:, k], table.values[:, k + 1]
        if not (table.whole(k) and table.whole(k + 1)) or not np.isfinite([whole, part]).all():
            continue
        seconds, rise = np.diff(whole), np.diff(part)
        if not A_YEAR < whole[0] < FAR or np.median(seconds) != 0 or not (rise[seconds != 0] < 0).any():
            continue
        unit, count = ("us", 1e6) if part.max() < 1e6 else ("ns", 1e9)
        rising = bool((seconds * count + rise > 0).all())
        if part.min() >= 0 and 0.1 * count < part.max() < count and rising:
            return k, k + 1, unit
    return None


def parted_by_unit(table: PlainTable) -> PartedClock | None:
    """Return the columns of whole seconds and of their fraction that one name and two units state, such as timestamp_s
    and timestamp_us; None for other tables, as those that state the whole time in both.
    """
    for unit, count in (("us", 1e6), ("ns", 1e9)):
        for k, name in enumerate(table.names):
            title, stated = parted(name)
            j = next((j for j, other in enumerate(table.names) if stated == "s" and parted(other) == (title, unit)), k)
            whole, part = table.values[:, k], table.values[:, j]
            if j == k or not (is_time(name) and table.whole(k) and table.whole(j)):
                continue
            begins_anew = (np.diff(part) < 0).any() and not np.median(np.diff(whole))
            if begins_anew and 0 <= np.nanmin(part) <= np.nanmax(part) < count:
                return PartedClock(k, j, unit)
    return None


def stations_by_name(names: Sequence[str]) -> dict[str, dict[str, list[int]]]:
    """Return the stations whose x, y and z (and quaternion) columns the names show: name -> column indices."""
    parts: dict[str, dict[str, int]] = {}
    for k, name in enumerate(names):
        words = [w for w in words_of(name) if w not in METRE or w in ("m", "in")]
        axis = axis_of(words)
        if axis and not is_no_place([w for w in words if w not in TURNING]):
            others = {*METRE.keys() - {"m", "in"}, *axis, axis, *TURNING, "position", "pos", "pose"}
            owner = "_".join(w for w in written_words(name) if w not in others)
            parts.setdefault(owner, {}).setdefault(axis, k)
    if {"a", "g"} <= set(parts) and "b" not in parts:  # a_x and g_x are an acceleration and a rate of turning
        parts = {owner: columns_of for owner, columns_of in parts.items() if owner not in ("a", "g")}
    stations = {}
    for owner, columns_of in parts.items():
        if all(a in columns_of for a in "xyz"):
            title = f"p{owner}" if owner.isdigit() else owner or "tip"
            stations[title] = {"position": [columns_of[a] for a in "xyz"]}
            if all(f"q{a}" in columns_of for a in "xyzw"):
                stations[title]["quaternion"] = [columns_of[f"q{a}"] for a in "xyzw"]
    return {title: stations[title] for title in base_to_tip([*stations])}


def stations_by_standard(names: Sequence[str]) -> dict[str, dict[str, list[int]]]:
    """Return the stations whose columns other spellings name, such as tipX or m0x [mm]: name -> column indices."""
    try:
        renamed = standard_names(list(names), "the table").names
    except InputError:
        return {}
    listed = stations_of(renamed, [str(k) for k in range(len(names))])
    return {f"p{name[1:]}" if name[1:].isdigit() else name: {
        part: [int(k) for k in columns] for part, columns in at.items()} for name, at in listed.items()}  # fmt: skip


def sensors_by_name(table: PlainTable) -> dict[str, list[int]]:
    """Return the sensors of a table without positions, by their name: the columns of the three components of an
    acceleration, or of the four of a quaternion.
    """
    groups, counted = dict[tuple[str, str], dict[str, int]](), dict[tuple[str, str], dict[str, int]]()
    for k, name in enumerate(table.names):
        words = "_".join(words_of(name.partition("[")[0].removesuffix("_g")))
        match = next(filter(None, (form.fullmatch(words) for form in (*SENSED, COMPONENT))), None)
        if match:
            owner = match["owner"] or ""
            key = ("tip" if owner in ("", *TURNS) else owner, match["kind"])
            (counted if match["axis"].isdigit() else groups).setdefault(key, {}).setdefault(match["axis"], k)
    for key, axes in counted.items():  # q0 to q3, but not angles of joints
        if key not in groups and len(axes) == len("wxyz") and table.turns([*axes.values()]):
            groups[key] = {axis: axes[digit] for axis, digit in zip("wxyz", "0123", strict=True)}
    accelerated = {owner for owner, kind in groups if kind in ACCELERATIONS}
    for parts in ("xyzw", "xyz"):
        sensors: dict[str, list[int]] = {}
        for (owner, kind), axes in groups.items():
            turns = kind in TURNS
            rate = kind == "g" and owner in accelerated  # gx beside ax is of a gyroscope
            if turns == (parts == "xyzw") and set(axes) == set(parts) and not rate:
                sensors.setdefault(owner, [axes[a] for a in parts])
        if sensors:
            return sensors
    return {}


def axis_of(words: Sequence[str]) -> str:
    """Return x, y, z, qx, qy, qz or qw if the words of a column name state one coordinate, else ""."""
    turning = bool(TURNING & set(words))
    for word in words:
        if word in ("qx", "qy", "qz", "qw"):
            return word
    letters = [w for w in words if w in ("x", "y", "z", "w")] or [NUMBERED[w] for w in words[-1:] if w in NUMBERED
                                                                  and turning]  # fmt: skip
    if len(letters) != 1:
        return ""
    return f"q{letters[0]}" if turning or letters[0] == "w" else letters[0]
