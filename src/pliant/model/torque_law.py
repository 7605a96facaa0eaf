"""Torque laws by name: a few numbers with a meaning lay the coefficients of pressure that the kernels take.

The kernels know one form, the polynomial of `equations.section.torque`; a law that can be written so is one file here.
Another package adds one by an entry point of the group ``pliant.torque_laws`` that leads to a `TorqueLaw`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.plugins import offered

Array = np.ndarray
GROUP = "pliant.torque_laws"
BUILT_IN = {"elastic_wall": "pliant.model.elastic_wall:TORQUE_LAW"}


class LawParameter(NamedTuple):
    """One number of a law, SI."""

    unit: str
    lower: float
    upper: float
    scale: float  # a typical size; 0: from where a fit begins
    meaning: str


@dataclass(frozen=True)
class TorqueLaw:
    """A law of few numbers.

    Attributes
    ----------
    name : str
        A fit calls its parameters ``NAME_parameter``.
    parameters : dict of str to LawParameter
    coefficients : callable
        Of the parameters by their names: coefficients (k,) of pressure, pressure^2, ... [N m/Pa^i], at most 16.
    start : callable
        Where a fit begins: of pressures (T,) [Pa] and torques (T,) [N m] at rest, a value for each parameter.
    scale : str
        The parameter that multiplies the whole torque.
    """

    name: str
    parameters: Mapping[str, LawParameter]
    coefficients: Callable[..., Array]
    start: Callable[[Array, Array], Mapping[str, float]]
    scale: str

    @property
    def scaling(self) -> str:
        """What a fit calls the parameter that multiplies the whole torque."""
        return f"{self.name}_{self.scale}"

    def own(self, values: Mapping[str, float]) -> dict[str, float]:
        """The parameters of the law among `values`, by the law's own names."""
        return {p: values[f"{self.name}_{p}"] for p in self.parameters if f"{self.name}_{p}" in values}


@cache
def torque_laws() -> tuple[TorqueLaw, ...]:
    """All known laws: the built-in ones first, then those of installed packages."""
    return tuple(offered(GROUP, BUILT_IN, TorqueLaw).values())


@cache
def law_parameters() -> dict[str, LawParameter]:
    """The parameters of all known laws by the names that a fit uses."""
    return {f"{law.name}_{name}": row for law in torque_laws() for name, row in law.parameters.items()}


def laid_torque(values: Mapping[str, float]) -> Array | None:
    """Coefficients of the torque law whose parameters are among `values`; None where there is none.

    Raises
    ------
    InputError
        When one of its parameters is missing, or two laws are given.
    """
    laws = [law for law in torque_laws() if law.own(values)]
    if not laws:
        return None
    if len(laws) > 1 or any(n.startswith("torque_") for n in values):
        names = ", ".join((*(f"{law.name}_*" for law in laws), "torque_<k>"))
        raise InputError(f"one chamber has one torque law: leave out all but one of {names}")
    law = laws[0]
    own = law.own(values)
    if missing := [f"{law.name}_{p}" for p in law.parameters if p not in own]:
        raise InputError(f"the torque law {law.name!r} needs all of its numbers: {', '.join(missing)} is missing")
    return np.asarray(law.coefficients(**own), dtype=float)


def unfinished_law(name: str, wanted: set[str]) -> bool:
    """Whether the parameter `name` is of a law of which another one, among `wanted`, has no value yet."""
    return any(law.own({name.rpartition(".")[2]: 0.0}) and law.own(dict.fromkeys(wanted, 0.0)) for law in torque_laws())
