"""Nonlinear model predictive control of any number of outputs by any number of pressures or tendons (optional extra
``mpc``).

In each period the controller predicts the model's motion under the last plan, with the exact Jacobians of the time
steps. It then solves one quadratic program in the commands within the limits of pressure and slew (real-time
iteration). The cost is that of the linear-quadratic regulator over the horizon, plus the regulator's cost to go of the
final state.

Sources: Diehl, Bock and Schloeder, SIAM J. Control Optim. 43(5), 2005 (real-time iteration); Mayne et al., Automatica
36(6), 2000 (cost of the final state)
"""

from __future__ import annotations

import numpy as np

from pliant.control.contract import ControllerKind
from pliant.control.design import SQUARE, LqrDesign
from pliant.control.horizon import Ahead, Horizon
from pliant.control.lqr import Lqr
from pliant.control.steady_inputs import output_rates, output_values
from pliant.control.tuning import Limits, MpcTuning
from pliant.estimation.contract import State
from pliant.linear.sampled import KILO
from pliant.plugins import optional

Array = np.ndarray
MILLI = SQUARE**0.5  # errors are counted in mm, pressures in kPa
HUNDRED = 100.0  # parts of its highest, in which a command that is no pressure stands in the quadratic program


ACCURACY = 1e-5  # tolerance of OSQP's primal and dual residuals, absolute and relative
MOST = 5000  # iterations; random problems take 55, one in a hundred more than 800
APART = 100  # iterations between two changes of the step size: at 25 it cycled on one problem in a thousand
HUGE = 1e20  # limit of gradient and Hessian, beyond which the prediction counts as not finite


class QuadraticProgram:
    """Solver of the quadratic program min 1/2 z^T H z + g^T z with bounds 0 <= z <= highest and low <= D z <= high. It
    is set up once and solves many programs that differ in H, g, low and high.

    Each solve starts from the last multipliers, and a second time from zero multipliers if it fails. The sparsity
    pattern never changes. The cost is divided by the geometric mean of its curvatures, so that a step size of 1 suits.

    Parameters
    ----------
    highest : array (Z,)
        Upper bounds of z.
    change : array (R, Z)
        Matrix D; no rows if there are only bounds.

    Attributes
    ----------
    status : str
        OSQP's status of the last problem.

    Raises
    ------
    InputError
        When OSQP is not installed.

    Source: Stellato et al., Math. Program. Comput. 12(4), 2020 (OSQP)
    """

    def __init__(self, highest: Array, change: Array) -> None:
        from scipy import sparse

        osqp = optional("osqp", "predictive control needs OSQP: pip install 'pliant[mpc]'")

        size = len(highest)
        self._upper = np.triu_indices(size)
        order = np.lexsort(self._upper)  # by columns, as OSQP holds them
        self._upper = self._upper[0][order], self._upper[1][order]
        whole = sparse.csc_matrix((np.ones(len(order)) + size * (self._upper[0] == self._upper[1]), self._upper))
        rows = sparse.csc_matrix(np.vstack([np.eye(size), change]))
        self._low, self._high = np.zeros(rows.shape[0]), np.append(highest, np.zeros(len(change)))
        self._solved, self._solver, self.status = osqp.SolverStatus.OSQP_SOLVED, osqp.OSQP(), ""
        self._solver.setup(
            whole, np.zeros(size), rows, self._low, self._high, verbose=False, eps_abs=ACCURACY, eps_rel=ACCURACY,
            max_iter=MOST, rho=1.0, adaptive_rho=1, adaptive_rho_interval=APART, check_termination=5, polishing=False,
            scaling=0,
        )

    def solve(self, H: Array, g: Array, low: Array, high: Array, start: Array) -> Array | None:
        """Return the solution z (Z,) of the quadratic program in Z unknowns, or None if it could not be solved
        accurately.

        `low` and `high` (R,) bound D z, and `start` (Z,) is the initial guess.
        """
        if not (np.abs(H).max() < HUGE and np.abs(g).max() < HUGE):
            self.status = "the prediction is not finite"
            return None
        size, (sign, logarithm) = len(g), np.linalg.slogdet(H)
        if sign <= 0:
            self.status = "the cost is not convex"
            return None
        mean = np.exp(logarithm / size)
        self._low[size:], self._high[size:] = low, high
        self._solver.update(Px=H[self._upper] / mean, q=g / mean, l=self._low, u=self._high)
        self._solver.warm_start(x=start)
        for _ in range(2):
            solution = self._solver.solve(raise_error=False)
            self.status = str(solution.info.status)
            if solution.info.status_val == self._solved and np.isfinite(solution.x).all():
                return np.array(solution.x)
            self._solver.update_settings(rho=1.0)
            self._solver.warm_start(x=start, y=np.zeros(len(self._low)))
        return None


