"""Reader of LabVIEW measurement files (.lvm): two headers, then columns of numbers and of comments.

A header has one ``Key<separator>value`` per line and ends with ``***End_of_Header***``. The first header describes the
file, the second the channels. Time is the first column (``X_Columns`` One), one column before each channel (Multi), or
computed from ``X0`` and ``Delta_X`` (No). Times count from the ``Date`` and ``Time`` of each channel. The last column
holds comments and is left out. A file of several segments is refused: export one file per segment.
"""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, cast

import numpy as np

from pliant.errors import InputError, clipped
from pliant.recording.logger_channels import Channel, pressure_log
from pliant.recording.registry import ENDINGS, Reader, begins_with
from pliant.recording.stated import Reading, Stated, stated_rate
from pliant.recording.tables import judge_end, parse_numbers, read_text, whole_number

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

END = "***End_of_Header***"
SEPARATORS = {"tab": "\t", "comma": ",", "semicolon": ";"}
LONGEST_HEADER = 200  # lines
WORDS = {  # entries of the headers that take one of a few words; the first is the default
    "X_Columns": ("One", "Multi", "No"), "Decimal_Separator": (".", ","), "Time_Pref": ("Relative", "Absolute"),
    "X_Dimension": ("Time",),
}  # fmt: skip


class LvmLayout(NamedTuple):
    """Entries of the headers of a LabVIEW measurement: how times are stored, and what is stated for each channel."""

    times: Literal["One", "Multi", "No"]
    decimal: str
    relative: bool  # whether times count from the date and time of the channel
    about: dict[str, list[str]]
    file: str

    def number(self, key: str, channel: int, default: float) -> float:
        """Return the number that the header states for a channel, `default` where it states none."""
        values = self.about.get(key, [])
        if channel >= len(values) or not values[channel]:
            return default
        try:
            return float(values[channel].replace(",", "."))
        except ValueError:
            raise InputError(f"the header of {self.file} states {key} = {clipped(values[channel], 40)!r} for channel "
                             f"{channel + 1}, which is not a number: export it again") from None

    def begin(self, channel: int) -> datetime | None:
        """Return the date and time from which the times of a channel count; None where they are not stated."""
        day, clock = (self.about.get(key, [])[channel : channel + 1] for key in ("Date", "Time"))
        if not (self.relative and day and clock):
            return None
        seconds, _, fraction = clock[0].replace(",", ".").partition(".")
        try:
            return datetime.fromisoformat(f"{day[0].replace('/', '-')}T{seconds}.{fraction[:6].ljust(6, '0')}")
        except ValueError:
            return None


def read_lvm(path: Path, mapping: Mapping[str, Any] | None = None) -> Reading:
    """Read the pressures and positions in a LabVIEW measurement file (.lvm) and return them as a recording."""
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
    layout = layout_of(facts, about, path.name)
    table, findings = table_of(lines[ends[1] + 2 :], names, separator, layout.decimal, path.name, ends[1] + 3)
    channels, stated, more = channels_of(table, names, layout)
    return Reading(pressure_log(channels, mapping, path.name, [*findings, *more]), tuple(stated))


