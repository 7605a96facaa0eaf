"""Error against time: every method at every setting, and what each needs to meet one error.

The problem is the paper's pulse of 119 kPa, 4 s, five links, all tips every 10 ms. A method has a name, settings from
coarse to fine, and tips for one setting. All run on one core and are timed in processor time: what else the machine
does then disturbs them little.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from time import perf_counter, process_time
from typing import Any

import numpy as np
from scipy.integrate import odeint, solve_ivp

from pliant.actuators import chen2018
from pliant.compiler.choose import MOST_LINKS, straight, twin
from pliant.compiler.trace import planar_workspace
from pliant.equations import motion
from pliant.equations.symbols import Slopes
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation import Pulse, simulate, state
from pliant.simulation.drive import drive
from pliant.simulation.extrapolation import march_extrapolated
from pliant.simulation.initial_value import march, posed
from speed.timing import best

Array = np.ndarray
DURATION = 4.0  # s
BETWEEN = 0.01  # s, between outputs; the edges of the pulse are outputs
TARGET_MM = 0.02
USELESS_MM = 20.0  # beyond, a setting is no answer
LONG_S = 1.0  # a run that takes longer is timed once: what disturbs it is a small part of it
Solve = Callable[[float], Array]
INTEGRATORS = {"implicitfast": 3, "implicit": 2, "Euler": 0, "RK4": 1}  # of MuJoCo
STEPS = [1e-2 / k for k in (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 14, 16, 20, 25, 32, 40, 64, 100, 200)]  # s
TOLERANCES = [10.0**-k for k in np.arange(2.0, 11.1, 0.5)]


class Problem:
    """The pulse, and the error of a solution relative to the reference."""

    def __init__(self, links: int = 5) -> None:
        self.model: Model = chen2018.model(links=links)
        self.pressure = Pulse(chen2018.PULSE_PRESSURE, chen2018.PULSE_START, chen2018.PULSE_WIDTH)
        self.times = np.round(np.arange(round(DURATION / BETWEEN) + 1) * BETWEEN, 9)
        self.torque = float(self.model.torque_at(chen2018.PULSE_PRESSURE))
        self.truth = np.zeros((0, links, 2))  # tips (T, n, 2), m: see `methods.solved`

    @property
    def pieces(self) -> list[tuple[Array, float]]:
        """Return output times between the edges of the pulse, both ends included, with the torque [N m] there."""
        rise, fall = np.searchsorted(self.times, np.round(self.pressure.jumps, 9))
        return [
            (self.times[: rise + 1], 0.0), (self.times[rise : fall + 1], self.torque), (self.times[fall:], 0.0),
        ]

    def error_mm(self, tips: Array) -> float:
        """Return the largest distance of any tip at any time from the reference, mm."""
        return 1e3 * float(np.linalg.norm(tips - self.truth, axis=-1).max())

    def tips(self, q: Array) -> Array:
        """Return tips (T, n, 2) of joint angles (T, n) from the base, m."""
        phi = np.cumsum(q, axis=-1)
        l = self.model.link_length
        return np.stack([-np.cumsum(l * np.sin(phi), axis=-1), np.cumsum(l * np.cos(phi), axis=-1)], axis=-1)


@dataclass(frozen=True)
class Method:
    """A way to solve the problem."""

    name: str
    settings: Sequence[float]  # steps [s] or relative tolerances, from coarse to fine
    solve: Solve  # tips (T, n, 2) at one setting; raises or returns what is not finite where it cannot


def pliant_midpoint(problem: Problem) -> Method:
    """Solve by pliant's default method, from model and input to tips; labelling the arrays is not counted."""
    model = problem.model

    def solve(h: float) -> Array:
        plan = drive(model, problem.pressure, problem.times, h)
        start = (mechanics_of(model).coordinates(state.equilibrium(model, plan.initial)), np.zeros(model.n))
        phi, *_ = march(model, plan, start, problem.times.size)
        return mechanics_of(model).tips(phi)

    return Method("pliant, implicit midpoint", STEPS, solve)


def pliant_extrapolated(problem: Problem) -> Method:
    """Solve by two midpoint integrations, one with half the step, extrapolated at the output times."""
    model = problem.model

    def solve(h: float) -> Array:
        posed_problem = posed(model, problem.pressure, problem.times, ()).started(None, None, None)
        return mechanics_of(model).tips(march_extrapolated(posed_problem, h).marched[0])

    return Method("pliant, extrapolated", STEPS, solve)


