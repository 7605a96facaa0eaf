"""Limits of a command: between 0 and the highest pressure, or tension, and no faster than the slew limit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError

Array = np.ndarray


@dataclass(frozen=True)
class Limits:
    """Limits of the commands: gauge pressures, or what tendons take, in the SI unit of the input.

    Parameters
    ----------
    highest : float
        Pa; of tendons N, m or rad. The lowest is 0: there is no vacuum, and no tendon pushes.
    slew : float
        Fastest change, Pa/s; of tendons N/s, m/s or rad/s. Infinite by default.
    chambers : tuple of float
        Highest command of each of several inputs; `highest` for all by default.

    Raises
    ------
    InputError
        When a limit is not positive, or one of a chamber above `highest`.
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
                f"the highest pressures of chambers must lie above 0 and not above {self.highest} Pa, got "
                f"{self.chambers}"
            )

    def each(self, count: int) -> Array:
        """Highest pressure (C,) of each of `count` chambers, Pa; InputError where the limits name others than these."""
        if len(self.chambers) not in (0, count):
            raise InputError(f"the limits name {len(self.chambers)} chambers, the model has {count}")
        return np.array(self.chambers or (self.highest,) * count, dtype=float)

    def __call__(self, command: float, before: float, period: float) -> float:
        """The command nearest to `command` that the limits allow a `period` [s] after `before` [Pa]."""
        reach = self.slew * period
        return min(max(command, 0.0, before - reach), self.highest, before + reach)
