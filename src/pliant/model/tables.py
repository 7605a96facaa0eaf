"""Tables of files whose entries are the fields of a record: names, types, units, bounds and default values, declared
once on the record.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping
from dataclasses import fields
from typing import Any, ClassVar, NamedTuple, TypeVar, get_origin, get_type_hints

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, create_model, model_validator

from pliant.model.quantity import Quantity, quantities


class Table(BaseModel):
    """A table of a file, in which an unknown entry is an error. The message about an entry that has another name now
    states this name.
    """

    model_config = ConfigDict(extra="forbid", protected_namespaces=())
    renamed: ClassVar[Mapping[str, str]] = {}  # former name of an entry: its present one

    @model_validator(mode="before")
    @classmethod
    def present_names(cls, entries: Any) -> Any:
        """Refuse the former name of an entry."""
        former = next((name for name in cls.renamed if isinstance(entries, Mapping) and name in entries), None)
        if former:
            raise ValueError(f"has no entry {former!r} any more: write {cls.renamed[former]!r}")
        return entries


T = TypeVar("T", bound=Table)
GIVEN: Any = ...  # default value of a field that a file must state


class TableLayout(NamedTuple):
    """Differences between a table and the record that it describes.

    Attributes
    ----------
    needed : collection of str
        Fields that a file must state although the record has a default value. They come first.
    without : collection of str
        Fields that the table lacks.
    defaults : mapping
        Default values in the table, where they are not those of the record.
    optional : bool
        Whether a file may leave out every field, whose value is then None.
    bounded : bool
        Whether the table checks the sign of numbers; otherwise the record does.
    """

    needed: Collection[str] = ()
    without: Collection[str] = ()
    defaults: Mapping[str, Any] = {}
    optional: bool = False
    bounded: bool = False


def fields_of(described: Any, layout: TableLayout = TableLayout(), **kinds: Any) -> Callable[[type[T]], type[T]]:  # noqa: B008
    """Return a decorator that gives a table the fields of the class which it describes, with their default values,
    units and meanings.

    Parameters
    ----------
    described : dataclass or named tuple
    layout : TableLayout
    **kinds
        Types of fields in the file, where they are not those of the class.
    """
    hints, declared = get_type_hints(described), quantities(described)
    defaults = {**dict.fromkeys(layout.needed), **defaults_of(described), **dict.fromkeys(layout.needed, GIVEN)}

    def entry(name: str, default: Any) -> tuple[Any, Any]:
        rows = hints[name] is np.ndarray or get_origin(hints[name]) is tuple
        kind = kinds.get(name, list[float] if rows else hints[name])
        if layout.optional:
            kind, default = kind | None, None
        elif name in layout.defaults:
            default = layout.defaults[name]
        elif dataclasses.is_dataclass(default):
            default = kinds[name]()
        elif isinstance(default, np.ndarray | tuple):
            default = np.array(default).tolist()
        elif rows and default is not GIVEN:
            default = [default]
        return kind, field_of(declared.get(name), default, bounded=layout.bounded and not rows)

    entries: dict[str, Any] = {
        name: entry(name, value) for name, value in defaults.items() if name not in layout.without
    }
    former = {old: name for name, q in declared.items() if name in entries for old in q.formerly}

    def filled(table: type[T]) -> type[T]:
        record = create_model(
            table.__name__, __base__=table, __doc__=table.__doc__, __module__=table.__module__, **entries,
        )
        record.renamed = {**table.renamed, **former}
        return record

    return filled


def field_of(quantity: Quantity | None, default: Any, *, bounded: bool) -> Any:
    """Return the entry of a table for a declared quantity, or its `default` alone where nothing is declared."""
    if quantity is None:
        return default
    limits: dict[str, dict[str, Any]] = {"positive": {"gt": 0}, "not negative": {"ge": 0}, "any": {}}
    signs = limits[quantity.sign] if bounded else {}
    bounds = {"positive": {"exclusiveMinimum": 0.0}, "not negative": {"minimum": 0.0}, "any": {}}[quantity.sign]
    facts: dict[str, Any] = {"unit": quantity.unit} | ({} if quantity.per or bounded else bounds)
    return Field(default, description=quantity.meaning, json_schema_extra=facts, **signs)


def defaults_of(described: Any) -> dict[str, Any]:
    """Return the default values of the fields of a dataclass or named tuple by name; `GIVEN` for those without one."""
    if not dataclasses.is_dataclass(described):
        return {name: described._field_defaults.get(name, GIVEN) for name in described._fields}
    absent = dataclasses.MISSING
    defaults = {f.name: f.default if f.default_factory is absent else f.default_factory() for f in fields(described)}
    return {name: GIVEN if value is absent else value for name, value in defaults.items()}
