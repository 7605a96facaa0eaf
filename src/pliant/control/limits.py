"""What a command may be: between 0 and the highest pressure, and no faster than the slew limit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError


@dataclass(frozen=True)
class Limits:
    """Limits of the commanded gauge pressure.

    Parameters
    ----------
    highest : float
        Pa. The lowest is 0: there is no vacuum.
    slew : float
        Fastest change, Pa/s; infinite by default.

    Raises
    ------
    InputError
        When a limit is not positive.
    """

    highest: float
    slew: float = float("inf")

    def __post_init__(self) -> None:
        if not (np.isfinite(self.highest) and self.highest > 0 and self.slew > 0):
            raise InputError(
                f"the highest pressure (Pa) and the slew limit (Pa/s) must be positive, got {self.highest}, {self.slew}"
            )

    def __call__(self, command: float, before: float, period: float) -> float:
        """The command nearest to `command` that the limits allow a `period` [s] after `before` [Pa]."""
        reach = self.slew * period
        return min(max(command, 0.0, before - reach), self.highest, before + reach)
