"""Marks between the thousands of numbers in text tables, such as 1,234.5 and 1.234,5."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import TYPE_CHECKING

from pliant.recording.tables import joined, split_cells

if TYPE_CHECKING:
    from collections.abc import Sequence

THIN = "\u00a0\u202f\u2009'\u2019"  # these mark nothing else between digits
BLANKS = re.compile(rf"(?<=\d)[{THIN}](?=\d{{3}}(?!\d))")
SPACED = re.compile(r"[+-]?[1-9]\d{0,2}(?: \d{3})+(?:[.,]\d+)?")
NUMERIC = re.compile(r"[+-]?[\d.,]*\d[\d.,]*(?:[eE][+-]?\d+)?")
GROUPS = {",": re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?"),
          ".": re.compile(r"[+-]?[1-9]\d{0,2}(?:\.\d{3})+(?:,\d*)?")}  # fmt: skip
OTHER = {",": ".", ".": ","}
SAMPLE, FEWEST = 200, 3  # rows that show how numbers are written; numbers below 1000 that show a mark of thousands


def without_thousands(rows: list[str], delimiter: str | None, name: str) -> tuple[list[str], list[str]]:
    """Return the rows of a table without marks between the thousands of its numbers, and a sentence for the history; of
    quoted numbers with decimal commas in a table with commas, with decimal points.

    A comma or a point is such a mark if three digits follow it in every number, and if other numbers have the other
    mark before their decimals, or the column holds whole numbers below 1000 without a mark.
    """
    text = "\n".join(rows)
    if any(sign in text for sign in THIN) and (plain := BLANKS.sub("", text)) != text:
        return plain.split("\n"), [f"marks between thousands in {name} were left out"]
    spaced = delimiter is not None and " " in text and SPACED.search(text) is not None
    if spaced and (changed := changed_cells(rows, delimiter, SPACED, " ", "")) != rows:
        return changed, [f"blanks between thousands in {name} were left out"]
    inside = [mark for mark in GROUPS if mark in text and (mark != delimiter or '"' in text)]
    for mark in inside:
        sample = columns_of(rows[:SAMPLE], delimiter)
        if any(mark in cell for cells in sample for cell in cells) and not separates(sample, mark):
            continue
        if separates(columns_of(rows, delimiter), mark):
            changed = changed_cells(rows, delimiter, GROUPS[mark], mark, "")
            example = next(cell for cells in columns_of(rows, delimiter) for cell in cells if mark in cell)
            return changed, [f"{mark!r} between thousands in {name} was left out, as in {example}"]
    if delimiter == "," and "," in inside:
        numbers = [cell for cells in columns_of(rows, delimiter) for cell in cells]
        if any("," in cell for cell in numbers) and not any("." in cell for cell in numbers):
            changed = changed_cells(rows, delimiter, NUMERIC, ",", ".")
            return changed, [f"quoted numbers of {name} have decimal commas"]
    return rows, []


def columns_of(rows: Sequence[str], delimiter: str | None) -> list[list[str]]:
    """Return the cells of each column that are written as numbers."""
    columns: list[list[str]] = []
    for row in rows:
        for k, cell in enumerate(split_cells(row, delimiter) if row else []):
            if k == len(columns):
                columns.append([])
            if NUMERIC.fullmatch(cell):
                columns[k].append(cell)
    return columns


def separates(columns: Sequence[Sequence[str]], mark: str) -> bool:
    """Return whether a comma or point stands between the thousands of the numbers in some columns."""
    marked = [cell for cells in columns for cell in cells if mark in cell]
    if not marked or not all(GROUPS[mark].fullmatch(cell) for cell in marked):
        return False
    point = OTHER[mark]
    if any(cell.count(mark) > 1 for cell in marked) or any(point in cell for cell in marked):
        return True
    for cells in columns:
        small = [cell for cell in cells if mark not in cell]
        whole = len(small) < len(cells) and all(cell.lstrip("+-").isdigit() for cell in small)
        if whole and len(small) >= FEWEST and 100 <= max(abs(int(cell)) for cell in small) < 1000 \
                and smoother([cell.replace(mark, "") for cell in cells], [cell.replace(mark, ".") for cell in cells]):
            return True
    return False


def smoother(whole: Sequence[str], decimal: Sequence[str]) -> bool:
    """Return whether a column moves less, by its range, with a mark left out than with the mark as a decimal point."""
    paths = []
    for cells in (whole, decimal):
        values = [float(cell) for cell in cells]
        way = sum(abs(b - a) for a, b in pairwise(values))
        paths.append(way / ((max(values) - min(values)) or 1.0))
    return paths[0] < 0.9 * paths[1]


def changed_cells(
    rows: Sequence[str], delimiter: str | None, pattern: re.Pattern[str], mark: str, other: str
) -> list[str]:
    """Return the rows with `other` for `mark` in the cells that match a pattern."""
    result = []
    for row in rows:
        cells = split_cells(row, delimiter) if mark in row else []
        fitting = [mark in cell and pattern.fullmatch(cell) is not None for cell in cells]
        changed = [cell.replace(mark, other) if fits else cell for cell, fits in zip(cells, fitting, strict=True)]
        result.append(joined(changed, delimiter) if any(fitting) else row)
    return result
