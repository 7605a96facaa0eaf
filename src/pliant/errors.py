"""The exceptions that pliant raises, all derived from `PliantError`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from itertools import accumulate
from typing import Any, get_args

from pliant.text import escaped

MOST_LISTED = 220  # characters of the known entries of a table that a message lists
LONGEST = 1000  # characters of a message
HEAD, TAIL = 600, 300  # characters that are kept of a longer one: what is wrong, and what to do


def bounded(message: str) -> str:
    """Return a message of at most `LONGEST` characters: of a longer one, the middle is left out and counted."""
    if len(message) <= LONGEST:
        return message
    return f"{message[:HEAD]} ... ({len(message) - HEAD - TAIL} characters left out) ... {message[-TAIL:]}"


class PliantError(Exception):
    """Base class of all exceptions that pliant raises for bad input or a failed computation.

    The message says what was expected, what was given and what to do. The command line prints
    it as one sentence and exits with ``exit_code``: 2 for bad input, 1 for a job that failed.
    Text that the message quotes from a file is escaped, so that it is always one printable line
    (`pliant.text.escaped`), and the middle of a very long message is left out.

    Examples
    --------
    >>> import pliant
    >>> try:
    ...     pliant.read("absent.csv")
    ... except pliant.PliantError as error:
    ...     print(error)
    cannot read a recording from absent.csv: there is no such file
    """

    exit_code = 1

    def __init__(self, message: object = "", *more: object) -> None:
        super().__init__(bounded(escaped(message, "line")), *more)


class InputError(PliantError, ValueError):
    """Exception for a file, an option or an argument that is not valid."""

    exit_code = 2


class SimulationError(PliantError, ArithmeticError):
    """Exception for a simulation that cannot continue: the time step is too long, or a value is not finite."""


class FitError(PliantError):
    """Exception for a fit that cannot start or does not lead to a usable model."""


@contextmanager
def inside(where: str) -> Iterator[None]:
    """Context manager: if an InputError is raised inside, put `where` and a colon before its message."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def explain_validation(error: Any, what: str, model: Any = None) -> InputError:
    """Return an `InputError` that says which entry of the file or table `what` is wrong, why, and what was given.

    With the pydantic `model` of the file, the message proposes the known entry whose name is most similar to an unknown
    one.
    """
    first = most_telling(error.errors())
    path, _ = table_of(model, first["loc"])
    where = clipped(".".join(path)) or "the whole"
    more = len(error.errors()) - 1
    came = "" if first["type"] in {"missing", "extra_forbidden"} else f" (got {shown(first['input'])})"
    remedy = similar_entry(model, first["loc"]) if first["type"] == "extra_forbidden" else ""
    reason = {
        "missing": "is missing: add it",
        "extra_forbidden": f"is not a known entry: {remedy}",
    }.get(first["type"], first["msg"].removeprefix("Value error, ").removeprefix("Input "))
    others = f"; {more} more such problem{'s' * (more > 1)}" if more else ""
    return InputError(f"{what}: '{where}' {reason}{came}{others}")


def similar_entry(model: Any, path: Sequence[Any]) -> str:
    """Return the remedy for the unknown entry at `path` of a file: the known entry of the same table that has the most
    similar name or, if there is none, all known entries of that table.
    """
    known = known_entries(model, path)
    name = "".join(map(str, path[-1:]))[:80]
    near = [k for k in known if name in k.split("_")] or get_close_matches(name, known, 1)
    if near:
        return f"use {near[0]!r}, or remove it"
    listed = sum(end <= MOST_LISTED for end in accumulate(len(name) + 2 for name in known))
    more = f" and {len(known) - listed} more" if len(known) > listed else ""
    listing = ", ".join(known[:listed]) + more
    return f"remove it, or use one of {listing}" if known else "remove it or correct its name"


def known_entries(model: Any, path: Sequence[Any]) -> list[str]:
    """Return the names of the known entries of the table that holds the entry at `path`, in a file that the pydantic
    `model` describes; the list is empty if the model does not describe that table.
    """
    _, tables = table_of(model, path)
    return list(dict.fromkeys(name for table in tables for name in getattr(table, "model_fields", {})))


def table_of(model: Any, path: Sequence[Any]) -> tuple[list[str], list[Any]]:
    """Return the `path` of an entry as the user writes it, and the pydantic models of the table that holds the entry.

    Where a value may be one of several kinds of table, pydantic adds the name of its class to the path; the returned
    path is without it.
    """
    tables, written = [model], []
    for part in path[:-1]:  # keys of tables and positions in lists are not fields
        fields = [field for table in tables if (field := getattr(table, "model_fields", {}).get(part))]
        of_class = [] if fields else [table for table in tables if getattr(table, "__name__", None) == part]
        if fields:
            tables = [table for field in fields for table in models_in(field.annotation)]
        tables = of_class or tables
        written += [] if of_class else [str(part)]
    return [*written, *map(str, path[-1:])], tables


def most_telling(errors: Sequence[Any]) -> Any:
    """Return the error of pydantic to report: the first one, or the one inside a table if the first says only that this
    table is no plain value.
    """
    first = errors[0]["loc"]
    deeper = [e for e in errors if len(e["loc"]) > len(first) and e["loc"][: len(first) - 1] == first[:-1]]
    return deeper[0] if deeper and first[-1:] in [("bool",), ("float",), ("int",), ("str",)] else errors[0]


def models_in(annotation: Any) -> Iterator[Any]:
    """Yield the pydantic models that an annotation contains, as in ``dict[str, Fit]``."""
    if hasattr(annotation, "model_fields"):
        yield annotation
    for part in get_args(annotation):
        yield from models_in(part)


def clipped(text: str, most: int = 80) -> str:
    """Return `text` on one line of at most `most` characters, with "..." at the end if it is shortened."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[: most - 3]}..."


def shown(value: Any, most: int = 60) -> str:
    """Return the `repr` of `value` in at most `most` characters, or its type if it is too large or deeply nested."""
    try:
        return clipped(repr(value), most)
    except (RecursionError, ValueError):  # ValueError: an integer of more digits than Python writes
        return f"a {type(value).__name__} too large to show"
