"""Conversion of a control task to a reference for every period, and to the regulator that follows it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pliant.control.design import LqrDesign, design_outputs
from pliant.control.steady_inputs import Equilibria, equilibria
from pliant.control.tuning import Limits, MpcTuning, Tuning
from pliant.control.valve import SupplyValve
from pliant.errors import InputError
from pliant.estimation.adaptive_observer import frozen
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.shapes import Float

Array = np.ndarray
TIP = ("tip_x", "tip_y")


class SetPoint:
    """Target displacement of the tip as a function of time: constant levels joined by half-cosine ramps.

    Parameters
    ----------
    time, displacement : array (k,)
        Times [s] and the displacement [m] from each time on; 0 before the first.
    ramp : float
        Duration of a change [s].
    """

    def __init__(self, time: Array, displacement: Array, ramp: float = 0.03) -> None:
        self.time, self.level = np.asarray(time, dtype=float), np.asarray(displacement, dtype=float)
        if self.time.ndim != 1 or self.time.shape != self.level.shape or self.time.size == 0:
            raise InputError(
                "a set-point needs one displacement (m) for each time (s), got displacements of shape "
                f"{self.level.shape} and times of shape {self.time.shape}"
            )
        if not np.isfinite(self.time).all() or np.any(np.diff(self.time) <= 0):
            raise InputError("the times of a set-point must increase: sort them, and state each time once")
        if not np.isfinite(self.level).all():
            raise InputError(f"the displacements of a set-point must be finite (m), got {self.level}")
        if not ramp >= 0:
            raise InputError(f"the ramp of a set-point must be >= 0 s, got {ramp:g}")
        self.ramp = ramp

    def __call__(self, time: float) -> float:
        """Return the target displacement [m] at a time [s]."""
        k = int(np.searchsorted(self.time, time, side="right")) - 1
        if k < 0:
            return 0.0
        before = float(self.level[k - 1]) if k else 0.0
        done = 1.0 if self.ramp == 0 else min(1.0, (time - float(self.time[k])) / self.ramp)
        return before + (float(self.level[k]) - before) * 0.5 * (1.0 - math.cos(math.pi * done))


@dataclass(frozen=True)
class Task:
    """A control task: the motion that the tip or other outputs should follow, and the controller to use.

    Parameters
    ----------
    time, displacement : array (k,)
        Times [s] and the target displacement of the tip [m] from each time on, or at each time if `path` is True. With
        several chambers (k, m): changes of the outputs from rest [m, rad].
    duration : float
        Duration [s].
    path : bool
        Whether the target moves linearly between the times.
    ramp : float
        Duration of a change that is not planned [s].
    planned : bool
        Whether set-points change at once, so that the motion is as fast as the limits allow, and the controller looks
        ahead along a path.
    feedback : str
        Name of the controller: "lqr", "mpc", or one that an installed package provides.
    tuning, mpc : Tuning, MpcTuning
    outputs : tuple of str
        Outputs that several chambers control: names among tip_x, tip_y [m] and angle_sum [rad], the angle of the last
        link; in space among tip_x, tip_y and tip_z.
    """

    time: Float[Array, " P"]
    displacement: Float[Array, " P"]
    duration: float
    path: bool = False
    ramp: float = 0.03
    planned: bool = True
    feedback: str = "lqr"
    tuning: Tuning = field(default_factory=Tuning)
    mpc: MpcTuning = field(default_factory=MpcTuning)
    outputs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Plan:
    """Everything from which a controller is created: task, model, limits, timing and valves.

    Attributes
    ----------
    task : Task
    body : Model
        Calibrated model, with its hysteresis and the mean of the rig's valves.
    limits : Limits
    period, latency : float
        Control period, and age of the state at the command [s].
    supply : tuple of SupplyValve or None
        The rig's valve of each chamber; None to use the model's.
    """

    task: Task
    body: Model
    limits: Limits
    period: float
    latency: float
    supply: tuple[SupplyValve | None, ...]

    @property
    def several(self) -> bool:
        """Whether the task controls named outputs, such as tip coordinates. If not, it controls the tip
        displacement by one chamber.

        It is True for several inputs, for a body that lengthens and for one in space.
        """
        return self.body.actuation.count > 1 or mechanics_of(self.body).lengthens or self.body.space is not None

    @cached_property
    def family(self) -> Equilibria:
        """Static equilibria of the actuator without hysteresis, at pressures from 0 to the limit, for one chamber.

        Raises InputError for a task with several outputs.
        """
        if self.task.outputs or np.ndim(self.task.displacement) != 1:
            raise InputError(
                "a task for a body of one chamber must give displacements of the tip (displacement_mm in a task file)"
            )
        return equilibria(frozen(self.body), float(self.limits.each(1)[0]))

    @property
    def levels(self) -> Array:
        """Target values (k, m) of m outputs [m or rad] at the k times of the task.

        Raises InputError when they do not fit the body.
        """
        task, levels = self.task, np.asarray(self.task.displacement, dtype=float)
        if not self.several:
            return levels[:, None] if self.family else levels
        if not task.outputs or levels.ndim != 2 or levels.shape[1] != len(task.outputs):
            several = f"has several chambers ({self.body.actuation.listing})" if self.body.actuation.count > 1 else None
            why = several or ("is in space" if self.body.space else "lengthens")
            raise InputError(
                f"model {self.body.name!r} {why}, so its task must name outputs and give a value of each (tip_x_mm, "
                "tip_y_mm, tip_z_mm, angle_deg in a task file)"
            )
        return levels

    @property
    def ramp(self) -> float:
        """Duration of a change between set-points [s]."""
        return 0.0 if self.task.planned else self.task.ramp

    def wanted_at(self, times: Array) -> Array:
        """Return the reference (K, m) of m outputs [m, rad] at K times [s]."""
        task = self.task
        if task.path:
            return np.stack([np.interp(times, task.time, column) for column in self.levels.T], axis=1)
        points = [SetPoint(task.time, column, self.ramp) for column in self.levels.T]
        return np.array([[point(float(t)) for point in points] for t in times])

    @cached_property
    def rows(self) -> Array:
        """Reference (K, m) of m outputs [m, rad] for each of K control periods; after the end the last one is kept."""
        task = self.task
        last = task.duration if task.path else max(task.duration, float(np.max(task.time)) + self.ramp)
        return self.wanted_at(np.arange(max(round(last / self.period), 1) + 1) * self.period)

    @cached_property
    def design(self) -> LqrDesign:
        """The linear-quadratic regulator that makes the outputs follow the task's reference."""
        task, outputs, rows = self.task, self.task.outputs, self.rows
        if not self.several:
            outputs, rows = TIP, self.family.moved(rows[:, 0])
        design = design_outputs(
            frozen(self.body), outputs, rows, self.limits, self.period, tuning=task.tuning, latency=self.latency,
            path=task.path and task.planned,
        )
        if self.several:
            return replace(design, supply=self.supply)
        way = np.array([self.family.at(p)[2] for p in design.pressure[:, 0]])
        return replace(design, supply=self.supply, along=(self.rows[:, 0], way))
