"""The tip by predictive control, which looks ahead on the trajectory or the set-point."""

from __future__ import annotations

import numpy as np

from pliant.control.contract import ControllerKind, Plan
from pliant.control.mpc import Mpc
from pliant.control.valve_states import ValveObserver
from pliant.estimation.adaptive_observer import frozen
from pliant.estimation.contract import State, one_chamber

Array = np.ndarray


class MpcControl:
    """One quadratic program a period, on the model that the estimator corrects.

    Parameters
    ----------
    plan : Plan

    Attributes
    ----------
    law : Mpc
    target : float
        m, where the tip is wanted now.

    Raises
    ------
    InputError
        When the extra ``mpc`` is missing.
    """

    chambers = 1

    def __init__(self, plan: Plan) -> None:
        self.law = Mpc(
            frozen(plan.body), plan.limits, plan.period, tuning=plan.task.mpc, latency=plan.late * plan.period,
            supply=plan.supply,
        )
        self.target, self._course, self._equilibria = 0.0, plan.course, plan.design.equilibria
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
        self.law.reset()
        self._valve.reset()
        self._course.reset()

    def step(self, time: float, state: State, pressure: float | Array) -> float:
        """Command [Pa] for the coming period, from the state's estimate and the pressure's reading [Pa]."""
        valve = self._valve.update(self.law.command, one_chamber(pressure))[: self._valve.order]
        ahead = self._course.wanted(time, self.law.horizon)
        self.target = float(self._course.wanted(time, [0.0])[0])
        return self.law.step(self._equilibria.pressure_for(self.target), state, valve, ahead=ahead)


CONTROLLER = ControllerKind("mpc", MpcControl)
