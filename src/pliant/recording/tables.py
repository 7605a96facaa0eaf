"""Functions that parse text tables of numbers. Their messages name the line and the cell that is not a number."""

from __future__ import annotations

import codecs
import csv
import io
import json
import re
import warnings
from collections import Counter
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError
from pliant.files import LARGEST_TABLE, content_of
from pliant.recording.vocabulary import JOINED, without_accents

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

MISSING = ("", "nan", "NaN", "NAN", "null", "NA")
MARKS = ("-", "--", "N/A", "n/a", "#N/A", "None", "none", "NULL", "Null", "nil", "#DIV/0!", "#VALUE!", "#REF!", "#NUM!",
         "#NAME?", "-nan", "-NaN", "nan(ind)", "-nan(ind)", "1.#QNAN", "-1.#IND")  # of missing numbers, in rows alone
# narrower than float(), which also takes 1_000 and digits of other scripts
NUMBER = re.compile(r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|inf|infinity)", re.IGNORECASE)
COPY = "copy of column "  # begins the name of a column that repeats another, which a sentence names already
DELIMITERS = (";", "\t", "|", ",")  # the first of them in a header line is its delimiter
WIDE = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
EASTERN, MOST_NAMES = ("gb18030", "cp932"), 4000  # encodings of spreadsheets in Chinese and Japanese; bytes with names
ASCII = 127
SIGNS = "\u00b0\u00b5\u00b2\u00b3\u00b1\u00b7\u00d7\u00a0\u00a7\u2019\u2018\u201c\u201d\u2013\u2014\u2026\u2022"
MOST_PREAMBLE = 200  # lines in which a table begins
COMPARED_ROWS = 200  # rows before the last one that say how many digits a number has
LONGEST_LINE = 4_000_000  # characters; a longer first line is no header


def read_text(path: Path) -> str:
    """Read a text file and return its text without a byte-order mark and with newlines as line ends."""
    return encoded_text(path)[0]


def encoded_text(path: Path) -> tuple[str, str]:
    """Read a text file; return its text without a byte-order mark and with newlines as line ends, and the name of its
    encoding ("" for UTF-8): UTF-16, which spreadsheets and loggers of Windows write; GB 18030 or code page 932 if known
    Chinese or Japanese names are in it; or Windows-1252, if the bytes that are no UTF-8 are letters or signs such as a
    degree.

    Raises
    ------
    InputError
        When the file is empty, or no text in one of these encodings.
    """
    data = content_of(path, "table", LARGEST_TABLE)
    if not data.strip():
        raise InputError(f"{path.name} is empty: copy or export it again")
    text, encoding = decoded(data)
    if text is None:
        what = "it holds zero bytes, so it is binary or in another encoding" if b"\0" in data else \
            "some of its bytes are no letters in Windows-1252 either"
        raise InputError(f"{path.name} is not UTF-8 text: {what}; save it as UTF-8 text")
    return text.replace("\r\n", "\n").replace("\r", "\n"), encoding


def decoded(data: bytes) -> tuple[str | None, str]:
    """Return the text of a file's bytes and the name of its encoding; None if it is in none that is known."""
    wide = next((codec for mark, codec in WIDE.items() if data.startswith(mark)), None)
    try:
        if wide is not None and not data.startswith(codecs.BOM_UTF32_LE):
            text = data.decode(wide).removeprefix("\ufeff")
            return (None if "\0" in text else text), "UTF-16"
        return (None if b"\0" in data else data.decode("utf-8-sig")), ""
    except UnicodeDecodeError:
        pass
    for codec in EASTERN:
        with suppress(UnicodeDecodeError):
            words = JOINED.finditer(without_accents(data[:MOST_NAMES].decode(codec, errors="ignore")))
            if any(codec != "gb18030" or min(word[0].encode(codec)) > ASCII for word in words):  # no sign and a letter
                return data.decode(codec), codec
    try:
        text = data.decode("cp1252")
    except UnicodeDecodeError:
        return None, ""
    return (text if all(c.isalpha() or c in SIGNS for c in set(text) if ord(c) > ASCII) else None), "Windows-1252"


def find_delimiter(line: str, name: str) -> str:
    """Return the delimiter of the cells in a header line: semicolon, tab, bar or comma."""
    if len(line) > LONGEST_LINE:
        raise InputError(f"the header of {name} is {len(line)} characters long, so this is not a text table: export "
                         "a table, or correct format in the mapping")
    for delimiter in DELIMITERS:
        if delimiter in line:
            return delimiter
    return ","


def first_row(lines: Sequence[str], start: int) -> int:
    """Return the index of the first line from `start` on that is neither blank nor a comment; that of the end if all
    are.
    """
    return next((k for k in range(start, len(lines)) if lines[k].strip() and not lines[k].startswith("#")), len(lines))


