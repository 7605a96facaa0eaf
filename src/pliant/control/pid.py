"""PI-D control of the tip beside a feedforward: derivative of the measurement alone, no windup, bumpless start."""

from __future__ import annotations

import math

import numpy as np

from pliant.control.contract import ControllerKind
from pliant.control.feedforward import Feedforward
from pliant.control.limits import Limits
from pliant.control.plan import Plan
from pliant.control.shaping import shaper
from pliant.control.tuning import PidTuning
from pliant.errors import InputError
from pliant.estimation.adaptive_observer import frozen
from pliant.estimation.contract import State
from pliant.mechanics import mechanics_of
from pliant.simulation import modes

Array = np.ndarray


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
        self.model, self._setpoint = plan.body, plan.setpoint
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
        """Return the error of the tip's displacement at the last step, m."""
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

    def step(self, time: float, state: State, pressure: float | Array) -> Array:
        """Command (1,) [Pa] for the coming period, from the angles alone."""
        del pressure
        self.target = float(sum(a * self._setpoint(time - t) for a, t in self._impulses))
        self._moved = float(np.linalg.norm(mechanics_of(self.model).tips(state.angle)[-1] - self._still))
        feedforward = self.forward.pressure(self.target, self.pid.period)
        return np.array([self.pid.step(self.target, self._moved, feedforward)])


CONTROLLER = ControllerKind("pid", PidControl, follows="levels", tunable=False, several=False)