class RightHandSide:
    """The compiled right-hand side and Jacobian of the state (phi, w), as a careful user writes them for a solver."""

    def __init__(self, problem: Problem) -> None:
        n = problem.model.n
        self.n = n
        self.parts = (mechanics_of(problem.model).body, mechanics_of(problem.model).joints, planar_workspace(n))
        kernels = (motion.acceleration, motion.acceleration_jacobian)  # the fastest form that pliant has of them
        few = n <= MOST_LINKS
        self.accelerate, self.differentiate = ((straight(k, n) if few else twin(k)) for k in kernels)
        self.torque = np.zeros(n)
        self.slopes = Slopes(np.empty(n), np.empty((n, n)), np.empty((n, n)))
        self.J = np.zeros((2 * n, 2 * n))
        self.J[:n, n:] = np.eye(n)

    def rate(self, _t: float, y: Array) -> Array:
        """dy/dt (2n,)."""
        n, y = self.n, np.ascontiguousarray(y)  # Radau passes strided rows
        out = np.empty(2 * n)
        out[:n] = y[n:]
        self.accelerate(y[:n], y[n:], self.torque, *self.parts, out[n:])
        return out

    def jacobian(self, _t: float, y: Array) -> Array:
        """d(dy/dt)/dy (2n, 2n)."""
        n, y = self.n, np.ascontiguousarray(y)
        self.differentiate(y[:n], y[n:], self.torque, *self.parts, self.slopes)
        self.J[n:, :n] = self.slopes.a_phi.T
        self.J[n:, n:] = self.slopes.a_w.T
        return self.J


Piece = Callable[[RightHandSide, Array, Array, float], Array]


def in_pieces(name: str, problem: Problem, piece: Piece, settings: Sequence[float] = TOLERANCES) -> Method:
    """Restart a solver at each edge of the pulse; `piece` returns states (T, 2n) at given times."""
    rhs = RightHandSide(problem)

    def solve(setting: float) -> Array:
        rows = [np.zeros((1, 2 * rhs.n))]
        for times, torque in problem.pieces:
            rhs.torque[:] = torque
            rows.append(piece(rhs, rows[-1][-1], times, setting)[1:])
        return mechanics_of(problem.model).tips(np.concatenate(rows)[:, : rhs.n])

    return Method(name, settings, solve)


def scipy_methods(problem: Problem) -> list[Method]:
    """Return SciPy's solvers on the compiled right-hand side."""

    def ivp(method: str) -> Piece:
        def piece(rhs: RightHandSide, y: Array, times: Array, rtol: float) -> Array:
            found = solve_ivp(
                rhs.rate, (times[0], times[-1]), y, method=method, t_eval=times, rtol=max(rtol, 1e-13),
                atol=1e-3 * rtol, jac=rhs.jacobian,
            )
            return np.asarray(found.y.T)

        return piece

    def fortran(rhs: RightHandSide, y: Array, times: Array, rtol: float) -> Array:
        return np.asarray(odeint(
            rhs.rate, y, times, tfirst=True, Dfun=rhs.jacobian, rtol=rtol, atol=1e-3 * rtol, mxstep=100_000,
        ))

    return [
        in_pieces("SciPy LSODA (odeint)", problem, fortran),
        *(in_pieces(f"SciPy {m} (solve_ivp)", problem, ivp(m)) for m in ("LSODA", "BDF", "Radau")),
    ]


def solved(problem: Problem) -> Problem:
    """Return `problem` with a reference solution, by a solver of another kind at its tightest tolerance."""
    problem.truth = scipy_methods(problem)[-1].solve(1e-11)
    return problem


def mujoco_methods(problem: Problem) -> list[Method]:
    """Return MuJoCo's hinge chain with each of its integrators, many steps per call."""
    if find_spec("mujoco") is None:
        return []
    mujoco = import_module("mujoco")
    mujoco.set_mju_user_warning(lambda _text: None)  # a step that is too long shows in the error; no log file for it
    return [
        Method(f"MuJoCo {name}", STEPS, mujoco_chain(mujoco, problem, number)) for name, number in INTEGRATORS.items()
    ]