def delimiter_of(line: str, stated: str | None) -> str | None:
    """Return the delimiter of a table as its mapping states it, or else from its first row; None for white space."""
    if stated is not None:
        return None if stated == "space" else stated
    return next((candidate for candidate in DELIMITERS if candidate in line), None)


def preamble_of(lines: Sequence[str], delimiter: str | None = None) -> int:
    """Return the number of lines before a table, such as a title and a date: those above the first row that the two
    rows below equal in their number of cells, if no row above has more than half as many. 0 if there is no such row.

    `delimiter` is that of the table; by default the first of `DELIMITERS` in the row.
    """
    first = [k for k, line in enumerate(lines[:MOST_PREAMBLE]) if line.strip() and not line.startswith("#")]
    for order, k in enumerate(first[:-2]):
        mark = delimiter or next((candidate for candidate in DELIMITERS if candidate in lines[k]), None)
        width, *below = (count_cells(lines[row], mark) for row in first[order : order + 3])
        if width > 1 and below == [width, width]:
            above = [count_cells(lines[row], mark) for row in first[:order]]
            return k if all(2 * count <= width for count in above) else 0
    return 0


def split_cells(line: str, delimiter: str | None) -> list[str]:
    """Split a line of a table into cells, without blanks and quotes around them. A delimiter within quotes belongs to
    the cell. Where `delimiter` is None, cells are separated by white space.
    """
    if delimiter is None:
        cells = line.split()
    elif '"' in line:
        cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    else:
        cells = line.split(delimiter)
    return [cell.strip().strip('"').strip() for cell in cells]


def joined(cells: Sequence[str], delimiter: str | None) -> str:
    """Return the line of a table with these cells; a cell that holds the delimiter gets quotes."""
    return (delimiter or " ").join(f'"{cell}"' if delimiter and delimiter in cell else cell for cell in cells)


def count_cells(line: str, delimiter: str | None) -> int:
    """Return the number of cells in a line of a table; a delimiter within quotes separates none."""
    if delimiter is None or '"' in line:
        return len(split_cells(line, delimiter))
    return line.count(delimiter) + 1


def repeated_names(names: Sequence[str]) -> list[str]:
    """Return, sorted, each name that occurs more than once in a list of names."""
    return sorted(name for name, count in Counter(names).items() if count > 1)


def without_dots(name: str) -> str:
    """Return the name of a station, chamber or tendon without dots, which in the names of parameters follow that of the
    part.
    """
    return name.replace(".", "_")


def whole_number(text: str) -> int | None:
    """Return `text` as an int where it consists of one to nine decimal digits, else None."""
    return int(text) if re.fullmatch("[0-9]{1,9}", text) else None


def judge_end(lines: list[str], delimiter: str | None, name: str) -> tuple[list[str], list[str]]:
    """Drop the last row of a text table if it is incomplete. Return the remaining rows, and a list with one sentence
    about the dropped row, which is empty if the table is complete.

    A file that was cut has no line end after its last row, and may hold `0.27` of `0.27944`.

    Parameters
    ----------
    lines : list of str
        A text split at its line ends; the last element is empty where the text is complete.
    delimiter : str or None
    name : str
        File name, for messages.

    Returns
    -------
    lines, history
        The lines, without the last row where it has fewer cells, or its last number fewer digits, than the rows before
        it; and one sentence for the history, none for a complete text.
    """
    if not lines or not lines[-1].strip():
        return lines, []
    rows = [line for line in lines[-COMPARED_ROWS - 1 :] if line.strip()]
    last, before = split_cells(rows[-1], delimiter), [split_cells(row, delimiter) for row in rows[:-1]]
    problem = f"the last line of {name} has no line end"
    if before and len(last) < min(map(len, before)):
        return lines[:-1], [f"{problem} and {len(last)} cell(s) instead of {len(before[-1])}: it was left out"]
    if before and _digits(last[-1]) < min(_digits(row[-1]) for row in before):
        return lines[:-1], [f"{problem} and its last number has fewer digits than those above: it was left out"]
    return lines, [f"{problem}: the file may be truncated inside its last number"]


def _digits(cell: str) -> int:
    return sum(c.isdigit() for c in cell)


def holds_number(cell: str) -> bool:
    """Return whether a cell of a table holds a number (with decimal point or comma) or a marker of a missing number,
    such as NaN.
    """
    return cell in MISSING or NUMBER.fullmatch(cell.replace(",", ".")) is not None


