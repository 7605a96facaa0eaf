"""Several outputs by several pressures, period by period: the linear-quadratic regulator, and predictive control.

Both make up for what the estimator finds: shifts of the joints' rest angles, and one factor on all torques.
"""

from __future__ import annotations

import math

import numpy as np

from pliant.control.bounded_least_squares import bounded_least_squares
from pliant.control.limits import Limits
from pliant.control.output_design import OutputDesign
from pliant.control.output_gains import Gains
from pliant.control.steady_inputs import output_values, output_weights
from pliant.control.valve_states import ValveObserver
from pliant.estimation.contract import State, chamber_pressures
from pliant.linear.sampled import KILO

Array = np.ndarray


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
    """

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
        design, scale, n = self.design, state.torque_scale, self.design.model.size
        if math.isnan(self._began):
            self._began = time
        k = round((time - self._began - design.latency) / design.period)
        k = min(max(k, 0), len(design.at) - 1)
        made, seen = design.gains[design.at[k]], self._behind_valves(pressure)
        turn = np.concatenate([np.cumsum(state.rest_shift), state.strain_shift])
        more = -made.inverse @ (self._weight * (made.rest.row[:, :n] @ turn))
        hold = design.pressure[k] + more
        self.target = design.wanted[k]
        away = np.concatenate([
            state.angle, state.strain, state.rate, state.strain_rate,
            scale * np.concatenate([*seen, *self._waiting]) / KILO, self._integral,
        ])  # fmt: skip
        self.error = output_values(design.model, away[:n], design.outputs) - design.still - self.target
        away[:n] = away[:n] - design.angle[k] - turn - made.slope @ more
        away[n : 2 * n] -= design.rate[k]
        away -= design.resting @ (hold / KILO)
        wish = self._wish(k, away, hold / KILO, scale) * KILO / scale
        before = self.command
        low, high = np.maximum(before - self._reach, 0.0), np.minimum(before + self._reach, self._highest)
        self.command = np.clip(wish, np.minimum(low, high), high)
        self._remember(made, wish - self.command)
        return float(self.command[0]) if self.chambers == 1 else self.command.copy()

    def _behind_valves(self, pressure: float | Array) -> list[Array]:
        """States of each valve, from the last command and the pressures' readings [Pa]."""
        read = np.atleast_1d(chamber_pressures(pressure, self.chambers))
        each = zip(self._valves, self.command, read, strict=True)
        return [valve.update(float(asked), float(seen))[: valve.order] for valve, asked, seen in each]

    def _remember(self, made: Gains, left: Array) -> None:
        """Sum up the error, unless that leads further beyond a limit; put the command on its way. `left` is in Pa."""
        self.saturated += bool(left.any())
        error = made.driven @ (self._weight * self.error)
        far = float(np.linalg.norm(error))
        share = min(1.0, (self.design.tuning.integral_band / far) ** 2) if far > 0 else 1.0
        grown = share * self.design.period * error
        if left @ (made.K[:, -len(error) :] @ grown) >= 0.0:
            self._integral = self._integral + grown
        for waiting, command in zip(self._waiting, self.command, strict=True):
            waiting[1:] = waiting[:-1]
            waiting[:1] = command

    def _wish(self, k: int, away: Array, hold: Array, scale: float) -> Array:
        """Command (C,) before its limits, in kPa of the model's torque; `away` (N,) from what is wanted."""
        del scale
        return np.asarray(hold + self.design.lead[k] - self.design.gains[self.design.at[k]].K @ away)


class OutputMpc(OutputLqr):
    """The same cost over a horizon within the limits of each chamber, its rest left to the regulator.

    Where no limit is met in the horizon the regulator is the solution; else one quadratic program with a box for each
    command finds it. A slew limit counts for the coming command.

    Parameters
    ----------
    design : OutputDesign
    limits : Limits
    stages : int
        Periods of the horizon.

    Attributes
    ----------
    solved : int
        Steps in which a limit was met in the horizon.
    """

    def __init__(self, design: OutputDesign, limits: Limits, stages: int = 16) -> None:
        super().__init__(design, limits)
        self.stages = stages
        self._programs = [self._program(made) for made in design.gains]  # here, not in a period

    def reset(self) -> None:
        """Start anew from no pressure."""
        super().reset()
        self.solved = 0

    def _wish(self, k: int, away: Array, hold: Array, scale: float) -> Array:
        design, N, C = self.design, self.stages, self.chambers
        rows, made = design.periods(k, N) if design.path else np.full(N, k), design.gains[design.at[k]]
        shift = [design.shift(j) for j in rows] if design.path else np.zeros((N, away.size))
        steady = hold + (design.pressure[rows] - design.pressure[k]) / KILO
        high = np.tile(scale * self._highest / KILO, (N, 1)) - steady
        low = -steady
        reach, now = scale * self._reach / KILO, scale * self.command / KILO - steady[0]
        high[0] = np.minimum(high[0], now + reach)
        low[0] = np.minimum(np.maximum(low[0], now - reach), high[0])
        x, free, plan = away, away, np.empty((N, C))
        frees = np.empty((N, away.size))
        for j in range(N):
            plan[j] = design.lead[rows[j]] - made.K @ x
            x = made.A @ x + made.B @ plan[j] + shift[j]
            frees[j] = free = made.A @ free + shift[j]
        if (plan >= low).all() and (plan <= high).all():
            return np.asarray(steady[0] + plan[0])
        self.solved += 1
        answer, weighed, H = self._programs[design.at[k]]
        slope = weighed.T @ frees.ravel() + answer.T @ design.ahead[min(k + N, len(design.at))]
        moves = bounded_least_squares(H, -slope, plan.ravel(), high.ravel(), low.ravel())
        return np.asarray(steady[0] + moves[:C])

    def _program(self, made: Gains) -> tuple[Array, Array, Array]:
        """The last state (states, N C) by the commands, all states times their cost, and the Hessian."""
        N, C = self.stages, self.chambers
        answer = np.zeros((N, made.A.shape[0], N * C))
        for j in range(N):
            if j:
                answer[j] = made.A @ answer[j - 1]
            answer[j][:, j * C : (j + 1) * C] += made.B
        costs = [made.Q] * (N - 1) + [made.P]
        weighed = np.concatenate([cost @ rows for cost, rows in zip(costs, answer, strict=True)])
        H = weighed.T @ answer.reshape(-1, N * C) + np.kron(np.eye(N), made.R)
        return answer[-1].copy(), weighed, 0.5 * (H + H.T)
