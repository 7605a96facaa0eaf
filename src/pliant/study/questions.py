"""Open questions of a study file: entries with the value "?" that the user must replace."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pliant.errors import InputError

OPEN = "?"


def open_entries(content: Any, where: str = "") -> Iterator[str]:
    """Yield the names of the entries that hold "?", such as ``actuator.mass``."""
    if content == OPEN:
        yield where
    elif isinstance(content, Mapping):
        for name, value in content.items():
            yield from open_entries(value, f"{where}.{name}" if where else str(name))
    elif isinstance(content, list):
        for value in content:
            yield from open_entries(value, where)


def refuse_open(content: Mapping[str, Any], path: Path) -> None:
    """Raise InputError with the names of all open questions, if the study file `path` has any."""
    if found := list(open_entries(content)):
        many = f"{len(found)} open questions" if len(found) > 1 else "one open question"
        raise InputError(f'study {path} has {many}: replace the "?" at {", ".join(found)} with values')


def refuse_mapping(content: Mapping[str, Any], path: Path) -> None:
    """Raise InputError if the file is a mapping (the columns and units of a table) instead of a study."""
    if {"points", "stations", "length_unit", "pressure", "delimiter"} & set(content) and not {
        "actuator", "recordings"
    } & set(content):
        raise InputError(f"{path} is a mapping, which describes the columns of a table, not a study: pass it with "
                         f"--mapping, as in pliant order TABLE --mapping {path.name}")  # fmt: skip
