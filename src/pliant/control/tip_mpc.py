"""The tip by predictive control: of one chamber its displacement, of several the outputs that are wanted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pliant.control.contract import ControllerKind, Plan
from pliant.control.mpc import Mpc
from pliant.control.output_design import OutputDesign, design_outputs
from pliant.estimation.adaptive_observer import frozen
from pliant.estimation.contract import State

Array = np.ndarray
TIP = ("tip_x", "tip_y")


class TipMpc:
    """`Mpc` of one chamber: the tip on its path of rests, towards a set-point or along a trajectory.

    Parameters
    ----------
    plan : Plan

    Attributes
    ----------
    law : Mpc
    target, error : float
        m, displacement of the tip that is wanted now, and how far along its path it was from there at the last step.

    Raises
    ------
    InputError
        When OSQP is missing.
    """

    chambers = 1

    def __init__(self, plan: Plan) -> None:
        self._displacement = displacements(plan)
        design = tip_design(plan, self._displacement)
        family = plan.design.equilibria
        self._way = [family.at(p)[2] for p in design.pressure[:, 0]]
        self.law = Mpc(design, plan.limits, plan.task.mpc)
        self.reset()

    def reset(self) -> None:
        """Start anew from no pressure."""
        self.target = self.error = 0.0
        self.law.reset()

    @property
    def saturated(self) -> int:
        """Steps whose command met a limit."""
        return self.law.saturated

    @property
    def failed(self) -> int:
        """Periods whose quadratic program was not solved."""
        return self.law.failed

    @property
    def fault(self) -> str:
        """Why the last command is that of an earlier plan; empty where it is not."""
        return self.law.fault

    def step(self, time: float, state: State, pressure: float | Array) -> float | Array:
        """Command [Pa] for the coming period, from the state's estimate and the pressure's reading [Pa]."""
        command = self.law.step(time, state, pressure)
        k = self.law.period
        self.target, self.error = float(self._displacement[k]), float(self._way[k] @ self.law.error)
        return command


def displacements(plan: Plan) -> Array:
    """Displacement (K,) [m] that is wanted of the tip period by period, by the time of the state."""
    task, made = plan.task, plan.course.trajectory
    if made is not None:  # its rows are as late as the shape is
        wanted = np.append(made.displacement[plan.late :], np.full(plan.late, made.displacement[-1]))
        return np.clip(wanted, 0.0, plan.design.equilibria.reach)
    last = task.duration if task.path else max(task.duration, float(np.max(task.time)) + task.ramp)
    return np.array([plan.course.setpoint(k * plan.period) for k in range(max(round(last / plan.period), 1) + 1)])


def tip_design(plan: Plan, displacement: Array) -> OutputDesign:
    """The design of both coordinates of the tip, whose one driven combination is its way along the path of rests."""
    family = plan.design.equilibria
    tips = np.array([family.at(family.pressure_for(float(d)))[1] for d in displacement])
    made = design_outputs(
        frozen(plan.body), TIP, tips - family.tip[0], plan.limits, plan.period, tuning=plan.task.tuning,
        latency=plan.late * plan.period, path=plan.course.trajectory is not None,
    )
    return replace(made, supply=(plan.supply,))


CONTROLLER = ControllerKind(
    "mpc", TipMpc, outputs=lambda design, task, limits: Mpc(design, limits, task.mpc)
)
