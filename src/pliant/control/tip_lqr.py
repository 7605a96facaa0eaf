"""The tip by the linear-quadratic regulator, towards a set-point or along a trajectory."""

from __future__ import annotations

import numpy as np

from pliant.control.contract import ControllerKind, Plan
from pliant.control.lqr import Lqr
from pliant.control.output_control import OutputLqr
from pliant.control.state_feedback import StateFeedback
from pliant.estimation.contract import State

Array = np.ndarray


class LqrControl(StateFeedback[Lqr]):
    """Feedback of the whole state, the valve's included.

    Parameters
    ----------
    plan : Plan
    """

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan, Lqr(plan.design, plan.limits))

    def step(self, time: float, state: State, pressure: float | Array) -> float:
        """Command [Pa] for the coming period, from the state's estimate and the pressure's reading [Pa]."""
        valve = self.valve(pressure)
        since, made = self._course.since(time), self._course.trajectory
        if made is None:
            self.target = self._course.setpoint(time)
            return self.law.step(self._equilibria.pressure_for(self.target), state, valve)
        k = made.at(since)
        self.target = float(made.displacement[k])
        return self.law.step(
            float(made.target[k]), state, valve, lead=made.lead[k],
            lead_tip=self.target - float(made.rest_displacement[k]),
        )


CONTROLLER = ControllerKind("lqr", LqrControl, outputs=lambda design, _task, limits: OutputLqr(design, limits))
