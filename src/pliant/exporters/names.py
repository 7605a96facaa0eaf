"""Conversion of the names in a model to valid identifiers, for all export targets."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.text import escaped, identifiers

KINDS = {"station": "stations", "chamber": "chambers", "segment": "extensions"}


def with_identifiers(model: Model) -> Model:
    """Return the model with its own name, and those of its stations, chambers and segments, as valid identifiers.

    Names of one kind remain different from each other. Joints keep their names, ``q_1`` ... ``q_n`` in a plane, and no
    station receives one of them. A model whose names are valid is returned unchanged.
    """
    joints = mechanics_of(model).joint_names[: model.size - len(model.extensions)]
    changes: dict[str, Any] = {"name": escaped(model.name, "identifier")}
    for kind, field in KINDS.items():
        parts = getattr(model, field)
        names = identifiers([part.name for part in parts], joints if kind == "station" else ())
        changes[field] = tuple(
            part if part.name == name else part._replace(name=name) if kind == "station" else replace(part, name=name)
            for part, name in zip(parts, names, strict=True)
        )
    same = all(getattr(model, field) == value for field, value in changes.items())
    return model if same else model.with_(**changes)


def changed_names(model: Model) -> tuple[str, ...]:
    """Return a note for each name that an export changes, such as "station 'a b' is named a_b"."""
    written = with_identifiers(model)
    return tuple(
        f"{kind} {escaped(repr(old.name), 'line')} is named {new.name}" for kind, field in KINDS.items()
        for old, new in zip(getattr(model, field), getattr(written, field), strict=True) if old.name != new.name
    )
