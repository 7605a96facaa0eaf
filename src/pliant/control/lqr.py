"""Linear-quadratic regulator that controls outputs, such as the tip position, by pressures in each period.

It compensates what the estimator identifies: shifts of the joints' rest angles, and a common factor of all torques.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from pliant.compiler.choose import twin
from pliant.control import feedback_loops
from pliant.control.contract import ControllerKind
from pliant.control.design import Gains, LqrDesign
from pliant.control.steady_inputs import output_weights, tip_geometry
from pliant.control.tuning import Limits
from pliant.control.valve import ValveObserver
from pliant.estimation.contract import State
from pliant.mechanics import mechanics_of

Array = np.ndarray


class Lqr:
    """Linear-quadratic controller: applies the regulator of an `LqrDesign` within limits of pressure and slew rate,
    with anti-windup.

    Parameters
    ----------
    design : LqrDesign
    limits : Limits

    Attributes
    ----------
    chambers : int
    target, error : array (m,) or float
        Target of each output, as change from the body's rest, and its error at the last step [m, rad]. For one chamber:
        target of the tip's displacement, and the tip's error along its path [m].
    command : array (C,)
        The last command [Pa].
    saturated : int
        Number of steps in which a limit changed the command.
    fault : str
        Always empty: the regulator always has a command.
    """

    fault = ""

    def __init__(self, design: LqrDesign, limits: Limits) -> None:
        self.design, self.limits, self.chambers = design, limits, design.model.actuation.count
        self._highest, self._reach = limits.each(self.chambers), limits.slew * design.period
        self._weight = output_weights(design.model, design.outputs)
        late = round(design.latency / design.period)
        each = zip(design.model.chambers, design.supply or (None,) * self.chambers, strict=True)
        self._valves = [ValveObserver(c.valve, design.period, late=late, supply=s) for c, s in each]
        self._rules = (
            self._highest, float(self._reach), float(design.tuning.integral_band), float(design.period), self._weight,
            np.array(design.waiting),
        )
        self._geometry = tip_geometry(design.model, design.outputs)
        self._tables = [
            (g.K, g.slope, g.inverse, g.driven, np.ascontiguousarray(g.rest.row[:, : design.model.size]))
            for g in design.gains
        ]
        self._look = twin(feedback_loops.look, *mechanics_of(design.model).sizes)
        self._finish = twin(feedback_loops.finish)
        self.reset()

    def reset(self) -> None:
        """Reset the controller to its initial state, in which the commanded pressures are zero."""
        design, m, C, ends = self.design, len(self._weight), self.chambers, np.cumsum(self.design.waiting)
        self._began, self.saturated, self.period = math.nan, 0, 0
        self.command, self._integral, self._off = np.zeros(C), np.zeros(m), np.zeros(m)
        queue, orders = np.zeros(sum(design.waiting)), np.cumsum((0, *design.orders))
        self._waiting = np.split(queue, ends[:-1])
        self._behind = np.zeros(orders[-1])
        self._parts = [self._behind[a:b] for a, b in pairwise(orders)]
        self._turn, self._more, self._wishes = np.zeros(design.model.size), np.zeros(C), np.zeros(C)
        away = np.zeros(design.gains[0].A.shape[0])
        self._memory = (queue, self._integral, self.command, self._off, self._turn, self._more, away, self._wishes)
        for valve in self._valves:
            valve.reset()

    @property
    def target(self) -> float | Array:
        """Present target. For a controller of the tip displacement by one chamber, this is that displacement [m].
        For a controller of m outputs it is their change from rest (m,), such as of a tip coordinate [m] or angle [rad].
        """
        along = self.design.along
        return self.design.wanted[self.period].copy() if along is None else float(along[0][self.period])

    @property
    def error(self) -> float | Array:
        """Control error at the last step, actual value minus target. For a controller of the tip displacement by one
        chamber, this is one error [m]. For a controller of m outputs it is the error of each (m,) [m or rad].
        """
        along = self.design.along
        return self._off.copy() if along is None else float(along[1][self.period] @ self._off)

    def step(self, time: float, state: State, pressure: float | Array) -> Array:
        """Return the commands (C,) [Pa] of C chambers for the period that starts at `time` [s], from the estimated
        state and the pressure readings (C,) [Pa].
        """
        self._present(time, state, pressure)
        self._wish(state)
        met = self._finish(self._tables[self.design.at[self.period]], self._rules, self._memory)
        self.saturated += bool(self._met(bool(met)))
        return self.command.copy()

    @property
    def _gains(self) -> Gains:
        """Gains of the present period."""
        return self.design.gains[self.design.at[self.period]]

    def _present(self, time: float, state: State, pressure: float | Array) -> None:
        """Write the deviation of the state from the present reference to the workspace: the shift of the rest shape
        from the model's (n + S,) to `_turn`, the pressures [Pa] that compensate it, in terms of the model's torque, to
        `_more`, and the unlimited commands to `_wishes`.
        """
        design = self.design
        if math.isnan(self._began):
            self._began = time
        k = self.period = min(max(round((time - self._began) / design.period) - design.late, 0), len(design.at) - 1)
        read = design.model.actuation.pressures(pressure).tolist()
        for valve, part, sent, reading in zip(self._valves, self._parts, self.command.tolist(), read, strict=True):
            part[:] = valve.update(sent, reading)[: valve.order]
        row = (design.pressure[k], design.lead[k], design.angle[k], design.beside[k], design.wanted[k], design.still)
        known = (
            state.angle, state.rate, state.rest_shift, state.strain, state.strain_rate, state.strain_shift,
            float(state.torque_scale), self._behind,
        )  # fmt: skip
        self._look(self._tables[design.at[k]], row, self._geometry, known, self._rules, design.resting, self._memory)

    def _wish(self, state: State) -> None:
        """Write the commands (C,) [Pa] before their limits to `_wishes`. Here `_present` has done so already."""

    def _met(self, met: bool) -> bool:
        """Return whether a limit changed the command; `met` is the result of the limits."""
        return met


CONTROLLER = ControllerKind("lqr", lambda plan: Lqr(plan.design, plan.limits))
