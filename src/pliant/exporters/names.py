"""A model whose names are identifiers: what every exporter writes, whatever the model file says."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.text import escaped, identifiers

KINDS = {"station": "stations", "chamber": "chambers", "segment": "extensions"}


def with_identifiers(model: Model) -> Model:
    """Return the model with identifiers for its own name and those of stations, chambers and segments.

    Names of one kind stay different from each other; joints keep their names, ``q_1`` ... ``q_n`` in a plane, so no
    station takes one. A model whose names are identifiers comes back unchanged.
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
    """Return a note for each name that an export writes differently, such as ``station 'a b' is named a_b``."""
    written = with_identifiers(model)
    return tuple(
        f"{kind} {escaped(repr(old.name), 'line')} is named {new.name}" for kind, field in KINDS.items()
        for old, new in zip(getattr(model, field), getattr(written, field), strict=True) if old.name != new.name
    )
