"""Dataclasses and named tuples as plain values for JSON, and back, by their declared fields."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import fields, is_dataclass
from types import NoneType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

R = TypeVar("R")


def field_names(kind: Any) -> tuple[str, ...]:
    """Return the names of the fields of a dataclass or named tuple, class or instance; () for anything else."""
    names: tuple[str, ...] = getattr(kind, "_fields", ())
    return tuple(f.name for f in fields(kind)) if is_dataclass(kind) else names


def plain(value: Any, but: Collection[str] = ()) -> Any:
    """Return a value as numbers, texts, lists and dicts. A record becomes a dict by the names of its fields, without
    those in `but`; arrays and tuples become lists.
    """
    if names := field_names(value):
        return {name: plain(getattr(value, name)) for name in names if name not in but}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items()}
    return [plain(entry) for entry in value] if isinstance(value, tuple | list) else value


def by_name(records: Iterable[Any]) -> dict[str, Any]:
    """Return records with a field `name` as a table of plain values: the other fields of each, by its name."""
    return {record.name: plain(record, but=("name",)) for record in records}


def record_of(kind: type[R], content: Mapping[str, Any]) -> R:
    """Return the record that `plain` turned into `content`, or that has these values of fields. A field that the
    content lacks has its default value; entries that are no fields are ignored.

    Raises
    ------
    TypeError
        For a value where a record or a sequence is declared, and for a field without value and default.
    """
    if not isinstance(content, Mapping):
        raise TypeError(f"{kind.__name__} needs a table of its fields, got {type(content).__name__}")
    hints = get_type_hints(kind)
    return kind(**{name: value_of(hints[name], content[name]) for name in field_names(kind) if name in content})


def records_of(kind: type[R], table: Mapping[str, Mapping[str, Any]]) -> tuple[R, ...]:
    """Return the records that `by_name` turned into a table."""
    return tuple(record_of(kind, {"name": name, **entry}) for name, entry in table.items())


def value_of(kind: Any, value: Any) -> Any:
    """Return a plain value as the type of a field: a record, an array, a tuple, one of these or None, or as it is."""
    inner = [k for k in get_args(kind) if k not in (NoneType, ...)]
    if get_origin(kind) is tuple:
        if isinstance(value, str | Mapping):
            raise TypeError(f"a sequence is needed, got {type(value).__name__}")
        return tuple(value_of(inner[0], entry) for entry in value)
    if kind is np.ndarray:
        return np.asarray(value)
    if NoneType in get_args(kind):
        return None if value is None else value_of(inner[0], value)
    return value if not field_names(kind) or isinstance(value, kind) else record_of(kind, value)
