"""Outputs by pressures, period by period: the linear-quadratic regulator.

It makes up for what the estimator finds: shifts of the joints' rest angles, and one factor on all torques.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pliant.control.limits import Limits
from pliant.control.output_design import OutputDesign
from pliant.control.output_gains import Gains
from pliant.control.steady_inputs import output_values, output_weights
from pliant.control.valve_states import ValveObserver
from pliant.estimation.contract import State, chamber_pressures
from pliant.linear.sampled import KILO

Array = np.ndarray


class Present(NamedTuple):
    """The state of one period against what is wanted; N states as `Gains` has them."""

    k: int  # period of the design
    gains: Gains
    turn: Array  # (n + S,) by which angles and strains rest elsewhere than the model's
    more: Array  # (C,) Pa, of the model's torque, that make up for that
    valves: list[Array]  # states of each chamber's valve, Pa and Pa/s
    away: Array  # (N,) from what is wanted


class OutputLqr:
    """The regulator of an `OutputDesign` at work: within its limits, without windup.

    Parameters
    ----------
    design : OutputDesign
    limits : Limits

    Attributes
    ----------
    chambers : int
    target, error : array (m,)
        Wanted change of each output from the body's rest, and how far the output was from it at the last step; m, rad.
    command : array (C,)
        The last one, Pa.
    saturated : int
        Steps whose command met a limit.
    fault : str
        Why the last command is not the one that the law asks for; empty: the regulator always has one.
    """

    fault = ""

    def __init__(self, design: OutputDesign, limits: Limits) -> None:
        self.design, self.limits, self.chambers = design, limits, len(design.model.chambers)
        self._highest, self._reach = limits.each(self.chambers), limits.slew * design.period
        self._weight = output_weights(design.model, design.outputs)
        late = round(design.latency / design.period)
        each = zip(design.model.chambers, design.supply or (None,) * self.chambers, strict=True)
        self._valves = [ValveObserver(c.valve, design.period, late=late, supply=s) for c, s in each]
        self.reset()

    def reset(self) -> None:
        """Start anew from no pressure."""
        self._began, self._integral = math.nan, np.zeros(len(self._weight))
        self.target, self.error = np.zeros(len(self._weight)), np.zeros(len(self._weight))
        self.command, self.saturated = np.zeros(self.chambers), 0
        self._waiting = [np.zeros(most) for most in self.design.waiting]
        for valve in self._valves:
            valve.reset()

    def step(self, time: float, state: State, pressure: float | Array) -> float | Array:
        """Commands (C,) [Pa] for the period that begins at `time` [s], from a state and the readings [Pa]."""
        now = self._present(time, state, pressure)
        wish = self._wish(now, state)
        low, high = np.maximum(self.command - self._reach, 0.0), self.command + self._reach
        self.command = np.clip(wish, low, np.minimum(high, self._highest))
        self.saturated += bool(self._met(wish, low, high).any())
        self._remember(now.gains, wish - self.command)
        return float(self.command[0]) if self.chambers == 1 else self.command.copy()

    def _present(self, time: float, state: State, pressure: float | Array) -> Present:
        """What the state is against what is wanted now."""
        design, scale, n = self.design, state.torque_scale, self.design.model.size
        if math.isnan(self._began):
            self._began = time
        k = round((time - self._began - design.latency) / design.period)
        k = min(max(k, 0), len(design.at) - 1)
        made, seen = design.gains[design.at[k]], self._behind_valves(pressure)
        turn = np.concatenate([np.cumsum(state.rest_shift), state.strain_shift])
        more = -made.inverse @ (self._weight * (made.rest.row[:, :n] @ turn))
        self.target = design.wanted[k]
        full = np.concatenate([
            state.angle, state.strain, state.rate, state.strain_rate,
            scale * np.concatenate([*seen, *self._waiting]) / KILO, self._integral,
        ])  # fmt: skip
        self.error = output_values(design.model, full[:n], design.outputs) - design.still - self.target
        return Present(k, made, turn, more, seen, full - self._rest(k, made, turn, more))

    def _rest(self, k: int, gains: Gains, turn: Array, more: Array) -> Array:
        """The state (N,) that is wanted in period k, its pressures in kPa of the model's torque."""
        design, n = self.design, self.design.model.size
        out = design.resting @ ((design.pressure[k] + more) / KILO)
        out[:n] = design.angle[k] + turn + gains.slope @ more
        out[n : 2 * n] = design.rate[k]
        return np.asarray(out)

    def _behind_valves(self, pressure: float | Array) -> list[Array]:
        """States of each valve, from the last command and the pressures' readings [Pa]."""
        read = np.atleast_1d(chamber_pressures(pressure, self.chambers))
        each = zip(self._valves, self.command, read, strict=True)
        return [valve.update(float(asked), float(seen))[: valve.order] for valve, asked, seen in each]

    def _remember(self, made: Gains, left: Array) -> None:
        """Sum up the error, unless that leads further beyond a limit; put the command on its way. `left` is in Pa."""
        error = made.driven @ (self._weight * self.error)
        far = float(np.linalg.norm(error))
        share = min(1.0, (self.design.tuning.integral_band / far) ** 2) if far > 0 else 1.0
        grown = share * self.design.period * error
        if left @ (made.K[:, -len(error) :] @ grown) >= 0.0:
            self._integral = self._integral + grown
        for waiting, command in zip(self._waiting, self.command, strict=True):
            waiting[1:] = waiting[:-1]
            waiting[:1] = command

    def _met(self, wish: Array, low: Array, high: Array) -> Array:
        """Which commands (C,) met a limit; `low` and `high` (C,) are what the slew limit allows, Pa."""
        del low, high
        return np.asarray(wish != self.command)

    def _wish(self, now: Present, state: State) -> Array:
        """Commands (C,) [Pa] before their limits."""
        design, k = self.design, now.k
        wish = design.pressure[k] + now.more + KILO * (design.lead[k] - now.gains.K @ now.away)
        return np.asarray(wish / state.torque_scale)
