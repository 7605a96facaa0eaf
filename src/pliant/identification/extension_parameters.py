"""Fit parameters of extensible segments: ``name`` applies to all segments, ``segment.name`` to one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pliant.equations.spring_terms import SPRING_BOUND, SPRING_TERMS, in_words
from pliant.errors import InputError
from pliant.identification.chamber_parameters import owners
from pliant.model import Extension, Model

# name: (unit, lower, upper, scale, meaning)
ROWS: dict[str, tuple[str, float, float, float, str]] = {
    "axial_stiffness": ("N", 1e-6, np.inf, 0.0, "EA of an extensible segment, force per strain"),
    "axial_damping": ("N s", 0.0, np.inf, 0.0, "force per strain rate of an extensible segment"),
    **{
        f"axial_{name}": ("1", *term.axial, f"{term.letter} of axial springs {in_words(law='EA e')} of the strain e")
        for name, term in SPRING_TERMS.items()
    },
    f"axial_{SPRING_BOUND}": ("1", 1e-3, 0.99, 0.2, "f of them: what s does to the slope at most, in parts of EA"),
    "axial_gain": ("1/m", -1e5, 1e5, 0.0, "axial force of a chamber over its torque; 1 / offset by geometry"),
}
ALWAYS = {"axial_stiffness": "stiffness", "axial_damping": "damping"}
OWN = ALWAYS | {f"axial_{name}": name for name in (*SPRING_TERMS, SPRING_BOUND)}


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
    if single := [name for name in values if re.fullmatch(r"stiffness(_(\d+|\*))?", name)]:
        raise InputError(f"body_stiffness sets the stiffness of all joints: give it or {single[0]}, not both")
    ratio = values["body_stiffness"] / float(model.stiffness[0])
    extensions = tuple(replace(e, stiffness=ratio * e.stiffness) for e in model.extensions)
    return {"stiffness": ratio * model.stiffness} | ({"extensions": extensions} if extensions else {})


def changed_extensions(extensions: Iterable[Extension], values: Mapping[str, float]) -> tuple[Extension, ...]:
    """Return the extensible segments with the parameter `values` applied. ``segment.name`` overrides ``name``."""
    made = []
    for e in extensions:
        own: dict[str, Any] = {field: values[name] for name, field in OWN.items() if name in values}
        own |= {field: values[f"{e.name}.{name}"] for name, field in OWN.items() if f"{e.name}.{name}" in values}
        made.append(replace(e, **own) if own else e)
    return tuple(made)


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
        owner, dot, own = name.partition(".")
        if (own if dot else owner) in ROWS and not mine:
            raise InputError(
                f"parameter {name}: the model has no extensible segment; give it extensions (in a study: "
                "[[actuator.extensions]])"
            )
        if dot and owner in mine and own not in OWN:
            raise InputError(
                f"parameter {name}: {owner!r} is a segment, whose parameters are {', '.join(OWN)}: use one of these"
            )
