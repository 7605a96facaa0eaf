"""Inputs that keep each value until the next row of their table, as in a table of typed steps (time, level).

Between two samples an input is linear everywhere else. Here samples are added, so that the input keeps the value of a
row until the next row and then jumps. A mapping of any format states it::

    hold = true     # or false: linear between the rows, also where the rows look like typed steps

Without this entry, a table of inputs alone is held if it looks typed: few rows, far apart, nearly each of which jumps
to another level of a coarse scale.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError, shown

if TYPE_CHECKING:
    from collections.abc import Mapping

    import xarray as xr
    from numpy.typing import NDArray

KEY = "hold"
CLOCKS = {"pressure": "pressure_time", "actuation": "input_time"}
BETWEEN, HELD = "between_rows", "hold"  # attribute of a variable, and its value for inputs that keep their rows' values
EVERY_S, MOST = 0.01, 100_000  # s between added samples, and their largest number
EDGE_S = 1e-6  # s before a jump of the last sample with the old value
FEWEST_ROWS, MOST_ROWS, APART_S = 3, 500, 0.2  # of a table that looks typed
CHANGING, JUMP, LEVELS = 0.8, 0.1, 100  # fraction of rows that jump; least jump and number of levels in a range
SENTENCE = "each row keeps its value until the next row"


def without_hold(mapping: Mapping[str, Any] | None, file: str) -> tuple[Mapping[str, Any] | None, bool | None]:
    """Split the options of a file into those of its reader and the entry ``hold``, and return both; None where the
    mapping has no such entry.

    Raises
    ------
    InputError
        When the entry is neither true nor false.
    """
    if mapping is None or KEY not in mapping:
        return mapping, None
    if not isinstance(mapping[KEY], bool):
        raise InputError(f"the mapping for {file}: {KEY} must be true or false, got {shown(mapping[KEY])}")
    return {k: v for k, v in mapping.items() if k != KEY} or None, mapping[KEY]


def held(recording: xr.Dataset, hold: bool | None, file: str) -> xr.Dataset:
    """Return the recording with inputs that keep the value of each row until the next row, as `hold` states; with None,
    if the rows look like typed steps. The history says so.

    Raises
    ------
    InputError
        When `hold` is true and the recording has no input.
    """
    variables = [name for name in CLOCKS if name in recording]
    if hold and not variables:
        raise InputError(f"the mapping for {file}: {KEY} = true needs pressure or another input, and the file has none")
    if hold is False or not variables or (hold is None and not looks_typed(recording)):
        return recording
    lines = [str(recording.attrs.get("history", ""))]
    for name in variables:
        clock = CLOCKS[name]
        times, rows = held_samples(recording[clock].values)
        lines.append(f"{name} of {file}: {SENTENCE}, {recording.sizes[clock]} rows"
                     + (" (hold = true)" if hold else ", since they look like typed steps; set hold = false in the "
                        "mapping if it changes linearly between them"))  # fmt: skip
        sampled = recording.isel({clock: rows}).assign_coords({clock: (clock, times, recording[clock].attrs)})
        recording = sampled.assign({name: sampled[name].assign_attrs({BETWEEN: HELD})})
    return recording.assign_attrs(history="\n".join(filter(None, lines)))


def prolonged(log: xr.Dataset, duration: float) -> xr.Dataset:
    """Return a log of inputs whose last row keeps its value until the log is `duration` [s] long, as a shape that was
    recorded longer; unchanged if its rows are not held or it is longer already. The history says so.
    """
    for name in (name for name in CLOCKS if name in log and log[name].attrs.get(BETWEEN) == HELD):
        clock = log[CLOCKS[name]]
        missing = duration - float(np.ptp(clock.values))
        if missing <= EVERY_S:
            continue
        every = max(EVERY_S, missing / MOST)
        added = float(clock.values[-1]) + np.linspace(0.0, missing, int(np.ceil(missing / every)) + 1)[1:]
        times = np.concatenate([clock.values, added])
        rows = np.minimum(np.arange(len(times)), clock.size - 1)
        line = f"the last row of {name} is held for {missing:.3g} s more, to the end of the shape"
        log = log.isel({CLOCKS[name]: rows}).assign_coords({CLOCKS[name]: (CLOCKS[name], times, clock.attrs)})
        log = log.assign_attrs(history="\n".join(filter(None, [str(log.attrs.get("history", "")), line])))
    return log


def held_samples(clock: NDArray) -> tuple[NDArray, NDArray]:
    """Return sample times (M,) [s] and the row (M,) that each of them shows, for the P rows of a table at the times
    `clock` (P,) [s]. There is a sample every 10 ms, at each row, and just before it.
    """
    every = max(EVERY_S, float(np.ptp(clock)) / MOST)
    edge = min(EDGE_S, 0.1 * float(np.diff(clock).min(initial=np.inf)))
    grid = np.arange(clock[0], clock[-1], every)
    before = np.searchsorted(clock, grid, side="right") - 1
    after = np.minimum(before + 1, len(clock) - 1)
    clear = (grid - clock[before] > 2 * EDGE_S) & (clock[after] - grid > 2 * EDGE_S)
    times = np.sort(np.concatenate([grid[clear], clock, clock[1:] - edge]))
    return times, np.searchsorted(clock, times, side="right") - 1


def held_sentences(recording: xr.Dataset) -> list[str]:
    """Return the lines of a recording's history on inputs that keep the value of each row until the next row."""
    return [line for line in str(recording.attrs.get("history", "")).splitlines() if SENTENCE in line]


def looks_typed(recording: xr.Dataset) -> bool:
    """Return whether a table of inputs alone looks typed by a person: 3 to 500 rows at least 0.2 s apart (median), of
    which at least 80 % differ from the row before, with jumps of typically 10 % of an input's range or more between
    levels that are multiples of 1 % or more of the range.
    """
    if "time" in recording.coords:
        return False
    return all(is_typed(recording[CLOCKS[name]].values, recording[name].values) for name in CLOCKS if name in recording)


def is_typed(clock: NDArray, values: NDArray) -> bool:
    """Return whether P rows of inputs (P,) or (P, C) at the times `clock` (P,) [s] look typed; see `looks_typed`."""
    columns = values.reshape(len(clock), -1)
    if not FEWEST_ROWS <= len(clock) <= MOST_ROWS or np.median(np.diff(clock)) < APART_S:
        return False
    span = np.ptp(columns, axis=0)
    if not (np.isfinite(span).all() and span.any()):
        return False
    scaled = (columns - columns.min(axis=0))[:, span > 0] / span[span > 0]
    jumps = np.abs(np.diff(scaled, axis=0)).max(axis=1)
    changing = jumps > 0
    return bool(np.mean(changing) >= CHANGING and np.median(jumps[changing]) >= JUMP
                and all(on_coarse_scale(column) for column in scaled.T))  # fmt: skip


def on_coarse_scale(levels: NDArray) -> bool:
    """Return whether levels (P,) from 0 to 1 are multiples of 1/k for some whole number k of at most 100."""
    counts = np.arange(1, LEVELS + 1)
    off = levels[:, None] * counts
    return bool((np.abs(off - np.rint(off)) < 1e-6 * counts).all(axis=0).any())