def without_text(
    rows: list[str], delimiter: str | None, used: Collection[int], width: int, *, header: bool = True,
    words: Collection[int] = (),
) -> list[str]:
    """Return the rows of a table of `width` columns with "nan" in the columns that hold text and are not in `used`, and
    in the columns `words`.

    Whether a column holds text is judged by its first `COMPARED_ROWS` cells; in a table without a header by those after
    the first row, which may be a header that was not stated.
    """
    first = [split_cells(row, delimiter) for row in rows[:COMPARED_ROWS] if row.strip()][0 if header else 1 :]
    text = {k for cells in first if len(cells) == width for k, cell in enumerate(cells)
            if not holds_number(cell) and cell not in MARKS}  # fmt: skip
    if not (text := (text - set(used)) | set(words)):
        return rows
    emptied = []
    for row in rows:
        cells = split_cells(row, delimiter)
        numbers = ["nan" if k in text else cell for k, cell in enumerate(cells)]
        emptied.append(joined(numbers, delimiter) if len(cells) == width else row)
    return emptied


def parse_numbers(lines: Sequence[str], *, name: str, first_line: int, delimiter: str | None, columns: int) -> Array:
    """Parse lines of text as an array (rows, columns); empty cells and markers of missing values become NaN.

    Parameters
    ----------
    lines : sequence of str
        Rows of the table; blank lines are skipped.
    name : str
        File name, for messages.
    first_line : int
        Line number of ``lines[0]`` in the file, counted from 1, for messages.
    delimiter : str or None
        `None` means any white space. With a semicolon or a tab a comma is a decimal comma.
    columns : int
        Cells that each row must have.

    Returns
    -------
    (rows, columns) array

    Raises
    ------
    InputError
        For a row with another number of cells or a cell that is not a number.
    """
    import pandas as pd

    rows = [(first_line + i, line) for i, line in enumerate(lines) if line.strip()]
    if not rows:
        raise InputError(f"{name} holds no rows of numbers: copy or export it again")
    for number, line in rows:
        count = count_cells(line, delimiter)
        if count != columns:
            raise InputError(_wrong_count(name, number, count, columns, delimiter))
    text = "\n".join(line for _, line in rows)
    decimal = "," if delimiter != "," and "," in text else "."
    if decimal == "," and "." in text:
        raise InputError(f"{name} mixes decimal points and commas: write all numbers one way")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pandas warns about what the error below says better
            frame = pd.read_csv(
                io.StringIO(text), header=None, sep=r"\s+" if delimiter is None else delimiter,
                decimal=decimal, dtype=np.float64, na_values=[*MISSING, *MARKS], keep_default_na=False,
                skipinitialspace=True, float_precision="round_trip", skip_blank_lines=True,
            )  # fmt: skip
        values = frame.to_numpy(dtype=np.float64)
    except (ValueError, OverflowError, pd.errors.ParserError):
        return _parse_slowly(rows, name, delimiter, decimal)
    if values.shape != (len(rows), columns):
        return _parse_slowly(rows, name, delimiter, decimal)
    return np.ascontiguousarray(values)


def read_rows(
    lines: list[str], start: int, delimiter: str | None, name: str, columns: int, used: Collection[int] | None = None
) -> tuple[Array, list[str]]:
    """Parse the rows of a text table from ``lines[start]`` on: return their numbers (rows, columns), and the sentences
    of `judge_end` about the last row. Text is NaN in columns that are not in `used`; None uses all.
    """
    rows, findings = judge_end(lines[start:], delimiter, name)
    rows = rows if used is None else without_text(rows, delimiter, used, columns)
    return parse_numbers(rows, name=name, first_line=start + 1, delimiter=delimiter, columns=columns), findings


def _wrong_count(name: str, number: int, count: int, columns: int, delimiter: str | None) -> str:
    hint = ""
    if delimiter == "," and count > columns:
        hint = "; decimal commas need a semicolon or a tab between the columns"
    elif count < columns:
        hint = "; the file may be truncated"
    return f"line {number} of {name} has {count} cell(s) instead of {columns}{hint}"


def _parse_slowly(rows: Sequence[tuple[int, str]], name: str, delimiter: str | None, decimal: str) -> Array:
    """Parse cell by cell, and raise InputError with the line and cell that is not a number."""
    values = []
    for number, line in rows:
        cells = split_cells(line, delimiter)
        for index, cell in enumerate(cells):
            if cell in MISSING or cell in MARKS:
                values.append(np.nan)
                continue
            text = cell.replace(",", ".") if decimal == "," else cell
            if cell.startswith(("[", "(", "{")) and delimiter is not None and delimiter in cell:
                raise InputError(f"line {number}, cell {index + 1} of {name} holds a list in quotes, {cell[:40]!r}: "
                                 "write one number in each cell")
            if not NUMBER.fullmatch(text):
                remedy = "correct it, or leave the cell empty"
                if re.fullmatch("[A-Za-z_#/<>*.-]{1,20}", cell):
                    remedy = f"if it marks a missing value, state na = [{json.dumps(cell)}] in the mapping"
                raise InputError(f"line {number}, cell {index + 1} of {name} is not a number: {cell[:40]!r}; {remedy}")
            values.append(float(text))
    return np.array(values).reshape(len(rows), -1)
