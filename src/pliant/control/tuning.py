"""Weights and gains of the controllers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError


@dataclass(frozen=True)
class Tuning:
    """Weights of the quadratic cost, in units that mean the same for every body.

    Parameters
    ----------
    effort : float
        Cost of the command whose static effect is one metre, relative to a tip error of one metre. Smaller is faster.
    damping_time : float
        s; the tip's speed times this counts like an error.
    integral_time : float
        s; the integral of the tip's error over this counts like an error. Larger is slower.
    integral_band : float
        m; larger errors count less in the integral, by the square of their ratio, so that a step does not wind it up.
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
    """Horizon of the predictive control; its weights are those of the regulator, `Tuning`.

    Parameters
    ----------
    stage : float
        Time between two nodes of the plan, s; commands are straight between them. Rounded to whole periods.
    stages : int
        Nodes of the plan, for each chamber.
    """

    stage: float = 0.012
    stages: int = 16

    def __post_init__(self) -> None:
        if not (np.isfinite(self.stage) and self.stage > 0 and self.stages >= 2):
            raise InputError(f"predictive control needs a stage > 0 s and two stages or more, got {self}")


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