def mujoco_chain(mujoco: Any, problem: Problem, integrator: int) -> Solve:
    """Return the chain with masses at its tips as MuJoCo hinges, without contacts and gravity."""
    m = problem.model
    head = "<mujoco><option gravity='0 0 0'><flag contact='disable' constraint='disable'/></option><worldbody>"
    bodies = "".join(
        f"<body pos='0 {m.link_length[i - 1] if i else 0:.17g} 0'><joint type='hinge' axis='0 0 1'/>"
        f"<inertial pos='0 {m.link_length[i]:.17g} 0' mass='{m.link_mass[i]:.17g}' diaginertia='1e-10 1e-10 1e-10'/>"
        for i in range(m.n)
    )
    compiled = mujoco.MjModel.from_xml_string(f"{head}{bodies}{'</body>' * m.n}</worldbody></mujoco>")
    compiled.jnt_stiffness.reshape(m.n, -1)[:, 0] = m.stiffness
    compiled.dof_damping.reshape(m.n, -1)[:, 0] = m.damping
    compiled.opt.integrator = integrator
    data = mujoco.MjData(compiled)

    def solve(h: float) -> Array:
        count = max(1, round(1e-2 / h))
        compiled.opt.timestep = 1e-2 / count
        mujoco.mj_resetData(compiled, data)
        q = np.zeros((problem.times.size, m.n))
        row = 0
        for times, torque in problem.pieces:
            data.qfrc_applied[:] = torque
            for _ in range(times.size - 1):
                mujoco.mj_step(compiled, data, count)
                row += 1
                q[row] = data.qpos
        return problem.tips(q)

    return solve


def error_of(problem: Problem, method: Method, setting: float) -> float:
    """Return the largest tip error at one setting, mm; infinite if the method fails."""
    try:
        with np.errstate(all="ignore"):
            tips = method.solve(setting)
    except Exception:  # noqa: BLE001  a peer that fails at a setting has no error there, and the race goes on
        return np.inf
    if tips.shape != problem.truth.shape or not np.isfinite(tips).all():
        return np.inf
    return problem.error_mm(tips)


def to_target(problem: Problem, method: Method, target_mm: float = TARGET_MM) -> dict[str, Any] | None:
    """Return the coarsest setting from which on the error stays within the target: setting, error, time; or None."""
    errors = [error_of(problem, method, s) for s in method.settings]
    good = len(errors)
    while good and errors[good - 1] <= target_mm:
        good -= 1
    if good == len(errors):
        return None
    setting = method.settings[good]
    seconds = best(lambda: method.solve(setting), seconds=0.3, clock=process_time)
    return {"method": method.name, "setting": setting, "error_mm": errors[good], "ms": 1e3 * seconds}


def curve(problem: Problem, method: Method, seconds: float = np.inf) -> list[dict[str, float]]:
    """Return error and time at every successful setting, from coarse to fine; ends after about `seconds`."""
    rows = []
    error_of(problem, method, method.settings[0])  # compiles
    began = perf_counter()
    for setting in method.settings:
        start = process_time()
        error = error_of(problem, method, setting)
        took = process_time() - start
        if error < USELESS_MM:
            if took < LONG_S:
                took = best(partial(method.solve, setting), seconds=0.05, repeats=3, clock=process_time)
            rows.append({"setting": setting, "error_mm": error, "ms": 1e3 * took})
        if perf_counter() - began > seconds:
            break
    return rows


def experiment() -> dict[str, Any]:
    """Solve the paper's pulse with all tips within 0.02 mm, and compare other methods' times at the same error."""
    problem = solved(Problem())
    ours = to_target(problem, pliant_midpoint(problem))
    if ours is None:
        raise RuntimeError("the midpoint rule does not reach the target at its finest step")
    run = partial(simulate, problem.model, problem.pressure, times=problem.times, time_step=ours["setting"])
    labelled = best(run, clock=process_time)
    found: dict[str, Any] = {
        "experiment_ms": ours["ms"], "experiment_tip_error_mm": ours["error_mm"],
        "experiment_step_ms": 1e3 * ours["setting"], "experiment_labelled_ms": 1e3 * labelled,
    }
    for key, methods in (("lsoda", scipy_methods(problem)[:2]), ("mujoco", mujoco_methods(problem))):
        met = [r for r in (to_target(problem, m) for m in methods) if r]
        first = min(met, key=lambda r: r["ms"]) if met else None
        found[f"ratio_{key}"] = first["ms"] / ours["ms"] if first else None
        found[key] = first or "absent, or never within the target"
    return found
