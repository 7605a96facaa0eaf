"""Open questions of a study file: entries that stand as "?" until the user answers them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pliant.errors import InputError

OPEN = "?"


def open_entries(content: Any, where: str = "") -> Iterator[str]:
    """Names of the entries that hold "?", such as ``actuator.mass``."""
    if content == OPEN:
        yield where
    elif isinstance(content, Mapping):
        for name, value in content.items():
            yield from open_entries(value, f"{where}.{name}" if where else str(name))
    elif isinstance(content, list):
        for value in content:
            yield from open_entries(value, where)


def refuse_open(content: Mapping[str, Any], path: Path) -> None:
    """Raise InputError that names every open question of the study file `path`."""
    if found := list(open_entries(content)):
        many = f"{len(found)} open questions" if len(found) > 1 else "one open question"
        raise InputError(f'study {path} has {many}: answer the "?" at {", ".join(found)}')


def refuse_mapping(content: Mapping[str, Any], path: Path) -> None:
    """Raise InputError where the file says what a table's columns mean, and nothing of a study."""
    if {"points", "stations", "length_unit", "pressure", "delimiter"} & set(content) and not {
        "actuator", "recordings"
    } & set(content):
        raise InputError(f"{path} is a mapping, which says what a table's columns mean, and no study: pass it with "
                         f"--mapping, as in pliant order TABLE --mapping {path.name}")  # fmt: skip
