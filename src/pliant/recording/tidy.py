"""Lines of text tables as other programs write them, made into one row of names above rows of numbers. Every change is
counted in a sentence, and the lines keep their numbers.
"""

from __future__ import annotations

import re
from functools import lru_cache
from itertools import accumulate
from typing import TYPE_CHECKING, NamedTuple

from pliant.recording.column_names import is_time
from pliant.recording.instrument_tables import as_table
from pliant.recording.joined_runs import with_runs
from pliant.recording.tables import (
    COPY,
    DELIMITERS,
    MARKS,
    MOST_PREAMBLE,
    NUMBER,
    count_cells,
    delimiter_of,
    encoded_text,
    first_row,
    holds_number,
    joined,
    preamble_of,
    repeated_names,
    split_cells,
)
from pliant.recording.thousands import without_thousands
from pliant.recording.units_row import is_units_row, unit_of_cell, united, without_brackets

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

COMMENTS = ("#", "%", "//")
RULE = re.compile(r"[|+]?(?:[ :]*[-=]{3,}[ :]*[|+])+(?:[ :]*[-=]{3,}[ :]*)?")  # below names between bars
WIDE = 4  # cells of a table whose lines of a title may be filled up
SAMPLE, MOST_BELOW, NEAR = 20, 40, 3  # rows that show the delimiter; at most: rows below a table, lines to its names
AXIS = re.compile(r"(?:.*[\W_])?[xyz](?:[\W_].*)?", re.IGNORECASE)
SUMMARIES = {"mean", "average", "avg", "std", "stdev", "std dev", "sd", "min", "max", "minimum", "maximum", "median",
             "sum", "total", "count", "var", "variance", "rms", "range", "mittelwert", "moyenne", "media", "end", "eof",
             "summary", "statistics"}  # fmt: skip


class TableText(NamedTuple):
    """Lines of a table, sentences for the history on what was changed in them, and the number of rows of each of
    several runs below each other, which the column `RUN` numbers.
    """

    lines: list[str]
    notes: list[str]
    runs: tuple[int, ...] = ()


def table_lines(
    path: Path, *, skip_lines: int | None = None, delimiter: str | None = None, header: bool | None = None,
    events: bool = True,
) -> TableText:
    """Return the lines of a text table, of which the first row that is no comment holds the names, where there are any.

    Parameters
    ----------
    path : Path
    skip_lines, delimiter, header : optional
        As a mapping of the table states them.
    events : bool
        Whether rows of words between the rows of numbers are left out. They count where a mapping selects `rows`.
    """
    text, encoding = encoded_text(path)
    notes = [f"{path.name} is read as {encoding} text"] if encoding else []
    table = tidied(text, path.name, skip_lines, delimiter, header, events)
    return TableText([*table.lines], [*notes, *table.notes], table.runs)


@lru_cache(maxsize=1)  # a table is read several times, by different rules
def tidied(
    text: str, name: str, skip_lines: int | None, delimiter: str | None, header: bool | None, events: bool,
) -> TableText:
    """Return the lines of the text of a table; see `table_lines`."""
    lines, notes = text.split("\n"), list[str]()
    if skip_lines is None:
        lines, more = as_table(lines, name)
        notes += more
    for k, line in enumerate(lines):
        if line.startswith(COMMENTS[1:]):
            lines[k] = "#" + line.lstrip("%/")
    notes += blanked(lines, [k for k, line in enumerate(lines) if RULE.fullmatch(line.strip())],
                     f"{name} are rules between rows")  # fmt: skip
    notes += without_outer_bars(lines, name)
    stated = delimiter is not None
    for step in (without_fill, names_above, one_delimiter, one_row_of_names, without_rows_below, without_comments,
                 *((without_events,) if events else ()), with_units_of_cells, without_separators,
                 without_copies):  # fmt: skip
        first = first_row(lines, preamble_of(lines) if skip_lines is None else skip_lines)
        if first >= len(lines):
            break
        mark = delimiter_of(lines[first], delimiter)
        if (header is False and step in (names_above, one_row_of_names)) or (stated and step is one_delimiter):
            continue
        if skip_lines is not None and step in (names_above, without_fill):
            continue
        notes += step(lines, first, mark, name)
    first = first_row(lines, preamble_of(lines) if skip_lines is None else skip_lines)
    if header is False or first >= len(lines):
        return TableText(lines, notes)
    mark = delimiter_of(lines[first], delimiter)
    more, runs = with_runs(lines, first, mark, name)
    return TableText(lines, [*notes, *more, *without_repeated_names(lines, first, mark, name)], runs)


