"""Read a table that pandas stored in HDF5 (layouts "table" and "fixed") from plain arrays, without pandas.

pandas and PyTables store column names as pickles, which are programs that rebuild Python objects. This module never
runs a pickle: `plain_value` parses texts, numbers, tuples, lists and dicts from a pickle of protocol 0, which PyTables
writes, and refuses every other instruction.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pliant.errors import InputError, clipped
from pliant.recording.arrays import texts

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

LARGEST_TABLE = 10_000  # columns: DeepLabCut's largest projects have some hundreds
MARK = object()


class StoredFrame(NamedTuple):
    """Table that pandas stored in HDF5: the names of its C columns (one text for each level of the header), the index
    number of each of its T rows (T,), and its values (T, C).
    """

    levels: tuple[str, ...]
    columns: list[tuple[str, ...]]
    rows: NDArray
    values: NDArray


def read_frame(stored: Mapping[str, NDArray], facts: Mapping[str, Any], file: str) -> StoredFrame:
    """Return the only pandas table among the arrays of an HDF5 file.

    Raises
    ------
    InputError
        When there is no table or several, the table is damaged, or its column names are pickles of other than text and
        numbers.
    """
    kinds = {path: attributes.get("pandas_type") for path, attributes in facts["groups"].items()}
    tables = [path for path, kind in kinds.items() if kind in ("frame", "frame_table")]
    if len(tables) != 1:
        raise InputError(f"{file} is not a DeepLabCut file: it holds {len(tables)} pandas tables instead of one; "
                         "export one table per file")
    arrays = {path: stored[key] for path, (key, _, _) in facts["variables"].items()}
    attributes = {path: attributes for path, (_, _, attributes) in facts["variables"].items()} | facts["groups"]
    build = _table if kinds[tables[0]] == "frame_table" else _fixed
    try:
        frame = build(arrays, attributes, tables[0])
    except InputError as error:
        raise InputError(f"{file} cannot be read as a DeepLabCut file: {error}") from None
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, StopIteration) as error:
        reason = f"lacks {error}" if isinstance(error, KeyError) else clipped(str(error), 200)
        raise InputError(f"{file} cannot be read as a DeepLabCut file; it may be damaged: {reason}; export CSV "
                         "instead") from None
    if frame.values.shape != (len(frame.rows), len(frame.columns)):
        raise InputError(f"{file} is damaged: it has {len(frame.columns)} column names, but values of shape "
                         f"{frame.values.shape}; export CSV instead")
    return frame


def _table(arrays: Mapping[str, NDArray], attributes: Mapping[str, Any], at: str) -> StoredFrame:
    """Return a table of layout "table", whose rows have the columns ``index`` and ``values_block_0``, ..."""
    about, rows = attributes[at], attributes[f"{at}/table:index"]
    axis, order = plain_value(about["non_index_axes"])[0]
    levels = tuple(str(name) for name in plain_value(about["info"])[axis]["names"])
    blocks = [str(name) for name in plain_value(about["values_cols"])]
    names: list[tuple[str, ...]] = []
    parts = []
    for block in blocks:
        names += _columns(plain_value(rows[f"{block}_kind"]), len(levels))
        parts.append(_numbers(arrays[f"{at}/table:{block}"]))
    columns = _columns(order, len(levels))
    if set(names) != set(columns) or not len(names) == len(set(names)) == len(columns):
        raise ValueError("its column names differ between its two lists, or repeat")
    return _joined(levels, columns, arrays[f"{at}/table:index"], names, parts)


def _fixed(arrays: Mapping[str, NDArray], attributes: Mapping[str, Any], at: str) -> StoredFrame:
    """Return a table of layout "fixed": ``axis0`` names columns, ``axis1`` rows, ``block0_items`` a block's columns."""
    levels, columns = _axis(arrays, attributes, at, "axis0")
    names: list[tuple[str, ...]] = []
    parts = []
    for k in range(int(attributes[at]["nblocks"])):
        names += _axis(arrays, attributes, at, f"block{k}_items")[1]
        parts.append(_numbers(arrays[f"{at}/block{k}_values"]))
    return _joined(levels, columns, arrays[f"{at}/axis1"], names, parts)


