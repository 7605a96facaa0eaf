"""Fit parameters of parts of a model: segments that lengthen, creep and hysteresis, and a chain in space.

A parameter of a segment applies to all segments as ``name``, and to one as ``segment.name``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pliant.errors import InputError
from pliant.identification.chamber_parameters import owners
from pliant.identification.names import path_of, paths
from pliant.mechanics import mechanics_of
from pliant.model import Extension, Memory, Model, Space
from pliant.model.features import named
from pliant.model.memory import branches
from pliant.model.parts import BODY, MEMORY, PAYNE, SEGMENT, SPACE, SPRINGPOT, fitted
from pliant.model.quantity import quantities, scalars

OWN = fitted(SEGMENT)  # name in a fit: field
ALWAYS = {name: field for name, field in OWN.items() if quantities(Extension)[field].start is None}
LAYOUTS = {part.prefix.removesuffix("_"): part for part in (SPRINGPOT, PAYNE)}  # laws that set all branches of a kind
RATIOS = tuple(name for name in scalars(Space) if name in fitted(SPACE))


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


def usual_start(name: str) -> float | None:
    """Return the default start value of a creep, hysteresis, lag or valve-limit parameter; None for any other name.

    Branches of one kind get different start values, since a fit could not separate equal ones.
    """
    path = path_of(name)
    return path.quantity.start_of(path.number if path.quantity.per == "branch" else 1)


def chamber_guess(highest: float) -> dict[str, float]:
    """Return the start value of the wall limit as {"inflation_limit": Pa}: twice the `highest`
    recorded pressure [Pa].
    """
    return {"inflation_limit": 2.0 * highest}


def laid_out(values: Mapping[str, float]) -> dict[str, Any]:
    """Return the creep branches that approximate a springpot and the slip branches that approximate Payne's curve, for
    the parameters in `values`. The result is a dict of fields of the model's hysteresis and creep.
    """
    entries: dict[str, Any] = {}
    for law, part in LAYOUTS.items():
        fields = tuple(quantities(part.record))
        stated = {field: values[f"{law}_{field}"] for field in fields if f"{law}_{field}" in values}
        if not stated.keys() - {"low", "high"}:
            continue
        if missing := [f"{law}_{field}" for field in fields if field not in stated]:
            raise InputError(
                f"{law}_* needs all of its {len(fields)} parameters: {', '.join(missing)} is missing; "
                "add what is missing"
            )
        laid = {n: row for n, row in part.record(**stated)._asdict().items() if n in quantities(Memory)}
        if any(path.field in laid and not path.owner for _, path in paths(values, MEMORY)):
            kind = next(iter(laid)).partition("_")[0]
            raise InputError(f"{law}_* sets all {kind} branches itself: leave out either {law}_* or {kind}_*")
        entries |= laid
    return entries


def memory_changes(model: Model, values: Mapping[str, float], cache: dict[Any, Any]) -> dict[str, Any]:
    """Return the changes that `values` make to a model's creep and hysteresis, as a dict for `Model.with_`. They are
    kept in `cache`, and taken from there where the same values were applied before.
    """
    stated = {name: values[name] for name, path in paths(values, MEMORY, SPRINGPOT, PAYNE) if not path.owner}
    key = (Memory, *stated.items())
    if key not in cache:
        cache[key] = changed_memory(model, stated)
    return dict(cache[key])


def changed_memory(model: Model, values: Mapping[str, float]) -> dict[str, Any]:
    """Return the changes that the parameters of creep and hysteresis in `values` make to a model."""
    named = [(name, path) for name, path in paths(values, MEMORY) if not path.owner]
    entries: dict[str, Any] = {path.field: values[name] for name, path in named if not path.numbers} | laid_out(values)
    for kind, fields in branches().items():
        for field in fields:
            row = list(entries.get(field, getattr(model.memory, field)))
            by_number = {path.number: values[name] for name, path in named if path.field == field}
            for j in sorted(by_number):
                if j > len(row) + 1:
                    raise InputError(f"parameter {field}_{j}: number the branches 1, 2, ... without a gap")
                row[j - 1 :] = [by_number[j], *row[j:]]
            if by_number:
                entries[field] = tuple(row)
        lengths = [len(entries.get(field, getattr(model.memory, field))) for field in fields]
        if len(set(lengths)) > 1:
            raise InputError(
                f"each {kind} branch needs a {fields[0]}_<j> and a {fields[1]}_<j>: "
                f"there are {lengths[0]} and {lengths[1]}; add the missing ones"
            )
    return {"memory": replace(model.memory, **entries)} if entries else {}


def changed_space(model: Model, values: Mapping[str, float]) -> Space | None:
    """Return the model's data for motion in space with the parameter `values` applied; the same object if unchanged."""
    space = model.space
    changes: dict[str, Any] = {}
    for name, path in paths(values, SPACE):
        if path.owner:
            continue
        if not path.numbers:
            changes[path.field] = values[name]
        elif path.quantity.per == "axis":
            changes.setdefault(path.field, np.zeros(3) if space is None else getattr(space, path.field).copy())
            changes[path.field]["xyz".index(path.numbers[0])] = values[name]
        else:
            changes.setdefault(path.field, np.zeros((model.n, 3)) if space is None else space.rest_of(model.n))
            changes[path.field][path.number - 1, "xyz".index(path.numbers[0])] = values[name]
    if not changes:
        return space
    if space is None:
        raise InputError(f"the parameter {min(changes)} needs a chain in space, and this model is planar: "
                         "leave it out, or make the model spatial with space = Space()")  # fmt: skip
    return replace(space, **changes)


def space_start(model: Model) -> dict[str, float]:
    """Return start values, by name, of the parameters of a chain in space, from the model; {} for a planar model."""
    space = model.space
    if space is None:
        return {}
    turns = {f"rest_turn_{axis}_{i + 1}": float(v) for i, row in enumerate(space.rest_of(model.n))
             for axis, v in zip("xyz", row, strict=True)}  # fmt: skip
    ratios = {"stiffness_ratio": space.stiffness_ratio, "twist_ratio": space.twist_ratio}
    return {**ratios, **mechanics_of(model).base_values, **turns}


def check_space_names(names: Iterable[str], model: Model) -> None:
    """Raise InputError for spatial parameters in a planar model, planar ones in a spatial model, or a twist ratio of a
    chain that cannot twist.
    """
    moves = "in a plane" if mechanics_of(model).dimension == 2 else "in space"
    for name in names:
        path = path_of(name)
        needed = "in space" if path.part is SPACE else path.quantity.only
        if needed not in ("", moves):
            raise InputError(f"parameter {name} needs a chain {needed}, but the model {model.name!r} is {moves}: leave "
                             "it out")  # fmt: skip
        if path.stem == "twist_ratio" and not named(model, ("twist",)):
            raise InputError("parameter twist_ratio: this chain cannot twist; give the model a twist_ratio first")