def without_outer_bars(lines: list[str], name: str) -> list[str]:
    """Leave out the bars at both ends of all lines that hold bars, as in a table of a text with marks; those that only
    begin with one keep their last cell, which may be blank.
    """
    barred = [k for k, line in enumerate(lines) if "|" in line and not line.startswith("#")]
    if not barred or not all(lines[k].lstrip().startswith("|") for k in barred):
        return []
    closed = all(lines[k].rstrip().endswith("|") for k in barred)
    for k in barred:
        lines[k] = lines[k].strip().removeprefix("|").removesuffix("|" if closed else "").strip()
    return [f"the bars at {'both ends' if closed else 'the beginning'} of {len(barred)} line(s) of {name} are left out"]


def holds_rows(path: Path) -> bool:
    """Return whether some line of a text table holds two numbers or more, and more numbers than words. A line of
    numbers alone may have decimal commas between blanks.
    """
    for line in table_lines(path).lines:
        cells = [cell for cell in split_cells(line, delimiter_of(line, None)) if cell]
        if sum(map(is_number, cells)) > max(1, len(cells) / 2):
            return True
        between_blanks = line.split()
        if len(between_blanks) > 1 and all(map(is_number, between_blanks)):
            return True
    return False


def is_number(cell: str) -> bool:
    """Return whether a cell holds a number, with a decimal point or comma."""
    return NUMBER.fullmatch(cell.replace(",", ".")) is not None


def following(lines: Sequence[str], first: int) -> list[int]:
    """Return the indices of the lines after `first` that are neither blank nor a comment."""
    return [k for k in range(first + 1, len(lines)) if lines[k].strip() and not lines[k].startswith("#")]


def is_named(cells: Sequence[str]) -> bool:
    """Return whether a row of cells holds words and no number."""
    return any(cells) and not any(holds_number(cell) for cell in cells if cell)


def without_fill(lines: list[str], first: int, mark: str | None, _name: str) -> list[str]:
    """Leave out the delimiters by which a spreadsheet fills up lines of a title, at most half of whose cells hold a
    text, above a row of names that says the time and is wider.
    """
    filled: list[int] = []
    for k in range(first, min(len(lines), MOST_PREAMBLE)):
        cells = split_cells(lines[k], mark)
        text = len(list(filter(None, cells)))
        if mark is None or len(cells) != count_cells(lines[first], mark) or len(cells) < WIDE:
            return []
        if is_named(cells) and text >= len(cells) - 1 and any(map(is_time, cells)):
            break
        if any(cells[text:]) or 2 * text > len(cells):
            return []
        filled.append(k)
    else:
        return []
    for k in filled:
        lines[k] = lines[k].rstrip(f"{mark} ")
    return []


def names_above(lines: list[str], first: int, mark: str | None, name: str) -> list[str]:
    """Take the names of columns from a comment above rows of numbers, or from a line with another delimiter, if it has
    as many cells as these rows, and one that says time or a coordinate.
    """
    width = count_cells(lines[first], mark)
    if width < 2 or is_named(split_cells(lines[first], mark)):
        return []
    above = [k for k in range(min(first, MOST_PREAMBLE)) if lines[k].strip()]
    for k in reversed(above[-NEAR:]):
        text = lines[k].lstrip("#").strip()
        for candidate in (mark, *DELIMITERS, None):
            cells = split_cells(text, candidate)
            if len(cells) == width and is_named(cells) and any(is_time(c) or AXIS.fullmatch(c) for c in cells):
                lines[k] = as_row(cells, mark)
                return [f"line {k + 1} of {name}, above rows of numbers, holds the names of its columns"]
    return []


def as_row(names: Sequence[str], mark: str | None) -> str:
    """Return names of columns as a row; blanks in a table that they separate become underscores."""
    return joined(names if mark else ["_".join(cell.split()) for cell in names], mark)


def one_delimiter(lines: list[str], first: int, mark: str | None, name: str) -> list[str]:
    """Write the names with the delimiter of the rows below, where it is another; of two delimiters behind each cell,
    leave one.
    """
    rows = following(lines, first)
    shown = [lines[k] for k in rows[:SAMPLE]]
    if not shown:
        return []
    for one in DELIMITERS:
        for other in DELIMITERS:
            pair = one + other
            if one != other and all(0 < line.count(pair) == line.count(one) == line.count(other)
                                    for line in (lines[first], *shown)):  # fmt: skip
                lines[first:] = [line.replace(pair, one) for line in lines[first:]]
                return [f"cells of {name} end with two delimiters, {pair!r}: the second was left out"]
    cells = split_cells(lines[first], mark)
    if not is_named(cells) or len(cells) < 2 or any(count_cells(line, mark) == len(cells) for line in shown):
        return []
    for candidate in (*DELIMITERS, None):
        if all(count_cells(line, candidate) == len(cells) for line in shown):
            lines[first] = as_row(cells, candidate)
            return [f"the names of the columns of {name} have another delimiter than its rows"]
    return []


