"""Every error that pliant raises on purpose: one root, one clear sentence each."""

from __future__ import annotations

from typing import Any

from pliant.text import escaped


class PliantError(Exception):
    """Root of all errors that pliant raises on purpose.

    The message says what was expected, what came and what to do about it. The command line prints
    it as one sentence and leaves with ``exit_code``: 2 for bad input, 1 for a job that failed.
    It is one printable line, whatever a file that it quotes holds: see `pliant.text.escaped`.

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
        super().__init__(escaped(message, "line"), *more)


class InputError(PliantError, ValueError):
    """A file, an option or an argument is not what it must be."""

    exit_code = 2


class SimulationError(PliantError, ArithmeticError):
    """A simulation cannot go on: the step is too long, or a value stopped being finite."""


class FitError(PliantError):
    """An identification cannot start or did not end in a usable model."""


def explain_validation(error: Any, what: str) -> InputError:
    """One sentence from a pydantic ValidationError: which entry of `what` is wrong, why, and what came."""
    first = error.errors()[0]
    where = clipped(".".join(str(part) for part in first["loc"])) or "the whole"
    more = len(error.errors()) - 1
    came = "" if first["type"] in {"missing", "extra_forbidden"} else f" (got {shown(first['input'])})"
    reason = {
        "missing": "is missing: add it",
        "extra_forbidden": "is not a known entry: remove it or correct its name",
    }.get(first["type"], first["msg"].removeprefix("Value error, ").removeprefix("Input "))
    others = f"; {more} more such problem{'s' * (more > 1)}" if more else ""
    return InputError(f"{what}: '{where}' {reason}{came}{others}")


def clipped(text: str, most: int = 80) -> str:
    """A text for a sentence: in one line, and no longer than one can read."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[: most - 3]}..."


def shown(value: Any, most: int = 60) -> str:
    """A value for a sentence, as Python writes it; only that it is too large or deep where it cannot be written."""
    try:
        return clipped(repr(value), most)
    except (RecursionError, ValueError):  # ValueError: an integer of more digits than Python writes
        return f"a {type(value).__name__} too large to show"
