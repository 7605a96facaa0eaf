"""Rewrite the cells of a text table before its numbers are parsed: marks of missing values, times of day, status words
and delimiters at the ends of rows. Every change is counted.
"""

from __future__ import annotations

import re
from datetime import date
from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError, clipped
from pliant.recording.tables import NUMBER, count_cells, joined, split_cells

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from numpy.typing import NDArray

TIME_OF_DAY = re.compile(
    r"(?:(?P<date>\d{1,4}[-/.](?:\d\d?|[A-Za-z]{3})[-/.]\d{1,4})[T _,]+)?(?:(?P<hour>\d\d?):)?(?P<minute>\d\d?):"
    r"(?P<second>\d\d(?:[.,]\d+|:\d{3}(?:\d{3}){0,2})?)(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?(?: ?(?:Z|UTC|[+-]\d\d:?\d\d))?"
)
MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
ORDERS = ("year-month-day", "day-month-year", "month-day-year")
DAY = 86400.0  # s
STATES = {"true": "1", "false": "0", "on": "1", "off": "0", "open": "1", "opened": "1", "closed": "0", "close": "0",
          "high": "1", "low": "0", "yes": "1", "no": "0"}  # fmt: skip
MARKERS, NEARLY = (3.697314e28, 3.4028235e38, 1.7976931e308), 0.01  # size of NDI's; the largest numbers of 4, 8 bytes
LATE = 0.5  # of a day: a time of day that falls by more has passed midnight


def without_trailing(rows: list[str], delimiter: str | None, width: int, name: str) -> tuple[list[str], list[str]]:
    """Return the rows of a table of `width` columns without the delimiter at the end of each, and a sentence for the
    history; unchanged unless every row has it and no cell behind it.
    """
    filled = next((row for row in rows if row.strip()), "")
    if delimiter is None or not ends_alike(rows, delimiter) or count_cells(filled, delimiter) != width + 1:
        return rows, []
    return ([row.rstrip(" ").removesuffix(delimiter) for row in rows],
            [f"each row of {name} ends with {delimiter!r}, which begins no cell and is left out"])  # fmt: skip


def ends_alike(rows: Sequence[str], delimiter: str | None) -> bool:
    """Return whether each row of a table that is not blank ends with the delimiter, but perhaps the last."""
    bare = [row.rstrip(" ") for row in rows if row.strip(" ")]
    return delimiter is not None and bool(bare) and all(row.endswith(delimiter) for row in bare[:-1] or bare)


def cells_of(rows: Sequence[str], delimiter: str | None, columns: Collection[int]) -> dict[int, NDArray]:
    """Return the texts (R,) of some columns of a table with R rows that are not blank; "" where a row is too short."""
    split = [split_cells(row, delimiter) for row in rows if row.strip()]
    return {k: np.array([cells[k] if k < len(cells) else "" for cells in split], object) for k in columns}


def rewritten(
    rows: Sequence[str], delimiter: str | None, columns: Collection[int], change: Callable[[str], str]
) -> list[str]:
    """Return the rows of a table with the cells of some columns replaced by `change` of the cell."""
    result = []
    for row in rows:
        cells = split_cells(row, delimiter) if row.strip() else []
        for k in columns:
            if k < len(cells):
                cells[k] = change(cells[k])
        result.append(joined(cells, delimiter))
    return result


def without_marks(
    rows: Sequence[str], delimiter: str | None, columns: Collection[int], marks: Sequence[str | float], name: str
) -> tuple[list[str], list[str]]:
    """Return the rows of a table with "nan" for each cell of the columns that is one of the `marks` of missing values,
    and a sentence for the history that counts them.
    """
    words = {mark for mark in marks if isinstance(mark, str)}
    numbers = {float(mark) for mark in marks if not isinstance(mark, str)}
    count = 0

    def change(cell: str) -> str:
        nonlocal count
        missing = cell in words or bool(numbers and NUMBER.fullmatch(cell) and float(cell) in numbers)
        count += missing
        return "nan" if missing else cell

    changed = rewritten(rows, delimiter, columns, change)
    listed = ", ".join(clipped(str(mark), 20) for mark in marks)
    return changed, [f"{count} cell(s) of {name} hold {listed} and are gaps"]


def empty_markers(table: NDArray, name: str) -> list[str]:
    """Turn the numbers (R, K) by which instruments mark a missing value, such as -3.697314E+28 of NDI's trackers, into
    NaN in place, and return a sentence for the history that counts them; [] if there is none.
    """
    listed = []
    for marker in MARKERS:
        cells = np.abs(np.abs(table) / marker - 1.0) <= NEARLY
        if count := int(cells.sum()):
            listed.append(f"{count} value(s) of {name} are {marker:.3g} in size, the number by which instruments mark "
                          "a missing value: they are gaps")
            table[cells] = np.nan
    return listed


def with_states(
    rows: Sequence[str], delimiter: str | None, columns: Collection[int], name: str = "",
) -> tuple[list[str], list[str]]:
    """Return the rows of a table with 1 and 0 for the states in those of the `columns` that hold states alone, such as
    true and false, or open and closed, and a sentence for the history that counts these columns.
    """
    first = split_cells(next((row for row in rows if row.strip()), ""), delimiter)
    likely = [k for k in columns if k < len(first) and first[k].lower() in STATES]
    texts = cells_of(rows, delimiter, likely)
    switched = [k for k in likely if {word.lower() for word in texts[k]} <= {*STATES, ""}]
    if not switched:
        return list(rows), []
    changed = rewritten(rows, delimiter, switched, lambda cell: STATES.get(cell.lower(), cell))
    example = clipped(first[switched[0]], 20)
    return changed, [f"{len(switched)} column(s) of {name} hold states such as {example}, read as 1 and 0"]