def one_row_of_names(lines: list[str], first: int, mark: str | None, name: str) -> list[str]:
    """Join two rows of names: that of bodies, which is blank or repeated beside their other coordinates, and that of
    the coordinates. Coordinates that repeat without names of bodies belong to bodies with numbers.
    """
    cells, below = split_cells(lines[first], mark), following(lines, first)
    if not is_named(cells) or not below:
        return []
    upper = next((k for k in range(first - 1, -1, -1) if lines[k].strip() and not lines[k].startswith("#")), None)
    next_cells = split_cells(lines[below[0]], mark)
    if repeated_names(cells) and is_named(next_cells) and len(next_cells) == len(cells) \
            and not is_units_row(cells, next_cells):
        rows = (first, below[0])
    elif repeated_names(cells) and upper is not None and mark is not None and mark in lines[upper]:
        rows = (upper, first)
    else:
        return numbered(lines, first, cells, mark, name)
    bodies, parts = (split_cells(lines[k], mark) for k in rows)
    bodies += [""] * (len(parts) - len(bodies))
    spread = list(accumulate(bodies, body_before))
    names = [part if not body or part == body or (part and not own and not AXIS.fullmatch(part)) else
             f"{body}_{part}" if part else body
             for own, body, part in zip(bodies, spread, parts, strict=False)]  # fmt: skip
    if len(bodies) != len(parts) or repeated_names(names) or not all(names):
        return numbered(lines, first, cells, mark, name)
    lines[rows[0]], lines[rows[1]] = "", joined(names, mark)
    return [f"lines {rows[0] + 1} and {rows[1] + 1} of {name} name its columns together, such as {names[-2][:40]}"]


def body_before(before: str, body: str) -> str:
    """Return the name of a body or, for a blank cell, of the one before."""
    return body or before


def numbered(lines: list[str], first: int, cells: list[str], mark: str | None, name: str) -> list[str]:
    """Number the bodies of coordinates that repeat, such as x, y, z, x, y, z."""
    if not repeated_names(cells):
        return []
    axes = [re.fullmatch(r"([xyz])(?:\W.*)?", cell, re.IGNORECASE) for cell in cells]
    letters = [match[1].lower() for match in axes if match]
    count = letters.count("x")
    if count < 2 or letters.count("y") != count or letters.count("z") not in (0, count):
        return []
    seen: dict[str, int] = {}
    for k, match in enumerate(axes):
        if match:
            letter = match[1].lower()
            seen[letter] = seen.get(letter, 0) + 1
            cells[k] = f"p{seen[letter]}_{cells[k]}"
    lines[first] = joined(cells, mark)
    return [f"{count} columns x of {name} are those of bodies p1 to p{count}, from base to tip as they stand"]


def without_rows_below(lines: list[str], first: int, mark: str | None, name: str) -> list[str]:
    """Leave out the rows below a table, such as means and deviations, from the first one on that begins with such a
    word, or that holds words alone and has another number of cells.
    """
    rows = following(lines, first)
    if len(rows) < 2:
        return []
    width = count_cells(lines[rows[0]], mark)
    unit_row = is_units_row(split_cells(lines[first], mark), split_cells(lines[rows[0]], mark))
    begins = split_cells(lines[rows[1 if unit_row else 0]], mark)[0].lower()
    for k in rows[1:][-MOST_BELOW:]:
        if lines[k][:1].isdigit():
            continue
        cells = split_cells(lines[k], mark)
        if any(is_data(lines[row], mark, width) for row in rows[-MOST_BELOW:] if row > k):
            continue
        label = cells[0].lower().rstrip(":.")
        alone = len(cells) != width and is_named(cells)
        if (label in SUMMARIES and (is_number(begins) or ":" in begins)) or alone:
            below = [row for row in rows if row >= k]
            for row in below:
                lines[row] = ""
            where = f"from line {k + 1} on, which begins with {cells[0][:40]!r}"
            return [f"{len(below)} row(s) below the table of {name} are left out, {where}"]
    return []


def without_events(lines: list[str], first: int, mark: str | None, name: str) -> list[str]:
    """Leave out rows of words between the rows of a table, such as EVENT, valve open: at least half of their cells are
    blank, none is a number or names a time, and the times go on behind them.
    """
    rows, width = following(lines, first), count_cells(lines[first], mark)
    if mark is None:
        return []
    events, waiting, before = list[int](), list[int](), ""
    for k in rows:
        cells = split_cells(lines[k], mark)
        words = [cell for cell in cells if cell]
        if is_data(lines[k], mark, width):
            events += waiting if before and goes_on(before, cells[0]) else []
            waiting, before = [], cells[0]
        elif words and 2 * len(words) <= width and not any(is_number(c) or is_time(c) for c in words) \
                and not words[0][:1].isdigit():
            waiting.append(k)
    return blanked(lines, events, f"{name} hold words between its rows of numbers")


