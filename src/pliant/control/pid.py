"""PI-D control of the tip beside a feedforward: derivative of the measurement alone, no windup, bumpless start."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pliant.control.limits import Limits
from pliant.errors import InputError


@dataclass(frozen=True)
class PidTuning:
    """Gains of the PI-D controller.

    Parameters
    ----------
    proportional : float
        Pa/m
    integral : float
        Pa/(m s)
    derivative : float
        Pa s/m, of the filtered measurement, never of the set-point.
    cutoff : float
        Of the derivative's filter, Hz.
    """

    proportional: float
    integral: float
    derivative: float = 0.0
    cutoff: float = 30.0

    def __post_init__(self) -> None:
        if min(self.proportional, self.integral, self.derivative) < 0 or not self.cutoff > 0:
            raise InputError(f"PI-D gains must not be negative and the cutoff positive, got {self}")


class Pid:
    """u = feedforward + P e + I int(e) - D dy/dt, within limits.

    At a limit the integral goes on only where that leads back from it. `start` makes the first command equal to what
    the valve holds already.

    Parameters
    ----------
    tuning : PidTuning
    limits : Limits
    period : float
        s
    """

    def __init__(self, tuning: PidTuning, limits: Limits, period: float) -> None:
        if not (math.isfinite(period) and period > 0):
            raise InputError(f"the period must be positive, in s, got {period}")
        self.tuning, self.limits, self.period = tuning, limits, period
        self._keep = math.exp(-2 * math.pi * tuning.cutoff * period)
        self.start(0.0)

    def start(self, command: float, target: float = 0.0, measured: float = 0.0, feedforward: float = 0.0) -> None:
        """Take over from a `command` [Pa] that holds now: the next command goes on from it without a jump."""
        self.command, self.saturated, self._slope = float(command), 0, 0.0
        self._last: float | None = None
        self.integral = command - feedforward - self.tuning.proportional * (target - measured)

    def step(self, target: float, measured: float, feedforward: float = 0.0) -> float:
        """Command [Pa] for the coming period; target and measured tip displacement in m, feedforward in Pa."""
        error = target - measured
        if self._last is not None:
            self._slope = self._keep * self._slope + (1 - self._keep) * (measured - self._last) / self.period
        self._last = measured
        proposed = self.integral + self.tuning.integral * error * self.period
        fixed = feedforward + self.tuning.proportional * error - self.tuning.derivative * self._slope
        wish = fixed + proposed
        command = self.limits(wish, self.command, self.period)
        if command != wish:
            self.saturated += 1
        if (wish - command) * error <= 0.0:
            self.integral = proposed
        self.command = command
        return command
