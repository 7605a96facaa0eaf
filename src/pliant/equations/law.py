"""Interface of a torque law, which gives the joint torque as a function of pressure: its parameters and functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray


class LawParameter(NamedTuple):
    """One parameter of a torque law: its unit, bounds, typical size and meaning, in SI units."""

    unit: str
    lower: float
    upper: float
    scale: float  # a typical size; 0: the value at the start of a fit
    meaning: str


@dataclass(frozen=True)
class TorqueLaw:
    """A torque law: joint torque as a function of the chamber's pressure, with its parameters.

    Attributes
    ----------
    name : str
        In a fit the parameters of the law are called ``NAME_parameter``.
    parameters : dict of str to LawParameter
    coefficients : callable or None
        For a polynomial law: a function which takes the parameters as keyword arguments and returns the coefficients
        (k,) of pressure, pressure^2, ... [N m/Pa^i], at most 16. None for a law with a `lever`.
    start : callable
        Starting values of a fit: takes pressures (T,) [Pa] and torques (T,) [N m] at rest, and returns a value for each
        parameter.
    scale : str
        The parameter that multiplies the whole torque.
    lever : callable, optional
        Kernel of a law that is not a polynomial: takes a pressure p [Pa] and the parameters a (k,) in their order, and
        returns the torque per pascal [N m/Pa]. A chamber holds these parameters as `torque`.
    """

    name: str
    parameters: Mapping[str, LawParameter]
    coefficients: Callable[..., Array] | None
    start: Callable[[Array, Array], Mapping[str, float]]
    scale: str
    lever: Callable[[Any, Any], Any] | None = None

    def scaling(self) -> str:
        """Return the name of the fit parameter that multiplies the whole torque of this law, for example
        ``saturating_lever``.
        """
        return f"{self.name}_{self.scale}"

    def numbers(self, values: Mapping[str, float]) -> Array:
        """Return the coefficients (k,) that a chamber of this torque law stores as `torque`, from the parameter values.

        These are the coefficients of a polynomial law, else the parameters in their order. `values` uses the law's own
        names.
        """
        factors = [values[p] for p in self.parameters] if self.coefficients is None else self.coefficients(**values)
        return np.asarray(factors, dtype=float)

    def own(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the parameters of this torque law from all parameter values of a fit, without the law's name as a
        prefix.
        """
        return {p: values[f"{self.name}_{p}"] for p in self.parameters if f"{self.name}_{p}" in values}