def layout_of(facts: dict[str, list[str]], about: dict[str, list[str]], file: str) -> LvmLayout:
    """Return the layout that the two headers of a LabVIEW measurement state; raise InputError for a word that is not
    known.
    """
    words = {}
    for key, known in WORDS.items():
        spelt = {word.lower(): word for word in known}
        cells = [spelt.get(word.lower(), word) for word in (facts | about).get(key, []) if word] or [known[0]]
        if strange := [word for word in cells if word not in known]:
            raise InputError(f"the header of {file} states {key} = {clipped(strange[0], 40)!r}, which is not one of "
                             f"{', '.join(known)}: export it again")
        words[key] = cells[0]
    times = cast('Literal["One", "Multi", "No"]', words["X_Columns"])
    return LvmLayout(times, words["Decimal_Separator"], words["Time_Pref"] == "Relative", about, file)


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
    table: NDArray[np.float64], names: list[str], layout: LvmLayout
) -> tuple[dict[str, Channel], list[Stated], list[str]]:
    """Return the channels of a LabVIEW measurement file by name, each with its own times; the numbers of samples and
    rates that its header states; and lines for the history.
    """
    units = layout.about.get("Y_Unit_Label", [])
    stride = 2 if layout.times == "Multi" else 1
    starts = [start for k in range(table.shape[1]) if (start := layout.begin(k)) is not None]
    channels: dict[str, Channel] = {}
    stated: list[Stated] = []
    history = []
    if len(set(starts)) > 1:
        history.append(f"the channels of {layout.file} begin at different times, and count from the first of them, "
                       f"{min(starts)}")  # fmt: skip
    for k, column in enumerate(range(1, table.shape[1], stride)):
        time = times_of(table, column, k, layout)
        begin = layout.begin(k)
        time = time + ((begin - min(starts)).total_seconds() if begin is not None else 0.0)
        timed = np.isfinite(time)
        name = names[column] or f"channel {k + 1}"
        name = name if name not in channels else f"{name} {k + 1}"
        stated += _statements(layout, k, name, time[timed])
        if untimed := int((~timed & np.isfinite(table[:, column])).sum()):
            history.append(f"{untimed} samples of {clipped(name, 40)} have no time and were left out")
        unit = units[k] if k < len(units) else ""
        channels[name] = Channel(time[timed], table[timed, column], unit)
    return channels, stated, history


def times_of(table: NDArray[np.float64], column: int, channel: int, layout: LvmLayout) -> NDArray[np.float64]:
    """Return the times (T,) [s] of a channel since its own start. The only column of times belongs to the first
    channel; another channel whose header states another step has its own times.
    """
    start, step = layout.number("X0", channel, np.nan), layout.number("Delta_X", channel, np.nan)
    shared = layout.times == "One" and step == layout.number("Delta_X", 0, np.nan)
    if layout.times == "Multi":
        return table[:, column - 1]
    if layout.times == "One" and (channel == 0 or shared or not np.isfinite(step)):
        offset = start - layout.number("X0", 0, np.nan)
        return table[:, 0] + (offset if np.isfinite(offset) else 0.0)
    if not (np.isfinite(start) and np.isfinite(step) and step > 0):
        raise InputError(f"{layout.file} does not state a start time X0 and a time step Delta_X above 0 of channel "
                         f"{channel + 1}: export it with X columns")  # fmt: skip
    counts = [layout.number("Samples", k, np.inf) for k in range(len(layout.about.get("Samples", [])))]
    shorter = channel < len(counts) and counts[channel] < max(counts)  # than the table, which is that of the longest
    rows = np.arange(len(table))
    return np.where(rows < (counts[channel] if shorter else len(table)), start + step * rows, np.nan)


def _statements(layout: LvmLayout, channel: int, name: str, time: NDArray[np.float64]) -> list[Stated]:
    """Return the comparisons of the number of samples and of the rate of a channel. With one header for all that was
    appended later, a file holds more samples than the header states.
    """
    texts = layout.about.get("Samples", [])[channel : channel + 1]
    if texts and texts[0] and whole_number(texts[0]) is None:
        raise InputError(f"the header of {layout.file} states Samples = {clipped(texts[0], 40)!r}, which is not a "
                         "number: export it again")
    what = f"samples of {clipped(name, 40)}"
    counts = [Stated(what, "Samples of its header", float(t), len(time), "at least") for t in texts if t]
    step = layout.number("Delta_X", channel, np.nan)
    written = layout.times != "No" and np.isfinite(step) and step > 0
    return counts + (stated_rate(what, "Delta_X of its header", 1.0 / step, time) if written else [])


READER = Reader("lvm", ENDINGS["lvm"], read_lvm, begins_with(b"LabVIEW Measurement"))
