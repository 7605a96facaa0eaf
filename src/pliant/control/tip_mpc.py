"""The tip by predictive control, which looks ahead on the trajectory or the set-point."""

from __future__ import annotations

import numpy as np

from pliant.control.contract import ControllerKind, Plan
from pliant.control.mpc import Mpc
from pliant.control.output_control import OutputMpc
from pliant.control.state_feedback import StateFeedback
from pliant.estimation.adaptive_observer import frozen
from pliant.estimation.contract import State

Array = np.ndarray


class MpcControl(StateFeedback[Mpc]):
    """One quadratic program a period, on the model that the estimator corrects.

    Parameters
    ----------
    plan : Plan

    Raises
    ------
    InputError
        When the extra ``mpc`` is missing.
    """

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan, Mpc(
            frozen(plan.body), plan.limits, plan.period, tuning=plan.task.mpc, latency=plan.late * plan.period,
            supply=plan.supply,
        ))

    def step(self, time: float, state: State, pressure: float | Array) -> float:
        """Command [Pa] for the coming period, from the state's estimate and the pressure's reading [Pa]."""
        valve = self.valve(pressure)
        ahead = self._course.wanted(time, self.law.horizon)
        self.target = float(self._course.wanted(time, [0.0])[0])
        return self.law.step(self._equilibria.pressure_for(self.target), state, valve, ahead=ahead)


CONTROLLER = ControllerKind(
    "mpc", MpcControl, outputs=lambda design, task, limits: OutputMpc(design, limits, task.mpc.stages)
)
