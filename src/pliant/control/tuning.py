"""Limits of the commands, and weights and gains of the linear-quadratic, predictive and PI-D controllers."""

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


@dataclass(frozen=True)
class Tuning:
    """Weights of the linear-quadratic cost of a controller, in units that do not depend on the actuator.

    Parameters
    ----------
    effort : float
        Cost of a command whose static effect is one metre, relative to a tip error of one metre. Smaller is faster.
    damping_time : float
        Time [s] by which the tip's speed is multiplied to count like an error.
    integral_time : float
        Time [s] by which the integral of the tip's error is divided to count like an error. Larger is slower.
    integral_band : float
        Error [m] above which errors are integrated with a reduced weight, so that a step does not wind up the integral.
    """

    effort: float = 0.3
    damping_time: float = 0.09
    integral_time: float = 0.3
    integral_band: float = 5e-4

    def __post_init__(self) -> None:
        if not (self.effort > 0 and self.damping_time >= 0 and self.integral_time > 0):
            raise InputError(f"tuning needs effort > 0, damping_time >= 0 and integral_time > 0, got {self}")


@dataclass(frozen=True)
class MpcTuning:
    """Horizon of the predictive controller: number of nodes (times of free commands) and the time between them.

    The weights are those of `Tuning`.

    Parameters
    ----------
    stage : float
        Time between two nodes of the plan [s], rounded to whole periods. Commands are linear between nodes.
    stages : int
        Number of nodes of the plan, for each chamber.
    """

    stage: float = 0.012
    stages: int = 16

    def __post_init__(self) -> None:
        if not (np.isfinite(self.stage) and self.stage > 0 and self.stages >= 2):
            raise InputError(f"predictive control needs stage > 0 s and stages >= 2, got {self}")


@dataclass(frozen=True)
class PidTuning:
    """Gains of the PI-D controller of the tip displacement, and the cutoff frequency of its derivative.

    Parameters
    ----------
    proportional : float
        Proportional gain [Pa/m].
    integral : float
        Integral gain [Pa/(m s)].
    derivative : float
        Derivative gain [Pa s/m] of the filtered measurement; the set-point is not differentiated.
    cutoff : float
        Cutoff frequency of the derivative's filter [Hz].
    """

    proportional: float
    integral: float
    derivative: float = 0.0
    cutoff: float = 30.0

    def __post_init__(self) -> None:
        if min(self.proportional, self.integral, self.derivative) < 0 or not self.cutoff > 0:
            raise InputError(f"PI-D gains must be >= 0 and the cutoff > 0 Hz, got {self}")
