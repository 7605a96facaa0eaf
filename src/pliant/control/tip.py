"""The tip's controllers as the loop calls them: set-point in, command out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from pliant.control.feedforward import Feedforward
from pliant.control.limits import Limits
from pliant.control.lqr import Lqr, LqrDesign
from pliant.control.mpc import Mpc
from pliant.control.pid import Pid, PidTuning
from pliant.control.shaping import Shaper
from pliant.control.trajectory import Reference
from pliant.control.valve import SupplyValve
from pliant.control.valve_states import ValveFollower
from pliant.errors import InputError
from pliant.model import Model
from pliant.simulation import state

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


class TipControl:
    """The tip towards a set-point or along a reference, by a feedback of the whole state.

    Parameters
    ----------
    design : LqrDesign
    limits : Limits
    setpoint : callable
        Tip displacement [m] wanted at a time [s].
    estimator : object
        Its `shift` and `scale` are made up for, where it has them.
    late : int
        Periods by which the shape is late.
    reference : Reference, optional
        Followed instead of the set-point, from the first step on.
    supply : SupplyValve, optional
        The rig's valve, where more is known of it than the model holds.
    law : Mpc, optional
        Takes the place of the linear-quadratic feedback; it looks ahead on the reference or the set-point.

    Attributes
    ----------
    target : float
        m, where the tip is wanted now.
    """

    def __init__(
        self, design: LqrDesign, limits: Limits, setpoint: Callable[[float], float], estimator: object = None,
        late: int = 0, reference: Reference | None = None, supply: SupplyValve | None = None, law: Mpc | None = None,
    ) -> None:
        self.law: Lqr | Mpc = law or Lqr(design, limits)
        self.design, self.setpoint, self.target = design, setpoint, 0.0
        self._estimator = estimator
        self._valve = ValveFollower(design.model.valve, design.period, late=late, supply=supply)
        self._rests, self._reference = design.rests, reference
        self.reset()

    @property
    def error(self) -> float:
        """Of the tip along its path at the last step, m."""
        return self.law.error

    @property
    def saturated(self) -> int:
        """Steps whose command met a limit."""
        return self.law.saturated

    def reset(self) -> None:
        """Start anew from no pressure."""
        self.law.reset()
        self._valve.reset()
        self._began = math.nan

    def step(self, time_s: float, angle: Array, rate: Array, pressure: float) -> float:
        """Command [Pa] for the coming period, from the state's estimate and the pressure's reading [Pa]."""
        valve = self._valve.update(self.law.command, pressure)
        shift, scale = getattr(self._estimator, "shift", None), getattr(self._estimator, "scale", 1.0)
        states = valve if self._valve.order else valve[:0]
        if math.isnan(self._began):
            self._began = time_s
        made, since = self._reference, time_s - self._began
        if isinstance(self.law, Mpc):
            ahead = self._wanted(time_s, since, self.law.horizon)
            self.target = self._wanted(time_s, since, [0.0])[0]
            pressure = self._rests.pressure_for(self.target)
            return self.law.step(pressure, angle, rate, states, shift, scale=scale, ahead=ahead)
        if made is None:
            self.target = self.setpoint(time_s)
            return self.law.step(self._rests.pressure_for(self.target), angle, rate, states, shift, scale=scale)
        k = made.at(since)
        self.target = float(made.displacement[k])
        return self.law.step(
            float(made.target[k]), angle, rate, states, shift, scale=scale, lead=made.lead[k],
            lead_tip=self.target - float(made.rest_displacement[k]),
        )

    def _wanted(self, time_s: float, since: float, later: Sequence[float] | Array) -> Array:
        """Displacements (K,) [m] wanted `later` [s] than now."""
        made = self._reference
        if made is None:
            return np.array([self.setpoint(time_s + float(t)) for t in later])
        return np.asarray(made.displacement[[made.at(since + float(t)) for t in later]])


class PidControl:
    """The tip towards a shaped set-point by the static inverse of the model, memory included, and PI-D on what is left.

    Parameters
    ----------
    model : Model
        The body's, with its memory.
    tuning : PidTuning
    limits : Limits
    setpoint : callable
        Tip displacement [m] wanted at a time [s].
    period : float
        s
    shaping : Shaper, optional
        Of the set-point.
    """

    def __init__(
        self, model: Model, tuning: PidTuning, limits: Limits, setpoint: Callable[[float], float], period: float,
        shaping: Shaper | None = None,
    ) -> None:
        self.model, self.setpoint, self.target = model, setpoint, 0.0
        self._impulses = [(1.0, 0.0)] if shaping is None else list(zip(shaping.amplitude, shaping.time, strict=True))
        self.pid, self.forward = Pid(tuning, limits, period), Feedforward(model, limits.highest)
        self._still = self.forward.rests.tip[0]
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
        self._moved = 0.0
        self.pid.start(0.0)
        self.forward.reset()

    def step(self, time_s: float, angle: Array, rate: Array, pressure: float) -> float:
        """Command [Pa] for the coming period; rates and pressure are not used."""
        del rate, pressure
        self.target = float(sum(a * self.setpoint(time_s - t) for a, t in self._impulses))
        self._moved = float(np.linalg.norm(state.tips(self.model, angle)[-1] - self._still))
        return self.pid.step(self.target, self._moved, self.forward.pressure(self.target, self.pid.period))
