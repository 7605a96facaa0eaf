"""Tables whose rows each hold one of several bodies, as trackers of coils and programs for films write them."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from pliant.errors import InputError, shown
from pliant.recording.column_names import is_time, words_of
from pliant.study.table_columns import PlainTable, axis_of, parted_times

Array = np.ndarray
BODIES = {"sensor", "marker", "body", "bodypart", "station", "track", "tid", "object", "point", "label", "tool", "coil",
          "receiver", "target", "subject", "particle", "segment", "port", "name", "id", "number", "no"}  # fmt: skip
TRACKED = {"track", "tid", "marker", "body", "bodypart", "particle", "coil", "tool"}  # whose rows may follow in blocks
FRAMES = {"frame", "frames", "sample", "index"}  # words of columns that count rows or times
MOST_BODIES = 64
IN_TURN = 0.95  # fraction of rows in which bodies follow in turn
JUMP = 2.0  # change of place from body to body, relative to that of one body, above which there are several


def refuse_long(table: PlainTable, file: str) -> None:
    """Raise InputError if each row of a table holds one of several bodies, so that its rows are no frames."""
    if (column := body_column(table)) is None:
        return
    name = table.names[column] if table.names else column
    value = str(table.texts[column][-1]) if column in table.texts else int(table.values[0, column])
    entry = f"select = {{ column = {json.dumps(name)}, value = {json.dumps(value, ensure_ascii=False)} }}"
    raise InputError(f"each row of {file} holds one of several bodies, which the column {shown(name)} names: write one "
                     "row for each time, with columns for each body, such as base_x and tip_x; one body alone is read "
                     f"by a mapping with {entry}")


def body_column(table: PlainTable) -> int | None:
    """Return the column that names the body of each row; None if the rows are frames."""
    columns = range(table.values.shape[1])
    if not table.names:
        columns = range(columns.stop) if (parts := parted_times(table)) is None else range(parts[1] + 1, columns.stop)
        clocks = [k for k in columns[:2] if always_rises(table.values[:, k])]
        return next((k for k in columns[:2] if in_turn(table.values[:, k])
                     and (not clocks or place_jumps(table, columns[k + 1 :], table.values[:, k]))), None)  # fmt: skip
    axes = [axis_of(words_of(name)) for name in table.names]
    if max(axes.count("x"), axes.count("y")) != 1:
        return None
    return next((k for k, name in enumerate(table.names) if is_body(table, k, words_of(name))), None)


def is_body(table: PlainTable, k: int, words: Sequence[str]) -> bool:
    """Return whether a column k, whose name has these words, names the body of each row.

    In a table whose times rise from row to row, its rows follow in turn and the place jumps from body to body. Else
    they may follow in blocks, between which the time goes back, or share times.
    """
    if not words or not set(words) <= BODIES:
        return False
    values = np.unique(table.texts[k], return_inverse=True)[1] if k in table.texts else table.values[:, k]
    known = np.isfinite(values)
    bodies = np.unique(values[known])
    if not 1 < len(bodies) <= MOST_BODIES or (bodies != np.rint(bodies)).any():
        return False
    clocks = [table.values[:, c] for c, name in enumerate(table.names)
              if c != k and (is_time(name) or c in table.of_day or FRAMES & set(words_of(name)))]  # fmt: skip
    borders = np.diff(values) != 0
    if np.count_nonzero(borders) + 1 == len(bodies):
        back = [(np.diff(clock)[borders] < 0).any() for clock in clocks]
        return bool(set(words) & TRACKED) and (any(back) or not clocks)
    if clocks and all(always_rises(clock) for clock in clocks):
        places = [c for c, name in enumerate(table.names) if axis_of(words_of(name)) in ("x", "y", "z")]
        return in_turn(values) and place_jumps(table, places, values)
    return in_turn(values) or (k in table.texts and any(share_times(clock, values) for clock in clocks))


def always_rises(clock: Array) -> bool:
    """Return whether times (T,) rise from each row to the next."""
    return bool((np.diff(clock[np.isfinite(clock)]) > 0).all())


def place_jumps(table: PlainTable, columns: Sequence[int], bodies: Array) -> bool:
    """Return whether a column changes more from row to row than between the rows of a body, which follow in turn."""
    apart = len(np.unique(bodies))
    values = table.values[:, list(columns)]
    near, far = np.abs(np.diff(values, axis=0)), np.abs(values[apart:] - values[:-apart])
    return bool(any(np.nansum(near[apart - 1 :, c]) > JUMP * np.nansum(far[:, c]) for c in range(len(columns))))


def share_times(clock: Array, bodies: Array) -> bool:
    """Return whether rows are in groups of one size, each with one time and with different bodies (T,)."""
    step = np.diff(clock)
    if not (step >= 0).all() or not step.any() or step.all():
        return False
    sizes = np.diff(np.flatnonzero(np.concatenate([[1.0], step, [1.0]])))
    usual = np.median(sizes)
    alike = np.mean(np.diff(bodies)[step == 0] == 0)
    return bool(usual >= 2 and np.mean(sizes == usual) > IN_TURN and alike < 1 - IN_TURN)


def in_turn(values: Array) -> bool:
    """Return whether whole numbers (T,) follow each other in turn, such as 1, 2, 3, 1, 2, 3."""
    if not np.isfinite(values).all() or (values != np.rint(values)).any():
        return False
    bodies = len(np.unique(values))
    if not 1 < bodies <= min(MOST_BODIES, len(values) // 3) or len(np.unique(values[:bodies])) < bodies:
        return False
    return bool(np.mean(values[bodies:] == values[:-bodies]) > IN_TURN and np.mean(np.diff(values) != 0) > IN_TURN)
