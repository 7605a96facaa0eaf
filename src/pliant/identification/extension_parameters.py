"""Fit parameters of extensible segments: ``name`` applies to all segments, ``segment.name`` to one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from pliant.errors import InputError
from pliant.identification.chamber_parameters import owners
from pliant.identification.names import paths
from pliant.model import Extension, Model
from pliant.model.parts import BODY, SEGMENT, fitted
from pliant.model.quantity import quantities

OWN = fitted(SEGMENT)  # name in a fit: field
ALWAYS = {name: field for name, field in OWN.items() if quantities(Extension)[field].start is None}


def segments(model: Model) -> tuple[str, ...]:
    """Return the names of the model's extensible segments, as used before the dot of a parameter name."""
    return tuple(e.name for e in model.extensions)


def stiffened(model: Model, values: Mapping[str, float]) -> dict[str, Any]:
    """Return the stiffnesses of joints and extensible segments as a dict of changes to the model. All are scaled by one
    factor, which gives the first joint the value of "body_stiffness". Return {} if `values` lacks this parameter.

    The ratios between the joints' stiffnesses and the axial stiffnesses stay as they are. This fits one modulus of a
    body whose geometry is known.
    """
    if "body_stiffness" not in values:
        return {}
    if single := [name for name, path in paths(values, BODY) if path.field == "stiffness" and not path.owner]:
        raise InputError(f"body_stiffness sets the stiffness of all joints: give it or {single[0]}, not both")
    ratio = values["body_stiffness"] / float(model.stiffness[0])
    extensions = tuple(replace(e, stiffness=ratio * e.stiffness) for e in model.extensions)
    return {"stiffness": ratio * model.stiffness} | ({"extensions": extensions} if extensions else {})


def changed_extensions(extensions: Iterable[Extension], values: Mapping[str, float]) -> tuple[Extension, ...]:
    """Return the extensible segments with the parameter `values` applied. ``segment.name`` overrides ``name``."""
    changed = []
    for e in extensions:
        changes: dict[str, Any] = {field: values[name] for name, field in OWN.items() if name in values}
        changes |= {field: values[f"{e.name}.{name}"] for name, field in OWN.items() if f"{e.name}.{name}" in values}
        changed.append(replace(e, **changes) if changes else e)
    return tuple(changed)


def check_segment_names(names: Iterable[str], model: Model, others: set[str]) -> None:
    """Raise InputError for a segment parameter that the model does not have, or for a segment named like a recording,
    station or chamber.
    """
    mine = segments(model)
    if both := set(mine) & (others | set(owners(model))):
        raise InputError(
            f"{min(both)!r} names a segment and a recording, station or chamber, so that the owner of its parameters "
            "is not clear: rename one of the two"
        )
    for name in names:
        owner, dot, parameter = name.partition(".")
        if (parameter if dot else owner) in (*OWN, "axial_gain") and not mine:
            raise InputError(
                f"parameter {name}: the model has no extensible segment; give it extensions (in a study: "
                "[[actuator.extensions]])"
            )
        if dot and owner in mine and parameter not in OWN:
            raise InputError(
                f"parameter {name}: {owner!r} is a segment, whose parameters are {', '.join(OWN)}: use one of these"
            )
