"""Runs that one text table holds below each other, as where a logger was restarted or tables were joined: they get a
column of their own that numbers them.
"""

from __future__ import annotations

from collections import Counter
from itertools import accumulate
from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError
from pliant.recording.cells import ends_alike
from pliant.recording.clock import round_counter, wrapped_counter
from pliant.recording.column_names import is_time, words_of
from pliant.recording.tables import NUMBER, judge_end, split_cells
from pliant.recording.units_row import is_units_row

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

RUN = "run"  # name of the column
TRIAL = {"id", "trial", "run", "rep", "repetition", "experiment", "session", "sample"}  # words of such a column
FEWEST_ROWS = 10  # of a run
FARTHEST = 5.0  # usual steps between the first rows of a run, at most
LONGEST, LISTED = 60, 3  # runs of one table that a draft lists, and that a message lists
BEGIN = 0.2  # of the time of the shortest run: how far apart runs begin on their clocks


def with_runs(lines: list[str], first: int, mark: str | None, name: str) -> tuple[list[str], tuple[int, ...]]:
    """Add a column `RUN` to the lines of a table with names in ``lines[first]``, if it holds several runs: its names
    are repeated above each, or its times begin anew. Return sentences for the history, and the rows of each run.

    A table with a column of trials, and one whose times go back otherwise, are left as they are.
    """
    names = split_cells(lines[first], mark)
    if mark is None or any(map(NUMBER.fullmatch, names)) or any(
            words and set(words) <= TRIAL for words in map(words_of, names)):
        return [], ()
    places = [k for k in range(first + 1, len(lines)) if lines[k].strip() and not lines[k].startswith("#")]
    units = [lines[k] for k in places[:1] if is_units_row(names, split_cells(lines[k], mark))]
    repeated = [lines[k] == lines[first] for k in places]
    rows = [k for k, names_again in zip(places, repeated, strict=True) if not names_again and lines[k] not in units]
    if any(repeated):
        above = dict(zip(places, accumulate(repeated), strict=True))  # line: rows of names above it
        blocks = [above[k] for k in rows]
        numbers = (np.unique(blocks, return_inverse=True)[1] + 1).tolist()  # names repeated at once begin one run
        why = "the names of its columns are repeated"
    else:
        clock = next((k for k, title in enumerate(names) if is_time(title)), None)
        numbers = [] if clock is None else restarts([lines[k] for k in rows], clock, mark)
        why = "its times begin anew"
    if len(set(numbers)) < 2:
        return [], ()
    notes = [f"{name} holds {len(set(numbers))} runs, since {why}; the column {RUN} numbers them"]
    notes += without_cut_row(lines, rows, numbers, mark, name)
    closed = ends_alike([lines[k] for k in rows], mark)
    for k in {*range(rows[0], len(lines)), *places[len(units):]} - {*rows}:
        lines[k] = ""  # names and units above each run, or a title
    labels = [RUN, *[""] * len(units), *map(str, numbers)]
    for k, label in zip([first, *places[: len(units)], *rows], labels, strict=True):
        bare = lines[k].rstrip(" ").removesuffix(mark) if closed else lines[k]
        lines[k] = f"{bare}{mark}{label}"
    return notes, tuple(Counter(numbers).values())


def without_cut_row(lines: list[str], rows: list[int], numbers: list[int], mark: str, name: str) -> list[str]:
    """Leave out the last of the `rows` of a table, and its number, if it has no line end and is cut; return a sentence
    for the history.
    """
    kept, notes = judge_end([lines[k] for k in rows], mark, name) if rows[-1] == len(lines) - 1 else (rows, [])
    if len(kept) == len(rows):
        return []
    lines[rows.pop()] = ""
    numbers.pop()
    return notes


def restarts(rows: Sequence[str], clock: int, mark: str) -> list[int]:
    """Return the number of its run, from 1, for each row of a table whose times in column `clock` begin anew; [] for
    one run, and where the times go back otherwise.
    """
    cells = [row.split(mark, clock + 1)[clock] if '"' not in row and row.count(mark) >= clock else
             [*split_cells(row, mark), *[""] * clock][clock] for row in rows]
    texts = [cell.strip() if mark == "," else cell.strip().replace(",", ".") for cell in cells]
    if not all(NUMBER.fullmatch(text) for text in texts if text):
        return []
    times = filled(np.array([float(text) if text else np.nan for text in texts]))
    step = np.diff(times)
    falls = np.flatnonzero(step < 0) + 1
    if not falls.size or any(wrapped_counter(times[k - 1], times[k]) for k in falls):
        return []
    begins = np.array([0, *falls])
    ends = np.array([*falls, len(times)])
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 0.0
    shortest = float((times[ends - 1] - times[begins]).min())
    if (ends - begins).min() < FEWEST_ROWS or np.ptp(times[begins]) > BEGIN * shortest:
        return []
    if not all(goes_on(times[begin:end], usual, times[begin - 1] if begin else np.inf)
               for begin, end in zip(begins, ends, strict=True)):  # fmt: skip
        return []
    if all(round_counter(times[k - 1], times[k], usual) for k in falls):
        return []
    return [*np.repeat(np.arange(1, len(begins) + 1), ends - begins).tolist()]


def goes_on(times: NDArray, usual: float, before: float) -> bool:
    """Return whether times (T,) behind a time `before` go on as those of a run do: their first steps are near the
    `usual` one, and none leads back to the clock before, as behind wrong time stamps.
    """
    step = np.diff(times)
    back = int(np.searchsorted(times, before))
    near = step[: FEWEST_ROWS - 1]
    return bool((near < FARTHEST * usual).all() and near.any() and (
        back in (0, len(times)) or step[back - 1] < FARTHEST * usual))


def filled(times: NDArray) -> NDArray:
    """Return times (T,) with the time before in place of each gap, and 0 before the first time."""
    known = np.where(np.isfinite(times), np.arange(len(times)), 0)
    return np.nan_to_num(times[np.maximum.accumulate(known)])


def refuse_several(runs: Sequence[int], name: str, *, drafted: bool) -> None:
    """Raise InputError if a table is read as one recording, and it holds several runs of so many rows each. `drafted`
    says whether `pliant new` can make a recording of each run.
    """
    if len(runs) < 2:
        return
    ends = [*accumulate(runs)]
    parts = [f"[{end - count}, {end}]" for count, end in zip(runs, ends, strict=True)]
    listed = " or ".join(parts) if len(parts) <= LISTED else f"{', '.join(parts[: LISTED - 1])} ... or {parts[-1]}"
    each = "`pliant new` makes a recording of each; or " if drafted and len(runs) <= LONGEST else ""
    raise InputError(f"{name} holds {len(runs)} runs below each other: {each}read one by its rows in the mapping, "
                     f"rows = {listed}")  # fmt: skip
