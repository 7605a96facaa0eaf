"""Tables that state the units of their columns in a row of its own, below the names."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from pliant.errors import InputError, shown
from pliant.recording.column_names import WORDS
from pliant.recording.tables import holds_number, joined, split_cells
from pliant.units import METRE, NEWTON, PASCAL, RADIAN, SECOND, standard_unit

if TYPE_CHECKING:
    from collections.abc import Sequence

NAMED = {*METRE, *PASCAL, *RADIAN, *NEWTON, *SECOND, "ns", "px"}  # join the names of the columns
UNITS = NAMED | {"", "-", "g", "kg", "v", "mv", "a", "ma", "hz", "%", "counts", "m/s", "m/s2", "m/s^2", "rad/s",
                 "deg/s", "°/s", "dps", "rpm", "mm/s", "nm", "n m", "n*m", "°c", "degc", "deg c", "celsius", "c", "k",
                 "ut", "gauss", "l/min", "ohm", "none", "n/a"}  # fmt: skip
KINDS = (METRE, PASCAL, RADIAN, NEWTON, {*SECOND, "ns"})
BRACKETS = re.compile(r"\[\s*([^\[\]]*?)\s*\]|\(\s*([^()]*?)\s*\)|<\s*([^<>]*?)\s*>")
MEASURED = re.compile(r"[+-]?\d[\d.,]*(?:[eE][+-]?\d+)?\s*([^\d\s.,+-][^\d]*)")
STATED = re.compile(r"(?P<name>.+?)(?:[\s_]*[\[(]\s*(?P<bracketed>[^\[\]()]+?)\s*[\])]|[_ ](?P<ending>[^\W\d_]+|°))")


def with_units(lines: Sequence[str], first: int, delimiter: str | None, file: str) -> tuple[list[str], list[str]]:
    """Return the lines of a table whose names are in ``lines[first]``, and a sentence for the history. If the row below
    holds units alone, the names get them in brackets, as ``tip_x [mm]``, and that row is left blank.
    """
    below = next((k for k in range(first + 1, len(lines)) if lines[k].strip()), len(lines))
    if below == len(lines):
        return list(lines), []
    names, cells = (split_cells(lines[k], delimiter) for k in (first, below))
    if not is_units_row(names, cells):
        return list(lines), []
    cells = [without_brackets(cell) for cell in cells]
    titles = [united(name, cell, file) for name, cell in zip(names, cells, strict=True)]
    rows = [*lines[:first], joined(titles, delimiter), *lines[first + 1 : below], "", *lines[below + 1 :]]
    return rows, [f"line {below + 1} of {file} holds units: they are read as those of its columns"]


def is_units_row(names: Sequence[str], cells: Sequence[str]) -> bool:
    """Return whether the cells below the names of columns are units alone, and at least two."""
    if len(cells) != len(names) or any(holds_number(cell) for cell in [*names, *cells] if cell):
        return False
    known = [without_brackets(cell).lower() in UNITS for cell in cells if cell]
    return len(known) > 1 and all(known)


def unit_of_cell(cell: str) -> str:
    """Return the unit behind the number in a cell such as "12.5 mm", as it is written; "" where there is none."""
    match = MEASURED.fullmatch(cell)
    return match[1] if match and standard_unit(match[1]) in NAMED else ""


def without_brackets(cell: str) -> str:
    """Return the unit in a cell such as "[mm]" or "mm", in the spelling that names of columns use."""
    match = BRACKETS.fullmatch(cell)
    unit = "".join(group or "" for group in match.groups()) if match else cell
    return unit if unit.lower() in NAMED or standard_unit(unit) not in NAMED else standard_unit(unit)


def united(name: str, unit: str, file: str) -> str:
    """Return the name of a column with its unit in brackets, or as it is if it states one already."""
    if not unit or unit.lower() not in NAMED:
        return name
    match = STATED.fullmatch(name)
    ending = ((match["bracketed"] or match["ending"]) if match else "").lower()
    stated = standard_unit(ending)
    if match is None or stated not in NAMED or (match["ending"] and ending in WORDS):
        return f"{name} [{unit}]"
    if stated == unit.lower():
        return name
    if match["ending"] and (len(ending) == 1 or not any({stated, unit.lower()} <= set(kind) for kind in KINDS)):
        return f"{name} [{unit}]"  # x_m is the x of a station m, and tip_px that of a station tip
    raise InputError(f"{file}: the name of the column {shown(name)} states {ending}, but the row of units below it "
                     f"states {unit}: correct one")
