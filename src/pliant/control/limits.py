"""Limits of the commands of a controller: the range from 0 to the highest pressure or tendon input,
and the slew rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError
from pliant.shapes import Float

Array = np.ndarray


@dataclass(frozen=True)
class Limits:
    """Highest value and slew rate of the commands: gauge pressures [Pa], or tendon inputs [N, m or rad].

    Parameters
    ----------
    highest : float
        Highest command: Pa, of tendons N, m or rad. The lowest is 0, since there is no vacuum and no tendon pushes.
    slew : float
        Fastest change: Pa/s, of tendons N/s, m/s or rad/s; unlimited by default.
    chambers : tuple of float
        Highest command of each of several inputs; `highest` for all by default.

    Raises
    ------
    InputError
        When a limit is not positive, or a chamber's limit exceeds `highest`.
    """

    highest: float
    slew: float = float("inf")
    chambers: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not (np.isfinite(self.highest) and self.highest > 0 and self.slew > 0):
            raise InputError(
                f"the highest pressure (Pa) and the slew limit (Pa/s) must be positive, got {self.highest}, {self.slew}"
            )
        if not all(0 < p <= self.highest for p in self.chambers):
            raise InputError(
                f"the highest pressure of each chamber must be > 0 and <= {self.highest} Pa, got "
                f"{self.chambers}"
            )

    def each(self, count: int) -> Float[Array, " C"]:
        """Return the highest command of each of `count` inputs, as an array (count,) in the inputs' SI units.

        Raises InputError when the limits are given for another number of chambers.
        """
        if len(self.chambers) not in (0, count):
            raise InputError(
                f"the limits have {len(self.chambers)} chambers, the model has {count}: give one limit for each chamber"
            )
        return np.array(self.chambers or (self.highest,) * count, dtype=float)

    def __call__(self, command: float, before: float, period: float) -> float:
        """Return the value nearest to `command` [Pa] that is allowed a `period` [s] after the command `before` [Pa]."""
        reach = self.slew * period
        return min(max(command, 0.0, before - reach), self.highest, before + reach)
