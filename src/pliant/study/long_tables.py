"""Tables whose rows each hold one of several bodies, as trackers of coils and programs for films write them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pliant.errors import InputError, shown
from pliant.recording.column_names import words_of
from pliant.study.table_columns import PlainTable, axis_of

Array = np.ndarray
BODIES = {"sensor", "marker", "body", "bodypart", "station", "track", "tid", "object", "point", "label", "tool", "coil",
          "receiver", "target", "subject", "particle", "segment", "port", "name", "id", "number", "no"}  # fmt: skip
TRACKED = {"track", "tid", "marker", "body", "bodypart", "particle", "coil", "tool"}  # whose rows may follow in blocks
MOST_BODIES = 64
IN_TURN = 0.95  # fraction of rows in which bodies follow in turn


def refuse_long(table: PlainTable, file: str) -> None:
    """Raise InputError if each row of a table holds one of several bodies, so that its rows are no frames."""
    if (column := body_column(table)) is None:
        return
    name = table.names[column] if table.names else column
    value: object = int(table.values[0, column]) if np.isfinite(table.values[0, column]) else "tip"
    chosen = f'"{name}"' if table.names else str(name)
    raise InputError(f"each row of {file} holds one of several bodies, which the column {shown(name)} names: write one "
                     "row for each time, with columns for each body, such as base_x and tip_x; one body alone is read "
                     f"by a mapping with select = {{ column = {chosen}, value = {value!r} }}".replace("'", '"'))


def body_column(table: PlainTable) -> int | None:
    """Return the column that names the body of each row; None if the rows are frames."""
    if not table.names:
        return next((k for k in range(min(2, table.values.shape[1])) if in_turn(table.values[:, k])), None)
    axes = [axis_of(words_of(name)) for name in table.names]
    if max(axes.count("x"), axes.count("y")) != 1:
        return None
    return next((k for k, name in enumerate(table.names) if is_body(table, k, words_of(name))), None)


def is_body(table: PlainTable, k: int, words: Sequence[str]) -> bool:
    """Return whether a column k, whose name has these words, names the body of each row."""
    if not words or not set(words) <= BODIES:
        return False
    values = table.values[:, k]
    if np.isnan(values).all():  # texts
        return repeated_times(table)
    if not table.whole(k) or not 1 < len(np.unique(values[np.isfinite(values)])) <= MOST_BODIES:
        return False
    blocks = np.count_nonzero(np.diff(values)) + 1 == len(np.unique(values))
    return in_turn(values) or (blocks and bool(set(words) & TRACKED))


def repeated_times(table: PlainTable) -> bool:
    """Return whether the rows of a table are in groups of one size, each with one time or number of a frame."""
    for k in range(table.values.shape[1]):
        step = np.diff(table.values[:, k])
        if not (step >= 0).all() or not step.any():
            continue
        sizes = np.diff(np.flatnonzero(np.concatenate([[1.0], step, [1.0]])))
        if np.median(sizes) >= 2 and np.mean(sizes == np.median(sizes)) > IN_TURN:
            return True
    return False


def in_turn(values: Array) -> bool:
    """Return whether whole numbers (T,) follow each other in turn, such as 1, 2, 3, 1, 2, 3."""
    if not np.isfinite(values).all() or (values != np.rint(values)).any():
        return False
    bodies = len(np.unique(values))
    if not 1 < bodies <= min(MOST_BODIES, len(values) // 3) or len(np.unique(values[:bodies])) < bodies:
        return False
    return bool(np.mean(values[bodies:] == values[:-bodies]) > IN_TURN and np.mean(np.diff(values) != 0) > IN_TURN)
