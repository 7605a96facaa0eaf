"""Repair the sample times of small data loggers: counters that wrap around, times in two columns, and time stamps that
repeat.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pliant.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "100ns": 1e-7, "min": 60.0, "h": 3600.0}
COUNTERS = (2**16, 2**31, 2**32)  # ticks after which millis(), micros() and 16-bit timers begin again
YEAR_2000, YEAR_2100 = 9.466848e8, 4.1025312e9  # s since 1970
ROUND = (60, 10**3, 10**6, 10**9)  # ticks of a second or a minute, after which a counter may begin again
SHEET_2000, SHEET_2100, DAY = 36526.0, 73051.0, 86400.0  # days since the end of 1899, as spreadsheets store dates; s
SHORT = 5e-5  # least step of times in s: shorter ones between such numbers are fractions of a day
SLOW, ROUNDED = 1e-3, 5e-3  # days: longest step between dates that is recognised; s: rounding of their digits
EXACT = 0.9  # of a step: how far from a round counter the next time may be
NEAR = 0.02  # of the counter: how close to its end and to zero a wrap lies

PARTS = {  # names of seconds, and of their fraction with its unit
    "seconds": re.compile(r"(?:.*[_ .])?(?:sec|secs|seconds)", re.IGNORECASE),
    "us": re.compile(r"(?:.*[_ .])?(?:us|usecs?|microsecs?|microseconds?)", re.IGNORECASE),
    "ns": re.compile(r"(?:.*[_ .])?(?:ns|nsecs?|nanosecs?|nanoseconds?)", re.IGNORECASE),
}


class PartedClock(NamedTuple):
    """The columns of a time that a table stores in two parts: seconds, and their fraction in a smaller unit."""

    seconds: int
    fraction: int
    unit: str

    def joined(self, table: NDArray) -> NDArray:
        """Return the times (R,) [s] since the first whole second of a table (R, K)."""
        whole = table[:, self.seconds]
        begin = whole[np.isfinite(whole)][:1].sum()
        return np.asarray(whole - begin + table[:, self.fraction] * SECONDS[self.unit])


def parted_clock(names: Sequence[str]) -> PartedClock | None:
    """Return the columns of the time of a table that stores it in two, such as ``sec`` and ``usec``; None for any other
    table.
    """
    seconds = [k for k, name in enumerate(names) if PARTS["seconds"].fullmatch(name)]
    for unit in ("us", "ns"):
        fraction = [k for k, name in enumerate(names) if PARTS[unit].fullmatch(name)]
        if len(seconds) == len(fraction) == 1:
            return PartedClock(seconds[0], fraction[0], unit)
    return None


def unwrapped(ticks: NDArray, unit: str, file: str) -> tuple[NDArray, list[str]]:
    """Convert T counter values `ticks` (T,) of a logger to times (T,) [s] without wrap-arounds. Also return a history
    line that counts the wrap-arounds, if there were any.

    Raises
    ------
    InputError
        When the time goes back and no counter wrapped, as when a logger was restarted.
    """
    ticks = np.array(ticks, dtype=np.float64)
    if unit == "s" and is_of_sheet(ticks):
        ticks = np.round((ticks - ticks[np.isfinite(ticks)][0]) * DAY, 6)
        return ticks, [f"the times of {file} are days of a spreadsheet, by their size; 0 s is the first row"]
    unit, epoch = since_1970(ticks, unit, file)
    back = np.flatnonzero(np.diff(ticks) < 0)
    wraps = []
    for i in back:
        counter = wrapped_counter(ticks[i], ticks[i + 1])
        if unit == "s" or counter is None:
            step = np.diff(ticks)
            full = round_counter(ticks[i], ticks[i + 1], float(np.median(step[step > 0]))) if (step > 0).any() else None
            why = f"its counter may begin anew after each {full} {unit}: export times that go on" if full else \
                "the logger was probably restarted"
            raise InputError(
                f"the time in {file} goes back from {ticks[i]:.10g} to {ticks[i + 1]:.10g} {unit} at row {i + 2} of "
                f"the table: {why}; {'or ' * bool(full)}keep one run by rows = [first, last] in the mapping"
            )
        wraps.append((int(i) + 1, counter))
    for first, counter in wraps:
        ticks[first:] += counter
    if not wraps:
        return ticks * SECONDS[unit], epoch
    line = f"the time counter of {file} wrapped around {len(wraps)} time(s), after {wraps[0][1]} {unit}: corrected"
    return ticks * SECONDS[unit], [*epoch, line]


def wrapped_counter(before: float, after: float) -> int | None:
    """Return the counter of a logger that wrapped between two of its values; None if none did."""
    return next((c for c in COUNTERS if (1 - NEAR) * c <= before < c and after < NEAR * c), None)


def round_counter(before: float, after: float, step: float) -> int | None:
    """Return the counter of `ROUND` of which a clock of the usual step `step` may have begun anew between two of its
    values; None if there is none. A run that was started again after such a time looks the same.
    """
    return next((c for c in ROUND if abs(before + step - c - after) < EXACT * step and before < c), None)


def is_of_sheet(ticks: NDArray) -> bool:
    """Return whether times (T,) are days since the end of 1899, as spreadsheets store dates with times: their size is
    that of a date of this century, and they rise by less than 5e-5 days (4.3 s), or by whole seconds and less than
    1e-3 days (86 s).
    """
    known = ticks[np.isfinite(ticks)]
    step = np.diff(known)
    if not (step.size and SHEET_2000 <= known.min() <= known.max() < SHEET_2100 and (step >= 0.0).all()):
        return False
    whole = step * DAY - np.round(step * DAY)
    return bool(0.0 < np.median(step) < SHORT or (
        SHORT <= np.median(step) < SLOW and np.abs(whole).max() < ROUNDED))


def since_1970(ticks: NDArray, unit: str, file: str) -> tuple[str, list[str]]:
    """Return the unit of times (T,) that are taken in `unit`, and a sentence for the history. Times since 1970 show
    their unit by their size: numbers too large for seconds are milliseconds, microseconds or nanoseconds.
    """
    known = ticks[np.isfinite(ticks)]
    size = float(known.min()) if known.size else 0.0
    match = next((u for u in ("ms", "us", "ns") if YEAR_2000 <= size * SECONDS[u] < YEAR_2100), None)
    if unit != "s" or match is None:
        return unit, []
    return match, [f"the times of {file} are {match} since 1970, by their size"]


def without_repeats(
    time: NDArray, file: str, rows: NDArray | None = None
) -> tuple[NDArray, list[str]]:
    """Return a mask (T,) of T rows that is True for the first row of each run of equal time stamps, and a line for the
    history.

    With the values `rows` (T, K), of a shape, a row is left out only if it equals the previous row in all K values.

    Raises
    ------
    InputError
        When there is no row.
    """
    if not len(time):
        raise InputError(f"{file} has no row with a time: copy or export it again, with its times")
    same = np.diff(time) == 0
    if rows is not None:
        same &= ((rows[1:] == rows[:-1]) | (np.isnan(rows[1:]) & np.isnan(rows[:-1]))).all(axis=1)
    keep = np.concatenate([[True], ~same])
    dropped = int((~keep).sum())
    what = "repeat the previous time stamp" if rows is None else "repeat the previous row with its time stamp"
    finding = [f"{dropped} of {len(keep)} rows of {file} {what} and are left out"]
    return keep, finding if dropped else []


def usual_step(time: NDArray[np.float64]) -> float:
    """Return the usual time [s] between two of T samples `time` (T,): the mean of the steps that are no gaps. NaN for
    fewer than two samples.

    The median would be wrong by the rounding of the times, and the mean of all steps by lost samples.
    """
    step = np.diff(time)
    if not step.size:
        return float("nan")
    middle = float(np.median(step))
    near = step[(step > 0.5 * middle) & (step < 1.5 * middle)]
    return float(near.mean()) if near.size else middle
