"""The tip by the static inverse of the model, its memory included, and PI-D on what is left."""

from __future__ import annotations

import numpy as np

from pliant.control.contract import ControllerKind, Plan
from pliant.control.feedforward import Feedforward
from pliant.control.pid import Pid
from pliant.control.shaping import shaper
from pliant.estimation.adaptive_observer import frozen
from pliant.estimation.contract import State
from pliant.mechanics import mechanics_of
from pliant.simulation import modes

Array = np.ndarray


class PidControl:
    """The tip towards a set-point, shaped (ZVD) where the task is planned.

    Parameters
    ----------
    plan : Plan

    Attributes
    ----------
    pid : Pid
    target : float
        m, where the tip is wanted now.
    """

    chambers, fault = 1, ""  # the law always has a command

    def __init__(self, plan: Plan) -> None:
        self.model, self._setpoint = plan.body, plan.course.setpoint
        self._impulses = [(1.0, 0.0)]
        if plan.task.planned:
            frequency, damping = (float(row[0]) for row in modes(frozen(plan.body, 0.5)))
            made = shaper(frequency, damping, "ZVD")
            self._impulses = list(zip(made.amplitude, made.time, strict=True))
        self.pid = Pid(plan.task.pid, plan.limits, plan.period)
        self.forward = Feedforward(plan.body, plan.limits.highest)
        self._still = self.forward.equilibria.tip[0]
        self.reset()

    @property
    def error(self) -> float:
        """Of the tip's displacement at the last step, m."""
        return self._moved - self.target

    @property
    def saturated(self) -> int:
        """Steps whose command met a limit."""
        return self.pid.saturated

    def reset(self) -> None:
        """Start anew from no pressure."""
        self._moved = self.target = 0.0
        self.pid.start(0.0)
        self.forward.reset()

    def step(self, time: float, state: State, pressure: float | Array) -> float:
        """Command [Pa] for the coming period, from the angles alone."""
        del pressure
        self.target = float(sum(a * self._setpoint(time - t) for a, t in self._impulses))
        self._moved = float(np.linalg.norm(mechanics_of(self.model).tips(state.angle)[-1] - self._still))
        return self.pid.step(self.target, self._moved, self.forward.pressure(self.target, self.pid.period))


CONTROLLER = ControllerKind("pid", PidControl, follows=False, tunable=False)
