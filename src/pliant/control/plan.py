"""Conversion of a control task to a reference for every period, and to the regulator that follows it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pliant.control.design import LqrDesign, design_outputs
from pliant.control.steady_inputs import Equilibria, equilibria
from pliant.control.trajectory import Planner, Trajectory
from pliant.control.tuning import Limits, MpcTuning, PidTuning, Tuning
from pliant.control.valve import SupplyValve
from pliant.errors import InputError
from pliant.estimation.adaptive_observer import frozen
from pliant.linear.sampled import KILO
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
        Whether changes are planned ahead, as fast as the limits allow; for "pid": shaped (ZVD).
    feedback : str
        Name of the controller: "lqr", "mpc", "pid", or one that an installed package provides.
    tuning, mpc, pid : Tuning, MpcTuning, PidTuning
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
    pid: PidTuning = field(default_factory=lambda: PidTuning(0.0, 4e6))
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
    trajectory : Trajectory or None
        Planned motion of the tip, for one chamber.
    follows : str
        What the controller uses of the trajectory, see `ControllerKind`.
    """

    task: Task
    body: Model
    limits: Limits
    period: float
    latency: float
    supply: tuple[SupplyValve | None, ...]
    trajectory: Trajectory | None = None
    follows: str = "trajectory"

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

    def setpoint(self, time: float) -> float:
        """Return the target displacement [m] of the tip at a time [s], for a task of one chamber."""
        return float(self.wanted_at(np.array([time]))[0, 0])

    def wanted_at(self, times: Array) -> Array:
        """Return the reference (K, m) of m outputs [m, rad] at K times [s]."""
        task = self.task
        if task.path:
            return np.stack([np.interp(times, task.time, column) for column in self.levels.T], axis=1)
        points = [SetPoint(task.time, column, task.ramp) for column in self.levels.T]
        return np.array([[point(float(t)) for point in points] for t in times])

    @cached_property
    def rows(self) -> Array:
        """Reference (K, m) of m outputs [m, rad] for each of K control periods; after the end the last one is kept."""
        task = self.task
        last = task.duration if task.path else max(task.duration, float(np.max(task.time)) + task.ramp)
        return self.wanted_at(np.arange(max(round(last / self.period), 1) + 1) * self.period)

    def planned(self) -> Trajectory | None:
        """Return a planned trajectory of the tip within the limits, or None if the task needs none. If the task states
        a path, the tip follows it. Otherwise it moves as fast as possible to each set-point.
        """
        task = self.task
        if self.several or not task.planned or self.follows == "levels":
            return None
        planner = Planner(self.body, self.family, self.limits, self.period, latency=self.latency, valve=self.supply[0])
        if task.path:
            return planner.path(self.wanted_at(np.arange(round(task.duration / self.period)) * self.period)[:, 0])
        return planner.steps(task.time, self.levels[:, 0], task.duration)

    @cached_property
    def design(self) -> LqrDesign:
        """The linear-quadratic regulator that makes the outputs follow the task's reference."""
        if self.several:
            return self.designed(self.task.outputs, self.rows, path=self.task.path and self.task.planned)
        trajectory, family, late = self.trajectory, self.family, round(self.latency / self.period)
        far = self.rows[:, 0] if trajectory is None else trajectory.displacement
        if trajectory is not None and self.follows == "path":  # the reference is delayed as the shape is
            far = np.append(far[late:], np.full(late, far[-1]))
        far = np.clip(far, 0.0, family.reach) if trajectory is not None else far
        moves = trajectory is not None and self.follows == "path"
        levels = far if trajectory is None or moves else trajectory.wanted
        design = self.designed(TIP, family.moved(levels), path=moves)
        way = np.array([family.at(p)[2] for p in design.pressure[:, 0]])
        design = replace(design, along=(far, way))
        if trajectory is None or moves:
            return design
        beside, sent = design.beside.copy(), 2 * self.body.n
        beside[:, : trajectory.lead.shape[1] - 1] = trajectory.lead[:, :-1]
        beside[:, sent:] /= KILO
        return replace(design, wanted=family.moved(far), beside=beside, lead=trajectory.lead[:, -1:] / KILO, late=0)

    def designed(self, outputs: tuple[str, ...], rows: Array, *, path: bool) -> LqrDesign:
        """Return the linear-quadratic regulator of the named `outputs` along the reference `rows` (K, m), given as
        changes from rest.
        """
        design = design_outputs(
            frozen(self.body), outputs, rows, self.limits, self.period, tuning=self.task.tuning, latency=self.latency,
            path=path,
        )
        return replace(design, supply=self.supply)
