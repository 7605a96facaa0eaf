"""What feedback of the whole state shares, whichever law computes the command: the valve's states, the path's error."""

from __future__ import annotations

from typing import Generic, TypeVar

import numpy as np

from pliant.control.contract import Plan
from pliant.control.lqr import Lqr
from pliant.control.mpc import Mpc
from pliant.control.valve_states import ValveObserver
from pliant.estimation.contract import chamber_pressures

Array = np.ndarray
Law = TypeVar("Law", Lqr, Mpc)


class StateFeedback(Generic[Law]):
    """A law on the body's state and the valve's.

    Parameters
    ----------
    plan : Plan
    law : Lqr or Mpc

    Attributes
    ----------
    law : Lqr or Mpc
    target : float
        m, where the tip is wanted now.
    """

    chambers = 1

    def __init__(self, plan: Plan, law: Law) -> None:
        self.law: Law = law
        self.target = 0.0
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
        self.law.reset()
        self._valve.reset()
        self._course.reset()

    def valve(self, pressure: float | Array) -> Array:
        """States of the valve, from the last command and the pressure's reading [Pa]."""
        return self._valve.update(self.law.command, float(chamber_pressures(pressure, 1)))[: self._valve.order]
