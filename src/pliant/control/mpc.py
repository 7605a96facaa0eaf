"""Nonlinear model predictive control (extra ``mpc``): one quadratic program a period.

Each period linearises the model's own steps, by their exact Jacobian, along the motion that the last solution predicts,
condenses to the commands alone, and solves one quadratic program with 0 <= p <= highest and the slew limit: the
real-time iteration. `symbolic_step` gives the same step on CasADi symbols, for a solver of your own.

Source: Diehl, Bock and Schloeder, SIAM J. Control Optim. 43(5), 2005
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np

from pliant.compiler.choose import twin
from pliant.control.equilibria import equilibria
from pliant.control.limits import Limits
from pliant.control.valve import SupplyValve, supply_of
from pliant.equations import motion
from pliant.equations.linearised import step_jacobian
from pliant.equations.symbols import Workspace
from pliant.errors import InputError
from pliant.estimation.contract import State
from pliant.linear.linearisation import behind_valve
from pliant.linear.sampled import hold
from pliant.model import Model, Valve
from pliant.simulation.state import workspace

Array = np.ndarray
COARSE = 6e-3  # s, longest step of the model within a stage


@dataclass(frozen=True)
class MpcTuning:
    """Horizon and weights of the predictive control.

    Parameters
    ----------
    stage : float
        Time for which the horizon holds a command, s.
    stages : int
        Commands in the horizon; of several chambers, whose stage is the period, for each.
    effort : float
        Weight of a change of the command, in parts of a tip error that the change makes at rest.
    speed : float
        s; the tip's speed times this counts like an error, at the end of the horizon.
    """

    stage: float = 0.012
    stages: int = 16
    effort: float = 0.03
    speed: float = 0.05

    def __post_init__(self) -> None:
        if not (self.stage > 0 and self.stages >= 2 and self.effort > 0 and self.speed >= 0):
            raise InputError(f"predictive control needs a stage > 0, two stages or more and an effort > 0, got {self}")


def _casadi() -> Any:
    try:
        casadi = import_module("casadi")
    except ImportError:
        raise InputError("CasADi is not installed: pip install 'pliant[mpc]'") from None
    if hasattr(casadi.GlobalOptions, "setNumpyMode"):  # 3.8: np.cos of a symbol is a symbol, without a warning
        casadi.GlobalOptions.setNumpyMode(-1)
    return casadi


def symbolic_step(model: Model, h: float) -> Any:
    """CasADi function (x, torque) -> x' of one step of `h` [s]: the text of `equations.motion.step` on symbols.

    x is (angles, rates) (2 n,), rad and rad/s, torque [N m] the mean of the torque law over the step.

    Raises
    ------
    InputError
        When CasADi is missing, or the model holds memory.
    """
    ca = _casadi()
    if model.memory:
        raise InputError("the symbolic step takes a model without memory: pass frozen(model)")
    n = model.n
    x, torque = ca.SX.sym("x", 2 * n), ca.SX.sym("torque")
    phi, w = _symbols([x[i] for i in range(n)]), _symbols([x[n + i] for i in range(n)])
    work = Workspace(*(np.zeros(size, dtype=object) for size in ((n, n), (n, n), n, n, n + 1, n, n, n)))
    tau = _symbols([gain * torque for gain in model.joint_gain])
    motion.step(phi, w, h, tau, model.body(), model.joints(), work)
    return ca.Function("step", [x, torque], [ca.vertcat(*phi, *w)])


def _symbols(entries: list[Any]) -> Array:
    made = np.empty(len(entries), dtype=object)
    made[:] = entries
    return made


class Mpc:
    """Predictive control of the tip; stands in for `Lqr`.

    Parameters
    ----------
    model : Model
        Calibrated, frozen; its valve is of second order, of first order, or none.
    limits : Limits
    period : float
        s
    tuning : MpcTuning, optional
    latency : float
        s by which the measured state is old.
    supply : SupplyValve, optional
        The rig's valve, where more is known of it than the model holds.

    Attributes
    ----------
    command, error : float
        Pa, the last one; m, of the tip along its path at the last step.
    solved, failed, saturated : int
        Quadratic programs with and without a solution (without one the last plan goes on); commands at a limit.

    Raises
    ------
    InputError
        When CasADi is missing, or the model holds memory or a valve that has no linear equation.
    """

    def __init__(
        self, model: Model, limits: Limits, period: float, *, tuning: MpcTuning | None = None, latency: float = 0.0,
        supply: SupplyValve | None = None,
    ) -> None:
        ca = _casadi()
        if model.memory:
            raise InputError("predictive control takes a model without memory: pass frozen(model)")
        self.model, self.limits, self.period, self.tuning = model, limits, period, tuning or MpcTuning()
        n, N, t = model.n, self.tuning.stages, self.tuning
        self._parts = max(1, math.ceil(t.stage / COARSE - 1e-9))
        self._advance, self._work = twin(step_jacobian, n), workspace(n)
        self._theta0, self._J = np.array(model.rest_angle), np.zeros((3 * n, 2 * n))
        self._fixed = (model.body(), model.joints()._replace(theta0=self._theta0), self._work, self._J)
        self._equilibria, self._n = equilibria(model, limits.highest), n
        self._supply = supply or supply_of(model.valve)
        self._held = [behind_valve(np.zeros((0, 0)), np.zeros(0), v)[:2] for v in self._sides()]
        self._order = self._held[0][1].size
        self._valves = [(hold(A, B, t.stage), hold(A, B, period)) for A, B in self._held] if self._order else []
        self._delay = round((model.valve.dead_time + latency) / period)
        self._change = np.eye(N) - np.eye(N, k=-1)
        dense = {"h": ca.Sparsity.dense(N, N), "a": ca.Sparsity.dense(N, N)}
        quiet = {"print_iter": False, "print_header": False, "print_info": False, "error_on_fail": False}
        self._qp = ca.conic("qp", "qrqp", dense, quiet)
        self._slopes = np.gradient(self._equilibria.displacement, self._equilibria.pressure)
        self.reset()

    @property
    def horizon(self) -> Array:
        """Ends (stages,) of the stages, s after the measured state."""
        return np.asarray(self._delay * self.period + self.tuning.stage * np.arange(1, self.tuning.stages + 1))

    def reset(self) -> None:
        """Start anew from no pressure."""
        self.command = self.error = 0.0
        self.solved = self.failed = self.saturated = 0
        self._plan = np.zeros(self.tuning.stages)
        self._sent = [0.0] * self._delay

    def step(
        self, target: float, state: State, valve: Array, *, ahead: Array | None = None
    ) -> float:
        """Command [Pa] for the coming period; arguments as for `Lqr.step`.

        `ahead` (stages,) [m] are the tip displacements wanted at the times `horizon` from the measured state on;
        without them that at `target` is wanted throughout.
        """
        scale = state.torque_scale
        np.add(self.model.rest_angle, state.rest_shift, out=self._theta0)
        x, v = self._now(np.concatenate([state.angle, state.rate]), np.array(valve[: self._order], dtype=float), scale)
        stage, t = self.tuning.stage, self.tuning
        _, wanted, way = self._equilibria.at(target)
        self.error = float(way @ (self._tip(state.angle)[0] - wanted))
        ends = np.arange(t.stages) * stage
        guess = np.interp(ends + self.period, ends, self._plan)
        family = self._equilibria
        p = np.full(t.stages, target) if ahead is None else np.interp(ahead, family.displacement, family.pressure)
        error, rows, last = self._linearised(x, v, guess, p, scale)
        slope = float(np.interp(target, self._equilibria.pressure, self._slopes)) * scale
        weight = np.ones(t.stages)
        weight[-1] = 0.2 / stage
        change, behind = self._change, np.append(self.command, np.zeros(t.stages - 1))
        worth = t.effort * slope * 1e3
        step = (change @ guess - behind) * 1e-3
        H = 2e6 * (rows.T * weight @ rows + t.speed**2 * np.outer(last[1], last[1]) + worth**2 * change.T @ change)
        g = 2e6 * (rows.T @ (weight * error) + t.speed**2 * last[1] * last[0] + worth**2 * change.T @ step)
        reach = np.full(t.stages, self.limits.slew * stage)
        reach[0] = self.limits.slew * self.period
        move = self._solved(H, g, guess, change @ guess - behind, np.minimum(reach, 1e9))
        self._plan = np.clip(guess + move, 0.0, self.limits.highest)
        self.command = self.limits(float(self._plan[0]), self.command, self.period)
        self.saturated += not 0.0 < self.command < self.limits.highest
        if self._delay:
            self._sent = [*self._sent[1:], self.command]
        return self.command

    def _solved(self, H: Array, g: Array, guess: Array, behind: Array, reach: Array) -> Array:
        """Change of the plan (N,) [Pa] that the quadratic program in kPa finds; none where it finds none."""
        made = self._qp(
            h=H, g=g, a=self._change, lbx=-1e-3 * guess, ubx=1e-3 * (self.limits.highest - guess),
            lba=1e-3 * (-reach - behind), uba=1e-3 * (reach - behind),
        )
        move = 1e3 * np.asarray(made["x"]).ravel()
        if self._qp.stats()["success"] and np.isfinite(move).all():
            self.solved += 1
            return move
        self.failed += 1
        return np.zeros_like(guess)

    def _sides(self) -> tuple[Valve, Valve]:
        """The valve while it empties, and while it fills."""
        made, plain = self._supply, self.model.valve
        if made is None:
            return plain, plain
        return (
            replace(made.mean, natural_frequency=made.fall_frequency),
            replace(made.mean, natural_frequency=made.rise_frequency),
        )

    def _now(self, x: Array, v: Array, scale: float) -> tuple[Array, Array]:
        """State of body (2 n,) and valve when the next command arrives: ahead by those that are on their way."""
        for sent in self._sent:
            before = float(v[0]) if self._order else sent
            if self._order:
                A, B = self._valves[int(sent > before)][1]
                v = A @ v + B * sent
            x = self._step(x, self.period, 1, before, float(v[0]) if self._order else sent, scale)[0]
        return x, v

    def _step(
        self, x: Array, time_s: float, parts: int, p0: float, p1: float, scale: float
    ) -> tuple[Array, Array, Array]:
        """X after a time under a pressure that goes straight from p0 to p1; its derivatives by x and by (p0, p1)."""
        n, model = self._n, self.model
        x, by_x, by_p = x.copy(), np.eye(2 * n), np.zeros((2 * n, 2))
        for k in range(parts):
            share = (k + 0.5) / parts
            p = p0 + share * (p1 - p0)
            torque = scale * float(model.torque_at(p)) * model.joint_gain
            self._advance(x[:n], x[n:], time_s / parts, torque, *self._fixed)
            fresh = self._J[: 2 * n].T
            drive = scale * model.chamber.torque_slope(p) * (model.joint_gain @ self._J[2 * n :])
            by_x, by_p = fresh @ by_x, fresh @ by_p + np.outer(drive, [1.0 - share, share])
        return x, by_x, by_p

    def _pressures(self, v: Array, command: Array) -> tuple[Array, Array]:
        """Pressures (N + 1,) [Pa] at the ends of the stages under commands (N,), and their derivatives (N + 1, N)."""
        N = command.size
        if not self._order:
            return np.concatenate([command[:1], command]), np.eye(N)[np.append(0, np.arange(N))]
        by, out, rows = np.zeros((self._order, N)), np.empty(N + 1), np.zeros((N + 1, N))
        out[0] = v[0]
        for k, asked in enumerate(command):
            A, B = self._valves[int(asked > v[0])][0]
            v, by = A @ v + B * asked, A @ by
            by[:, k] += B
            out[k + 1], rows[k + 1] = v[0], by[0]
        return np.maximum(out, 0.0), rows

    def _linearised(
        self, x: Array, v: Array, command: Array, target: Array, scale: float
    ) -> tuple[Array, Array, tuple[float, Array]]:
        """Tip errors (N,) [m] at the ends of the stages and their derivatives (N, N) [m/kPa]; the last speed's too."""
        n, N = self._n, command.size
        pressure, by_command = self._pressures(v, command)
        by = np.zeros((2 * n, N))
        error, rows = np.empty(N), np.empty((N, N))
        for k in range(N):
            p0, p1 = float(pressure[k]), float(pressure[k + 1])
            x, by_x, by_p = self._step(x, self.tuning.stage, self._parts, p0, p1, scale)
            by = by_x @ by + by_p @ by_command[k : k + 2]
            tip, row = self._tip(x[:n])
            _, wanted, way = self._equilibria.at(float(target[k]))
            error[k], rows[k] = way @ (tip - wanted), 1e3 * (way @ row @ by[:n])
        speed, turned = way @ row @ x[n:], 1e3 * (way @ row @ by[n:])
        return error, rows, (float(speed), turned)

    def _tip(self, phi: Array) -> tuple[Array, Array]:
        """Tip (2,) [m] and its derivative (2, n) by the angles."""
        length, s, c = self.model.link_length, np.sin(phi), np.cos(phi)
        x0, y0 = self.model.first_joint
        sign = self.model.bend_sign
        tip = np.array([sign * (x0 - length @ s), y0 + length @ c])
        return tip, np.array([-sign * length * c, -length * s])