def _joined(
    levels: tuple[str, ...], columns: list[tuple[str, ...]], rows: NDArray, names: list[tuple[str, ...]],
    parts: list[NDArray],
) -> StoredFrame:
    """Return the table whose columns `names` are stored in `parts`, in the order of `columns`."""
    values = np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)
    column_of = {name: k for k, name in enumerate(names)}
    if not len(column_of) == len(names) == values.shape[1]:
        raise ValueError(f"{len(names)} names for {values.shape[1]} columns, or names that repeat")
    return StoredFrame(levels, columns, _numbers(rows), values[:, [column_of[c] for c in columns]])


def _axis(
    arrays: Mapping[str, NDArray], attributes: Mapping[str, Any], at: str, axis: str
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the level names and the entries of an axis, decoded from texts per level and codes per entry."""
    count = int(attributes[at][f"{axis}_nlevels"])
    if not 0 < count < 10:
        raise ValueError(f"its columns have {count} levels")
    names = [texts(arrays[f"{at}/{axis}_level{k}"]) for k in range(count)]
    codes = [arrays[f"{at}/{axis}_label{k}"].ravel() for k in range(count)]
    if any(c.dtype.kind not in "iu" or c.min(initial=0) < 0 or c.max(initial=-1) >= len(t)
           for c, t in zip(codes, names, strict=True)):  # fmt: skip
        raise ValueError("a column has no name")
    entries = [tuple(t[int(c)] for c, t in zip(row, names, strict=True)) for row in zip(*codes, strict=True)]
    if len(entries) > LARGEST_TABLE:
        raise ValueError(f"it has {len(entries)} columns, more than any tracker writes")
    return tuple(str(attributes[f"{at}/{axis}_level{k}"].get("name", "")) for k in range(count)), entries


def _columns(value: Any, levels: int) -> list[tuple[str, ...]]:
    if not isinstance(value, list) or len(value) > LARGEST_TABLE:
        raise TypeError("its column names are not a list, or are more than any tracker writes")
    if not all(isinstance(c, tuple) and len(c) == levels and all(isinstance(n, (str, int)) for n in c) for c in value):
        raise TypeError(f"a column name does not consist of {levels} texts")
    return [tuple(map(str, column)) for column in value]


def _numbers(values: NDArray) -> NDArray:
    if values.dtype.kind not in "iuf":
        raise TypeError(f"numbers are {values.dtype}")
    return values.astype(np.float64)


def plain_value(text: str) -> Any:
    """Decode a pickle of protocol 0 that holds only text, numbers, tuples, lists and dicts, without running any code in
    it.

    Raises
    ------
    InputError
        When the pickle holds any other instruction, such as one that imports or calls a function.
    """
    stack: list[Any] = []
    known: dict[str, Any] = {}
    position = 0
    while position < len(text):
        code, position = text[position], position + 1
        if code == ".":
            return _only(stack)
        line = ""
        if code in "VIpg":
            end = text.find("\n", position)
            line, position = text[position : end if end >= 0 else len(text)], (end if end >= 0 else len(text)) + 1
        _step(code, line, stack, known)
    raise ValueError("a list of names is truncated")


def _only(stack: Sequence[Any]) -> Any:
    if len(stack) != 1 or stack[0] is MARK:
        raise ValueError("a list of names is damaged")
    return stack[0]


def _step(code: str, line: str, stack: list[Any], known: dict[str, Any]) -> None:
    """Process one instruction of a pickle: push a value on the stack, or collect values from it."""
    if code == "(":
        stack.append(MARK)
    elif code == "V":
        stack.append(line.encode("latin-1", "backslashreplace").decode("raw_unicode_escape"))
    elif code == "I":
        stack.append(int(line[:20]))
    elif code == "N":
        stack.append(None)
    elif code == "p":
        known[line] = stack[-1]
    elif code == "g":
        stack.append(known[line])
    elif code in "ltd":
        mark = len(stack) - 1 - next(k for k, value in enumerate(reversed(stack)) if value is MARK)
        items = stack[mark + 1 :]
        del stack[mark:]
        pairs = zip(items[::2], items[1::2], strict=True) if code == "d" else ()
        stack.append(dict(pairs) if code == "d" else tuple(items) if code == "t" else items)
    elif code == "a":
        item = stack.pop()
        stack[-1].append(item)
    elif code == "s":
        item, key = stack.pop(), stack.pop()
        stack[-1][key] = item
    else:
        raise InputError(f"its column names are a pickle that holds more than text and numbers (instruction {code!r}); "
                         "it could run a program and is therefore not read; export CSV instead")  # fmt: skip
