"""The tip by the linear-quadratic regulator, towards a set-point or along a trajectory."""

from __future__ import annotations

import numpy as np

from pliant.control.contract import ControllerKind, Plan
from pliant.control.lqr import Lqr
from pliant.control.output_control import OutputLqr
from pliant.control.valve_states import ValveObserver
from pliant.estimation.contract import State, chamber_pressures

Array = np.ndarray


class LqrControl:
    """Feedback of the whole state, the valve's included.

    Parameters
    ----------
    plan : Plan

    Attributes
    ----------
    law : Lqr
    target : float
        m, where the tip is wanted now.
    """

    chambers, fault = 1, ""  # the law always has a command

    def __init__(self, plan: Plan) -> None:
        self.law = Lqr(plan.design, plan.limits)
        self._course, self._equilibria = plan.course, plan.design.equilibria
        self._valve = ValveObserver(plan.design.model.valve, plan.period, late=plan.late, supply=plan.supply)
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
        self.target = 0.0
        self.law.reset()
        self._valve.reset()
        self._course.reset()

    def step(self, time: float, state: State, pressure: float | Array) -> float:
        """Command [Pa] for the coming period, from the state's estimate and the pressure's reading [Pa]."""
        reading = float(chamber_pressures(pressure, 1))
        valve = self._valve.update(self.law.command, reading)[: self._valve.order]
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
