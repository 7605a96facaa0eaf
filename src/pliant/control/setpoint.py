"""What is wanted of the tip: levels and paths against time, or a trajectory that was planned."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pliant.control.trajectory import Trajectory
from pliant.errors import InputError

Array = np.ndarray


class SetPoint:
    """Tip displacement against time: levels joined by half a cosine, or a path of points.

    Parameters
    ----------
    time, displacement : array (k,)
        s and m: from each time on that level, starting from 0.
    ramp : float
        Time that a change takes, s.
    """

    def __init__(self, time: Array, displacement: Array, ramp: float = 0.03) -> None:
        self.time, self.level = np.asarray(time, dtype=float), np.asarray(displacement, dtype=float)
        good = self.time.ndim == 1 and self.time.shape == self.level.shape and self.time.size > 0
        if not good or np.any(np.diff(self.time) <= 0) or not np.isfinite(self.level).all() or ramp < 0:
            raise InputError("a set-point needs increasing times (s), as many finite levels (m), and a ramp >= 0 s")
        self.ramp = ramp

    def __call__(self, time: float) -> float:
        """Displacement wanted at a time, m."""
        k = int(np.searchsorted(self.time, time, side="right")) - 1
        if k < 0:
            return 0.0
        before = float(self.level[k - 1]) if k else 0.0
        done = 1.0 if self.ramp == 0 else min(1.0, (time - float(self.time[k])) / self.ramp)
        return before + (float(self.level[k]) - before) * 0.5 * (1.0 - math.cos(math.pi * done))


class Course:
    """A set-point, or the trajectory that is followed instead of it, from the first step on.

    Parameters
    ----------
    setpoint : callable
        Tip displacement [m] wanted at a time [s].
    trajectory : Trajectory, optional
    """

    def __init__(self, setpoint: Callable[[float], float], trajectory: Trajectory | None = None) -> None:
        self.setpoint, self.trajectory = setpoint, trajectory
        self.reset()

    def reset(self) -> None:
        """The next time is the first one."""
        self._began = math.nan

    def since(self, time: float) -> float:
        """Time [s] since the first step."""
        if math.isnan(self._began):
            self._began = time
        return time - self._began
