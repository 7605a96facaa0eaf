"""Torque laws by name, and the conversion of their fit parameters to the coefficients of a chamber.

A polynomial law is one file in this folder. Any other law has a kernel, in a file of `equations`. Other packages can
add polynomial laws by an entry point of the group ``pliant.torque_laws`` that refers to a `TorqueLaw`.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from pliant.equations.law import LawParameter, TorqueLaw
from pliant.equations.laws import LAWS, POLYNOMIAL
from pliant.errors import InputError
from pliant.plugins import offered

Array = np.ndarray
GROUP = "pliant.torque_laws"
BUILT_IN = {"elastic_wall": "pliant.model.elastic_wall:TORQUE_LAW"}


@cache
def torque_laws() -> tuple[TorqueLaw, ...]:
    """Return all known torque laws: the built-in ones, then those that other installed packages provide."""
    others = tuple(offered(GROUP, BUILT_IN, TorqueLaw).values())
    if strange := [law.name for law in others if law.lever is not None]:
        raise InputError(
            f"the torque law {strange[0]!r} of an installed package has a function `lever`, but must be a polynomial: "
            "give its `coefficients`"
        )
    return (*LAWS, *others)


@cache
def law_parameters() -> dict[str, LawParameter]:
    """Return the parameters of all known torque laws, by their names in a fit, such as "saturating_lever"."""
    return {f"{law.name}_{name}": row for law in torque_laws() for name, row in law.parameters.items()}


def laid_torque(values: Mapping[str, float]) -> dict[str, str | Array]:
    """Return the chamber parameters `law` and `torque` for the torque-law parameters among the fit values; {} if there
    are none.

    Raises
    ------
    InputError
        When a parameter of the law is missing, or parameters of two laws are given.
    """
    laws = [law for law in torque_laws() if law.own(values)]
    if not laws:
        return {}
    if len(laws) > 1 or any(n.startswith("torque_") for n in values):
        names = ", ".join((*(f"{law.name}_*" for law in laws), "torque_<k>"))
        raise InputError(f"one chamber has one torque law: leave out all but one of {names}")
    law = laws[0]
    coefficients = law.own(values)
    if missing := [f"{law.name}_{p}" for p in law.parameters if p not in coefficients]:
        raise InputError(
            f"the torque law {law.name!r} needs all of its numbers: {', '.join(missing)} is missing; fit it or give "
            "its value"
        )
    return {"law": law.name if law.lever else POLYNOMIAL, "torque": law.numbers(coefficients)}


def unfinished_law(name: str, wanted: set[str]) -> bool:
    """Return whether the parameter `name` belongs to a torque law that is not fully known yet. The set `wanted` has the
    names of all parameters without a value; the law is not fully known if one of its own is among them.
    """
    return any(law.own({name.rpartition(".")[2]: 0.0}) and law.own(dict.fromkeys(wanted, 0.0)) for law in torque_laws())
