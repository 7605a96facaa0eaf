"""Runs that one text table holds below each other, as where a logger was restarted or tables were joined: they get a
column of their own that numbers them.
"""

from __future__ import annotations

from itertools import accumulate
from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError
from pliant.recording.cells import ends_alike
from pliant.recording.clock import round_counter, wrapped_counter
from pliant.recording.column_names import is_time, words_of
from pliant.recording.tables import NUMBER, split_cells

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

RUN = "run"  # name of the column
TRIAL = {"id", "trial", "run", "rep", "repetition", "experiment", "session", "sample"}  # words of such a column
FEWEST_ROWS = 10  # of a run
FARTHEST = 5.0  # usual steps between the first rows of a run, at most
BEGIN = 0.2  # of the time of the shortest run: how far apart runs begin on their clocks


def with_runs(lines: list[str], first: int, mark: str | None, name: str) -> tuple[list[str], int]:
    """Add a column `RUN` to the lines of a table with names in ``lines[first]``, if it holds several runs: its names
    are repeated above each, or its times begin anew. Return a sentence for the history, and the number of runs.

    A table with a column of trials, and one whose times go back otherwise, are left as they are.
    """
    names = split_cells(lines[first], mark)
    if mark is None or any(map(NUMBER.fullmatch, names)) or any(
            words and set(words) <= TRIAL for words in map(words_of, names)):
        return [], 1
    places = [k for k in range(first + 1, len(lines)) if lines[k].strip() and not lines[k].startswith("#")]
    repeated = [lines[k] == lines[first] for k in places]
    rows = [k for k, names_again in zip(places, repeated, strict=True) if not names_again]
    if any(repeated):
        count = accumulate(repeated, initial=1)
        numbers = [n for n, names_again in zip([*count][1:], repeated, strict=True) if not names_again]
        why = "the names of its columns are repeated"
    else:
        clock = next((k for k, title in enumerate(names) if is_time(title)), None)
        numbers = [] if clock is None else restarts([lines[k] for k in rows], clock, mark)
        why = "its times begin anew"
    runs = len(set(numbers))
    if runs < 2:
        return [], 1
    closed = ends_alike([lines[k] for k in rows], mark)
    cut = {len(lines) - 1}  # a last line without an end may be cut
    for k in range(rows[0], len(lines)):
        lines[k] = "" if lines[k].startswith("#") else lines[k]  # such as a title above each run
    for k, names_again in zip(places, repeated, strict=True):
        lines[k] = "" if names_again else lines[k]
    for k, number in zip([first, *rows], [RUN, *map(str, numbers)], strict=True):
        bare = lines[k].rstrip(" ").removesuffix(mark) if closed else lines[k]
        lines[k] = lines[k] if k in cut else f"{bare}{mark}{number}"
    return [f"{name} holds {runs} runs, since {why}; the column {RUN} numbers them"], runs


def restarts(rows: Sequence[str], clock: int, mark: str) -> list[int]:
    """Return the number of its run, from 1, for each row of a table whose times in column `clock` begin anew; [] for
    one run, and where the times go back otherwise.
    """
    cells = [row.split(mark, clock + 1)[clock] if '"' not in row and row.count(mark) >= clock else
             [*split_cells(row, mark), *[""] * clock][clock] for row in rows]
    decimal = "" if mark == "," else ","
    texts = [cell.strip().replace(decimal or "\0", ".") for cell in cells]
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


def refuse_several(runs: int, name: str) -> None:
    """Raise InputError if a table is read as one recording, and it holds several runs."""
    if runs > 1:
        raise InputError(f"{name} holds {runs} runs below each other: `pliant new` makes a recording of each; or read "
                         f'one by select = {{ column = "{RUN}", value = 1 }} in the mapping')  # fmt: skip
