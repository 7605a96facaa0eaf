"""Fit parameters of creep and hysteresis: start values, and their use in a model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pliant.errors import InputError
from pliant.identification.names import path_of, paths
from pliant.model import Memory, Model
from pliant.model.memory import branches
from pliant.model.parts import MEMORY, PAYNE, SPRINGPOT
from pliant.model.quantity import quantities

LAYOUTS = {part.prefix.removesuffix("_"): part for part in (SPRINGPOT, PAYNE)}  # laws that set all branches of a kind


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


def memory_changes(model: Model, values: Mapping[str, float]) -> dict[str, Any]:
    """Return the changes that `values` make to a model's creep and hysteresis, as a dict for `Model.with_`."""
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
