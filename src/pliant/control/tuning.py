"""Weights and gains of the linear-quadratic, predictive and PI-D controllers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError


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