def is_time_of_day(cell: str) -> bool:
    """Return whether a cell holds a time such as 10:11:12.5 or 4:08:20 PM, a time since the start such as 01:12.5, or a
    date with a time, such as 2026-05-03 10:11:12.5 or 3.5.2026 10:11:12,5.
    """
    match = TIME_OF_DAY.fullmatch(cell)
    return match is not None and (match["hour"] is not None or not match["second"].isdigit())


def with_seconds(rows: Sequence[str], delimiter: str | None, column: int, name: str) -> tuple[list[str], list[str]]:
    """Return the rows of a table with times of day in a column replaced by seconds since the first row, and a sentence
    for the history; unchanged where the first row holds no time of day.

    Raises
    ------
    InputError
        When the first row holds a time of day and another row does not.
    """
    cells = split_cells(next((row for row in rows if row.strip()), ""), delimiter)
    if column >= len(cells) or not is_time_of_day(cells[column]):
        return list(rows), []
    clock = [cell for cell in cells_of(rows, delimiter, [column])[column] if cell]
    order, doubt = order_of_dates(clock, name)
    zero, last, days = seconds(clock[0], name, order), 0.0, 0.0

    def change(cell: str) -> str:
        nonlocal last, days
        if not cell:
            return cell
        now = seconds(cell, name, order) - zero + days
        if now < last - LATE * DAY:
            now, days = now + DAY, days + DAY
        last = now
        return f"{round(now * 1e9)}e-9"  # without a decimal point, which other columns may write as a comma

    changed = rewritten(rows, delimiter, [column], change)
    return changed, [f"the times of {name} are times of day; 0 s is {clock[0]}{doubt}"
                     + (f", and {days / DAY:.0f} midnight(s) were passed" if days else "")]  # fmt: skip


def order_of_dates(clock: Sequence[str], name: str) -> tuple[str, str]:
    """Return the one of `ORDERS` in which the dates of times (R,) are written, and a remark if others are possible: of
    these, the one with the shortest time between the first and the last row. "" where the times have no date.

    Raises
    ------
    InputError
        When the dates are none in any order.
    """
    dates = [match["date"] for cell in dict.fromkeys((clock[0], *clock)) if (match := TIME_OF_DAY.fullmatch(cell))]
    if not dates or dates[0] is None:
        return "", ""
    days: dict[str, list[int | None]] = {o: [day_of(one, o) for one in dict.fromkeys(dates) if one] for o in ORDERS}
    spans = {order: max(known) - min(known) for order, all_days in days.items()
             if len(known := [day for day in all_days if day is not None]) == len(all_days)}  # fmt: skip
    if not spans:
        raise InputError(f"{name}: {clipped(dates[0], 40)!r} in the column of time is not a date: write year-month-day")
    best = min(spans, key=lambda order: spans[order])
    others = [order for order in spans if order != best]
    return best, f" ({best}; {others[0]} would be possible too)" if others and spans[best] != spans[others[0]] else ""


def day_of(text: str, order: str) -> int | None:
    """Return the day, counted from the year 1, of a date in one of the `ORDERS`; None if it is none."""
    parts = dict(zip(order.split("-"), re.split("[-/.]", text), strict=True))
    month = parts["month"].lower()
    try:
        year = int(parts["year"]) + (2000 if len(parts["year"]) == 2 else 0)
        return date(year, MONTHS.index(month) + 1 if month in MONTHS else int(month), int(parts["day"])).toordinal()
    except ValueError:
        return None


def seconds(cell: str, name: str, order: str) -> float:
    """Return a time of day in seconds since midnight or, with a date in the `order` of `ORDERS`, since the year 1."""
    match = TIME_OF_DAY.fullmatch(cell)
    if match is None or (match["date"] is None) != (order == ""):
        raise InputError(f"{name}: the column of time holds times of day, but one cell is {clipped(cell, 40)!r}: "
                         "correct it, or leave it empty")
    hour = int(match["hour"] or 0)
    if match["half"]:
        hour = hour % 12 + (12 if match["half"] in "pP" else 0)
    whole, _, fraction = re.sub("[,:]", ".", match["second"]).partition(".")
    day = day_of(match["date"], order) if order else 0
    if day is None:
        raise InputError(f"{name}: {clipped(cell, 40)!r} in the column of time is not a date: write {order}")
    return DAY * day + 3600 * hour + 60 * int(match["minute"]) + float(f"{whole}.{fraction or 0}")


def is_one_of(texts: NDArray, values: Sequence[str | float]) -> NDArray:
    """Return a mask (R,) of the cells (R,) that equal one of the values, as text or as a number."""
    words = {str(value) for value in values}
    numbers = {float(v) for v in values if not isinstance(v, str)}
    return np.array([cell in words or bool(numbers and NUMBER.fullmatch(cell) and float(cell) in numbers)
                     for cell in texts], bool)  # fmt: skip
