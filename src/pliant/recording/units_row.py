"""Tables that state the units of their columns in a row of its own, below the names."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from pliant.recording.tables import holds_number, joined, split_cells
from pliant.units import METRE, NEWTON, PASCAL, RADIAN, SECOND

if TYPE_CHECKING:
    from collections.abc import Sequence

NAMED = {*METRE, *PASCAL, *RADIAN, *NEWTON, *SECOND, "ns", "px", "°"}  # join the names of the columns
UNITS = NAMED | {"", "-", "g", "kg", "v", "mv", "a", "ma", "hz", "%", "counts", "m/s", "m/s2", "m/s^2", "rad/s",
                 "deg/s", "degrees", "seconds", "none", "n/a"}  # fmt: skip
BRACKETS = re.compile(r"[\[(<]?\s*([^\[\]()<>]*?)\s*[\])>]?")


def with_units(lines: Sequence[str], first: int, delimiter: str | None, file: str) -> tuple[list[str], list[str]]:
    """Return the lines of a table whose names are in ``lines[first]``, and a sentence for the history. If the row below
    holds units alone, the names get them in brackets, as ``tip_x [mm]``, and that row is left blank.
    """
    below = next((k for k in range(first + 1, len(lines)) if lines[k].strip()), len(lines))
    if below == len(lines):
        return list(lines), []
    names, cells = (split_cells(lines[k], delimiter) for k in (first, below))
    cells = [BRACKETS.sub(r"\1", cell, count=1) for cell in cells]
    if len(cells) != len(names) or any(holds_number(cell) for cell in [*names, *cells] if cell):
        return list(lines), []
    known = [cell.lower() in UNITS for cell in cells if cell]
    if len(known) < 2 or not all(known):
        return list(lines), []
    united = [f"{name} [{cell}]" if cell.lower() in NAMED and cell and f"[{cell}]" not in name else name
              for name, cell in zip(names, cells, strict=True)]  # fmt: skip
    rows = [*lines[:first], joined(united, delimiter), *lines[first + 1 : below], "", *lines[below + 1 :]]
    return rows, [f"line {below + 1} of {file} holds units: they are read as those of its columns"]
