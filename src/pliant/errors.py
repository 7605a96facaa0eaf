"""The exceptions that pliant raises, all derived from `PliantError`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from typing import Any, get_args

from pliant.text import escaped

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
    first = error.errors()[0]
    where = clipped(".".join(str(part) for part in first["loc"])) or "the whole"
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
    similar name, if there is one.
    """
    for part in path[:-1]:  # keys of tables and positions in lists are not fields
        if field := getattr(model, "model_fields", {}).get(part):
            model = next(models_in(field.annotation), None)
    name, known = "".join(map(str, path[-1:]))[:80], list(getattr(model, "model_fields", {}))
    near = [k for k in known if name in k.split("_")] or get_close_matches(name, known, 1)
    return f"use {near[0]!r}, or remove it" if near else "remove it or correct its name"


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
