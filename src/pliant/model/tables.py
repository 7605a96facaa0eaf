"""Tables of files whose entries are the fields of a record: its names, types and default values, stated once."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection
from dataclasses import fields
from typing import Any, TypeVar, get_origin, get_type_hints

import numpy as np
from pydantic import BaseModel, ConfigDict, create_model


class Table(BaseModel):
    """A table of a file, in which an unknown entry is an error."""

    model_config = ConfigDict(extra="forbid", protected_namespaces=())


T = TypeVar("T", bound=BaseModel)
GIVEN: Any = ...  # default value of a field that a file must state


def fields_of(
    described: Any, needed: Collection[str] = (), without: Collection[str] = (), **kinds: Any
) -> Callable[[type[T]], type[T]]:
    """Return a decorator that gives a table the fields of the class which it describes, with their default values.

    Parameters
    ----------
    described : dataclass or named tuple
    needed : collection of str
        Fields that a file must state although the class has a default value. They come first.
    without : collection of str
        Fields that the table lacks.
    **kinds
        Types of fields in the file, where they are not those of the class.
    """
    hints = get_type_hints(described)
    defaults = {**dict.fromkeys(needed), **defaults_of(described), **dict.fromkeys(needed, GIVEN)}

    def entry(name: str, default: Any) -> tuple[Any, Any]:
        rows = hints[name] is np.ndarray or get_origin(hints[name]) is tuple
        if dataclasses.is_dataclass(default):
            default = kinds[name]()
        elif isinstance(default, np.ndarray | tuple):
            default = np.array(default).tolist()
        elif rows and default is not GIVEN:
            default = [default]
        return kinds.get(name, list[float] if rows else hints[name]), default

    entries: dict[str, Any] = {name: entry(name, value) for name, value in defaults.items() if name not in without}
    return lambda table: create_model(table.__name__, __base__=table, __doc__=table.__doc__, **entries)


def defaults_of(described: Any) -> dict[str, Any]:
    """Return the default values of the fields of a dataclass or named tuple by name; `GIVEN` for those without one."""
    if not dataclasses.is_dataclass(described):
        return {name: described._field_defaults.get(name, GIVEN) for name in described._fields}
    absent = dataclasses.MISSING
    made = {f.name: f.default if f.default_factory is absent else f.default_factory() for f in fields(described)}
    return {name: GIVEN if value is absent else value for name, value in made.items()}