class Mpc(Lqr):
    """Nonlinear model predictive controller for the reference and weights of an `LqrDesign`, within limits of command
    and slew rate.

    A period whose quadratic program was not solved is a fault. The controller then continues the last plan within the
    limits, and `fault` is set until a later program is solved.

    Parameters
    ----------
    design : LqrDesign
    limits : Limits
    tuning : MpcTuning, optional

    Attributes
    ----------
    plan : array (J, C)
        Commands [Pa] at the nodes of the horizon, from the last program that was solved.
    age : int
        Number of periods since that program was solved.
    program : QuadraticProgram
    solved, failed : int
        Numbers of periods whose quadratic program was solved, and was not solved.
    fault : str
        Why the last command belongs to an earlier plan, in one sentence; empty if it does not.

    Raises
    ------
    InputError
        When OSQP is not installed.
    """

    def __init__(self, design: LqrDesign, limits: Limits, tuning: MpcTuning | None = None) -> None:
        self.tuning = tuning or MpcTuning()
        super().__init__(design, limits)
        J, C, stage = self.tuning.stages, self.chambers, max(1, round(self.tuning.stage / design.period))
        self.horizon = Horizon(design, stage, J)
        self._speed, self._growth, self._rates = (
            speeds(rows, design.period) if design.path and len(rows) > 2 else 0.0 * rows
            for rows in (design.wanted, design.pressure, design.angle)
        )  # of the outputs, the steady pressures and the angles, per second
        units = [KILO if unit == "Pa" else most / HUNDRED
                 for unit, most in zip(design.model.actuation.units, self._highest, strict=True)]  # fmt: skip
        self._unit = np.array(units)  # (C,) of each command in the quadratic program
        self._size = np.tile(self._unit, J) / KILO  # (Z,)
        steps = np.kron(np.eye(J) - np.eye(J, k=-1), np.eye(C))  # from the command before to the first node, and on
        self._steep = np.repeat(self._reach * np.where(np.arange(J), stage, 1), C) / np.tile(self._unit, J)
        if not np.isfinite(self._reach):
            steps, self._steep = steps[:0], self._steep[:0]
        self.program = QuadraticProgram(np.tile(self._highest / self._unit, J), steps)

    def reset(self) -> None:
        """Reset the controller to its initial state, in which the commanded pressures are zero."""
        super().reset()
        self.solved, self.failed, self.fault = 0, 0, ""
        self.plan, self.age = np.zeros((self.tuning.stages, self.chambers)), 0

    def _wish(self, state: State) -> None:
        """Solve the quadratic program and write the plan's commands (C,) [Pa] for this period to `_wishes`."""
        self.age, self._before = self.age + 1, self.command.copy()
        last = self._within(self.horizon.later(self.plan, self.age))
        ahead = self.horizon.predict(state, self._parts, self._waiting, last)
        H, g = self._cost(state, ahead)
        H, g = H * np.outer(self._size, self._size), g * self._size
        start = (last / self._unit).ravel()
        before = np.zeros(len(self._steep))
        before[: self.chambers] = (self.command / self._unit)[: len(before)]
        solution = self.program.solve(H, g - H @ start, before - self._steep, before + self._steep, start)
        if solution is None:
            self.failed += 1
            self.fault = (
                f"the quadratic program of the predictive control was not solved ({self.program.status}): the last "
                "plan is continued"
            )
            self._wishes[:] = last[0]
            return
        self.solved, self.fault, self.age = self.solved + 1, "", 0
        self.plan = self._within(self._unit * solution.reshape(last.shape))
        self._wishes[:] = self.plan[0]

    def _within(self, plan: Array) -> Array:
        """Return the plan clipped to the limits of pressure, and of slew from the last command on."""
        out, before, reach = np.minimum(np.maximum(plan, 0.0), self._highest), self.command, self._reach
        if not np.isfinite(reach):
            return out
        for j in range(len(out)):
            out[j] = before = np.minimum(np.maximum(out[j], before - reach), before + reach)
            reach = self._reach * self.horizon.stage
        return out

    def _met(self, met: bool) -> bool:
        """Return whether a command lies at a limit; the plan itself never exceeds one."""
        del met
        before, edge = self._before, 1e-6 * self._highest
        low, high = np.maximum(before - self._reach, 0.0), np.minimum(before + self._reach, self._highest)
        return bool(((self._wishes <= low + edge) | (self._wishes >= high - edge)).any())

    def _cost(self, state: State, ahead: Ahead) -> tuple[Array, Array]:
        """Return Hessian (Z, Z) and gradient (Z,) of the cost at the plan that `ahead` predicts, with commands in kPa.

        The cost is half the sum of squares of the regulator's errors over the horizon, plus its cost to go of the last
        state.
        """
        design, scale, K = self.design, state.torque_scale, self.horizon.periods
        rows = design.periods(self.period, K + 1) if design.path else np.full(K + 1, self.period)
        after = self._after()
        y, dy, speed, turn = self._outputs(rows[1:], after[1:], ahead)
        z, dz = self._integrals(y, dy)
        gains = design.gains[design.at[rows[0]]]
        worth = np.sqrt(np.diag(gains.R))  # of each command, per kPa
        steady = design.pressure[rows] + after[:, None] * self._growth[rows] + self._more
        wish = (scale * ahead.command - steady[:-1]) / KILO
        effort = scale * np.einsum("kj,cd->kcjd", self.horizon.straight, np.diag(worth)).reshape(wish.size, -1)
        residual = np.concatenate([
            MILLI * y[:-1].ravel(), MILLI * design.tuning.damping_time * speed[:-1].ravel(),
            MILLI / design.tuning.integral_time * z[:-1].ravel(), (worth * wish).ravel(),
        ])  # fmt: skip
        count = effort.shape[1]
        slope = np.concatenate([
            MILLI * dy[:-1].reshape(-1, count), MILLI * design.tuning.damping_time * turn[:-1].reshape(-1, count),
            MILLI / design.tuning.integral_time * dz[:-1].reshape(-1, count), effort,
        ])  # fmt: skip
        last, by_last = self._last((rows[-1], after[-1]), state, ahead, (z[-1], dz[-1]))
        final = design.gains[design.at[rows[-1]]].P
        later = design.ahead[min(rows[-1], len(design.at))] if design.path else 0.0
        H = slope.T @ slope + by_last.T @ final @ by_last
        return 0.5 * (H + H.T), slope.T @ residual + by_last.T @ (final @ last + later)

    def _after(self) -> Array:
        """Return the times (K + 1,) [s] by which the periods from the present one on lie beyond the end of the known
        path.

        Before the path has ended, it is extrapolated linearly beyond its end, so that the body is not braked early.
        """
        beyond = self.period + np.arange(self.horizon.periods + 1) - (len(self.design.at) - 1)
        return np.maximum(beyond, 0) * self.design.period * self._moves

    @property
    def _moves(self) -> bool:
        """Whether the present period lies before the end of a path, from which on the path's last point is held."""
        return self.design.path and self.period < len(self.design.at) - 1

    def _outputs(self, rows: Array, after: Array, ahead: Ahead) -> tuple[Array, Array, Array, Array]:
        """Return errors (K, m) [m] and their derivatives (K, m, Z) [m/kPa], and the same of their speeds [m/s]."""
        design, weight, n = self.design, self._weight, self.design.model.size
        value = output_values(design.model, ahead.position, design.outputs)
        row, speed, row_speed = output_rates(design.model, ahead.position, ahead.rate, design.outputs)
        by_x, by_v = ahead.slope[:, :n], ahead.slope[:, n:]
        each = weight[:, None]
        return (
            weight * (value - design.still - design.wanted[rows] - after[:, None] * self._speed[rows]),
            KILO * each * (row @ by_x), weight * (speed - self._moves * self._speed[rows]),
            KILO * each * (row_speed @ by_x + row @ by_v),
        )

    def _integrals(self, y: Array, dy: Array) -> tuple[Array, Array]:
        """Return the integrals (K, m) [m s] of the errors at the periods' ends, and their derivatives (K, m, Z)."""
        driven, period = self._gains.driven, self.design.period
        start = (driven @ (self._weight * self._off))[None]
        error = np.concatenate([start, y[:-1] @ driven.T])  # at the beginnings of the periods
        moved = np.concatenate([np.zeros((1, *dy.shape[1:])), driven @ dy[:-1]])
        return self._integral + period * np.cumsum(error, axis=0), period * np.cumsum(moved, axis=0)

    def _last(
        self, when: tuple[int, float], state: State, ahead: Ahead, integral: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """Return the last state's deviation (N,) from the reference, as in `Gains`, and its derivative (N, Z).

        `when` holds the row of the design and the time [s] after it.
        """
        design, n, scale, (row, after) = self.design, self.design.model.size, state.torque_scale, when
        rest = design.resting @ ((design.pressure[row] + self._more) / KILO) + design.beside[row]
        rest[:n] += design.angle[row] + self._turn + design.gains[design.at[row]].slope @ self._more
        rest += design.resting @ (after * self._growth[row]) / KILO
        rest[:n] += after * self._rates[row]
        rest[n : 2 * n] = self._moves * self._rates[row]
        pressures = scale * np.concatenate([ahead.valve, ahead.waiting]) / KILO
        full = np.concatenate([ahead.position[-1], ahead.rate[-1], pressures, integral[0]])
        by_pressure = scale * np.concatenate([ahead.valve_slope, ahead.waiting_slope])
        return full - rest, np.concatenate([KILO * ahead.slope[-1], by_pressure, integral[1]])


def speeds(rows: Array, period: float) -> Array:
    """Return the rates of change per second (K, ...) of a path, from its values `rows` (K, ...) in K periods of
    `period` [s].
    """
    rates = np.gradient(rows[:-1], period, axis=0)
    return np.concatenate([rates, rates[-1:]])


CONTROLLER = ControllerKind("mpc", lambda plan: Mpc(plan.design, plan.limits, plan.task.mpc), follows="path")
