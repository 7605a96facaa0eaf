"""What a torque law is: a few numbers with a meaning, and the torque that they make of a pressure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray


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
    coefficients : callable or None
        Of a polynomial: of the parameters by their names the coefficients (k,) of pressure, pressure^2, ...
        [N m/Pa^i], at most 16.
    start : callable
        Where a fit begins: of pressures (T,) [Pa] and torques (T,) [N m] at rest, a value for each parameter.
    scale : str
        The parameter that multiplies the whole torque.
    lever : callable, optional
        Kernel of a law that is no polynomial: its torque for each pascal [N m/Pa], of a pressure p [Pa] and the
        parameters a (k,) in their order, which a chamber holds as `torque`.
    """

    name: str
    parameters: Mapping[str, LawParameter]
    coefficients: Callable[..., Array] | None
    start: Callable[[Array, Array], Mapping[str, float]]
    scale: str
    lever: Callable[[Any, Any], Any] | None = None

    def scaling(self) -> str:
        """What a fit calls the parameter that multiplies the whole torque."""
        return f"{self.name}_{self.scale}"

    def numbers(self, values: Mapping[str, float]) -> Array:
        """What a chamber holds as `torque` for `values` of all parameters, by the law's own names."""
        own = [values[p] for p in self.parameters] if self.coefficients is None else self.coefficients(**values)
        return np.asarray(own, dtype=float)

    def own(self, values: Mapping[str, float]) -> dict[str, float]:
        """The parameters of the law among `values`, by the law's own names."""
        return {p: values[f"{self.name}_{p}"] for p in self.parameters if f"{self.name}_{p}" in values}
