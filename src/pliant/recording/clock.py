"""Clocks of small loggers: counters that wrap around, stamps that repeat."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
COUNTERS = (2**16, 2**31, 2**32)  # ticks after which millis(), micros() and 16-bit timers begin again
NEAR = 0.02  # of the counter: how close to its end and to zero a wrap lies


def unwrapped(ticks: NDArray, unit: str, file: str) -> tuple[NDArray, list[str]]:
    """Seconds (T,) of a counter's ticks in `unit`, with its wraps undone, and a line of history for them.

    Raises
    ------
    InputError
        For a clock that goes back without being a counter that wrapped: a logger that was started again.
    """
    ticks = np.array(ticks, dtype=np.float64)
    back = np.flatnonzero(np.diff(ticks) < 0)
    wraps = []
    for i in back:
        counter = next((c for c in COUNTERS if (1 - NEAR) * c <= ticks[i] < c and ticks[i + 1] < NEAR * c), None)
        if unit == "s" or counter is None:
            raise InputError(
                f"the clock of {file} goes back, from {ticks[i]:.10g} to {ticks[i + 1]:.10g} {unit} at row {i + 2} of "
                "the table: a logger that was started again writes two recordings; keep one by rows = [first, last]"
            )
        wraps.append((int(i) + 1, counter))
    for first, counter in wraps:
        ticks[first:] += counter
    if not wraps:
        return ticks * SECONDS[unit], []
    line = f"the counter of {file} wrapped around {len(wraps)} time(s), after {wraps[0][1]} {unit}: undone"
    return ticks * SECONDS[unit], [line]


def without_repeats(time: NDArray, file: str) -> tuple[NDArray, list[str]]:
    """Which rows (T,) of a log to keep, the first of each run of equal stamps, and a line of history for the rest."""
    keep = np.concatenate([[True], np.diff(time) != 0])
    dropped = int((~keep).sum())
    finding = [f"{dropped} of {len(keep)} rows of {file} repeat the time stamp before them and are left out"]
    return keep, finding if dropped else []