def goes_on(before: str, cell: str) -> bool:
    """Return whether a cell holds a time, or number, that is not before that in another."""
    if is_number(before) and is_number(cell):
        return float(cell.replace(",", ".")) >= float(before.replace(",", "."))
    return ":" in before and ":" in cell


def without_copies(lines: list[str], first: int, mark: str | None, name: str) -> list[str]:
    """Rename the columns that repeat the name of another and have the same cells in every row, so that they are not
    read.
    """
    names = split_cells(lines[first], mark)
    if mark is None or not is_named(names) or not (repeated := set(repeated_names(names)) - {""}):
        return []
    columns = [*zip(*(split_cells(lines[k], mark) for k in following(lines, first)), strict=False)]
    places = {title: k for k, title in reversed([*enumerate(names)])}
    firsts = {k: places[title] for k, title in enumerate(names[: len(columns)]) if title in repeated}
    copies = {k: begin for k, begin in firsts.items() if k > begin and columns[k] == columns[begin]}
    if not copies:
        return []
    lines[first] = joined([f"{COPY}{k}" if k in copies else title for k, title in enumerate(names)], mark)
    listed = ", ".join(names[k][:40] for k in copies)
    return [f"{len(copies)} column(s) of {name} repeat another by name and in every row, and are left out: {listed}"]


def is_data(line: str, mark: str | None, width: int) -> bool:
    """Return whether a line holds as many cells as a table and begins with a number or a time."""
    cells = split_cells(line, mark)
    return len(cells) == width and any(c.isdigit() for c in cells[0])


def without_comments(lines: list[str], first: int, mark: str | None, name: str) -> list[str]:
    """Leave out comments between the rows of a table and, of a table with times, rows that repeat its names: without
    times they may begin another run. A comment behind a blank line begins another table, which is not joined to the
    first.
    """
    named = is_named(split_cells(lines[first], mark))
    begin = next(iter(following(lines, first)), first) if named else first
    comments = [k for k in range(first + 1, len(lines))
                if lines[k].startswith("#") and split_cells(lines[k], mark)[0] not in MARKS
                and (k < begin or lines[k - 1].strip())]  # fmt: skip
    notes = blanked(lines, comments, f"{name} are comments among its rows")
    timed = any(map(is_time, split_cells(lines[first], mark)))
    return [*notes, *without_repeated_names(lines, first, mark, name)] if timed else notes


def without_repeated_names(lines: list[str], first: int, mark: str | None, name: str) -> list[str]:
    """Leave out rows that repeat the names of a table."""
    repeats = [k for k in range(first + 1, len(lines)) if lines[k] == lines[first]]
    return blanked(lines, repeats if is_named(split_cells(lines[first], mark)) else [],
                   f"{name} repeat the names of its columns")  # fmt: skip


def blanked(lines: list[str], places: Sequence[int], what: str) -> list[str]:
    """Leave out lines at `places` of a table; return a sentence for the history on `what` they are."""
    for k in places:
        lines[k] = ""
    return [f"{len(places)} line(s) of {what} and are left out, the first in line {places[0] + 1}"] if places else []


def with_units_of_cells(lines: list[str], first: int, mark: str | None, name: str) -> list[str]:
    """Move units that stand behind each number of a column into its name, as where a cell is 12.5 mm."""
    names, rows = split_cells(lines[first], mark), following(lines, first)
    if mark is None or not rows or not is_named(names):
        return []
    cells = split_cells(lines[rows[0]], mark)
    units = {k: unit for k, cell in enumerate(cells) if k < len(names) and (unit := unit_of_cell(cell))}
    split = {row: split_cells(lines[row], mark) for row in rows} if len(units) > 1 else {}
    units = {k: unit for k, unit in units.items() if all(
        len(one) <= k or not one[k] or one[k].endswith(unit) for one in split.values())}  # fmt: skip
    if len(units) < 2:
        return []
    for row, one in split.items():
        lines[row] = joined([cell.removesuffix(units[k]).rstrip() if k in units else cell
                             for k, cell in enumerate(one)], mark)  # fmt: skip
    titled = [united(title, without_brackets(units[k]), name) if k in units else title for k, title in enumerate(names)]
    lines[first] = joined(titled, mark)
    return [f"the units in the cells of {len(units)} column(s) of {name} are read as those of the columns"]


def without_separators(lines: list[str], first: int, mark: str | None, name: str) -> list[str]:
    """Leave out marks between thousands, see `without_thousands`."""
    rows, notes = without_thousands(lines[first + 1 :], mark, name)
    if notes:
        lines[first + 1 :] = rows
    return notes
