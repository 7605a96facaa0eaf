"""Reference solutions by SciPy's adaptive solvers on the compiled right-hand side and its exact Jacobian.

The paper solves with ode15s; BDF and LSODA are its relatives. The valve and the energies are states of their own here,
so that nothing is shared with the fixed-step path but the equation of motion.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pliant.compiler.choose import twin
from pliant.equations import energy, motion, section
from pliant.errors import InputError, SimulationError
from pliant.model import Model, Valve
from pliant.numerics.ldl import ldl_solve
from pliant.simulation.drive import merge
from pliant.simulation.inputs import Input
from pliant.simulation.state import given_way, joint_angles, tangents, workspace

Array = np.ndarray
METHODS = ("LSODA", "BDF", "Radau")
SHORTEST_LAG = 1e-6  # s; stands for none where a valve lags in one direction only: its pressure is a state here


def solve_reference(
    model: Model, pressure: Input, times: Array, start: tuple[Array, Array, float], states: Array, method: str,
    rtol: float,
) -> tuple[Array, Array, Array, Array, Array]:
    """Absolute angles and rates (T, n), work and losses (T, 3), states of the memory (T, n, branches), stretch (T,).

    `start` holds absolute angles and rates (n,) and the pressure before anything happens at the first time, Pa;
    `states` (n, branches) the memory there. Solved piece by piece between the jumps and bends of the pressure.
    """
    from scipy.integrate import solve_ivp  # a third of a second that the default need not pay

    if model.memory.slip_share or model.memory.boucwen_share:
        raise InputError(f"{method} follows creep, not slip or Bouc-Wen, which have corners: use method='midpoint'")
    if model.valve.settle_share:
        raise InputError(f"{method} does not follow a pressure that settles late: use method='midpoint'")
    at = layout(model)
    dead = model.valve.dead_time
    corners = merge(times[[0, -1]], pressure.breakpoints + dead, 1e-9 * (times[-1] - times[0]))
    y = np.zeros(at.size)
    y[at.phi], y[at.w], y[at.p] = start
    y[at.slow] = start[2]
    y[at.inflation] = float(model.inflation_at(start[2]))
    creep = states[:, : len(model.memory.creep_share)]
    y[at.creep] = creep.ravel()
    atol = np.full(at.size, rtol * 1e-3)  # rad and J
    atol[at.p], atol[at.dp], atol[at.slow] = rtol * 1e2, rtol * 1e4, rtol * 1e2  # Pa and Pa/s
    out = np.empty((times.size, y.size))
    out[0] = y
    for left, right in pairwise(corners):
        due = np.flatnonzero((times > left) & (times <= right))
        ask = np.unique(np.append(times[due], right))
        rhs, jacobian = right_hand_side(model, pressure, left, right)
        solution = solve_ivp(
            rhs, (left, right), y, method=method, t_eval=ask, rtol=rtol, atol=atol, jac=jacobian,
            events=softest(model),
        )
        if solution.status == 1:
            lost = given_way(model, solution.y_events[0][0][at.phi], 1e-6)
            raise SimulationError(f"{solution.t_events[0][0] - times[0]:.6g} s after the start {lost}")
        if not solution.success or not np.isfinite(solution.y).all():
            raise SimulationError(f"{method} stopped between {left:.6g} and {right:.6g} s: {solution.message}")
        out[due] = solution.y[:, : due.size].T
        y = solution.y[:, -1]
    kept = np.zeros((times.size, *states.shape))
    kept[:, :, : creep.shape[1]] = out[:, at.creep].reshape(times.size, *creep.shape)
    work = np.zeros((times.size, 3))
    work[:, : 2 + at.remembers] = out[:, at.work : at.size]
    stretch = out[:, at.inflation].sum(axis=1) ** 0.25
    return out[:, at.phi], out[:, at.w], work, kept, stretch


def softest(model: Model) -> Callable[[float, Array], float] | None:
    """What stops a solver where a spring has softened to nothing: beyond, the motion may run away in finite time."""
    if not model.stiffening.any():
        return None

    def least(_t: float, y: Array) -> float:
        return float((tangents(model, joint_angles(model, y[: model.n])) / model.stiffness).min())

    least.terminal = True  # type: ignore[attr-defined]  # SciPy's way
    return least


class Layout(NamedTuple):
    """Where each state stands; what the model does not have takes no place, so that it cannot touch the step size."""

    phi: slice
    w: slice
    p: int
    dp: int
    slow: slice  # of swelling chambers, one place or none
    inflation: slice  # fourth power of the stretch of inflating chambers, one place or none
    creep: slice  # relaxed angles, joint by joint
    work: int  # work of the pressure, loss of the dampers, loss of creep where there is any
    remembers: bool
    size: int


def layout(model: Model) -> Layout:
    """The places of the states of `model`."""
    n, branches = model.n, len(model.memory.creep_share)
    slow = 2 * n + 2
    inflation = slow + bool(model.swell_share)
    creep = inflation + bool(model.inflation_limit)
    work = creep + n * branches
    return Layout(
        slice(0, n), slice(n, 2 * n), 2 * n, 2 * n + 1, slice(slow, inflation), slice(inflation, creep),
        slice(creep, work), work, branches > 0, work + 2 + (branches > 0),
    )


def right_hand_side(
    model: Model, pressure: Input, left: float, right: float,
) -> tuple[Callable[[float, Array], Array], Callable[[float, Array], Array] | None]:
    """The derivative of the states and its Jacobian between two corners of the input.

    The Jacobian of a model that creeps, swells or inflates is left to the solver.
    """
    at = layout(model)
    body, joints, scratch = model.body(), model.joints(), workspace(model.n)
    accelerate = twin(motion.acceleration)
    share, tau = (np.array(row) for row in (model.memory.creep_share, model.memory.creep_time))
    a = np.empty(model.n)
    slack = 1e-9 * (right - left)

    def valve(t: float, y: Array) -> tuple[float, Array, Array]:
        u = float(pressure(np.clip(t, left + slack, right - slack) - model.valve.dead_time))
        return behind_valve(model.valve, u, y[at.p : at.dp + 1])

    def rhs(t: float, y: Array) -> Array:
        p, rates, _ = valve(t, y)
        phi, w = y[at.phi].copy(), y[at.w].copy()
        slow = y[at.slow]
        late = slow[0] if slow.size else p
        torque = float(section.swollen_torque(p, late, model.swell_share, model.torque))
        wall = y[at.inflation]
        grown = (1.0 - (1.0 - p / model.inflation_limit) * wall) / model.inflation_time if wall.size else wall
        torque *= float(section.lever_growth(wall[0])) if wall.size else 1.0
        xi = y[at.creep].reshape(model.n, -1)
        stiff = 1.0 + share.sum()  # creep seen as a stiffer spring with another rest angle
        seen = joints
        if at.remembers:
            seen = joints._replace(K=joints.K * stiff, theta0=joints.theta0 + xi @ share / stiff)
        accelerate(phi, w, model.base_angle, torque, body, seen, scratch, a)
        power = energy.input_power(w, joints, torque)
        gap = joint_angles(model, phi)[:, None] - xi
        lost = [joints.K @ (gap**2 @ (share / tau))] if at.remembers else []
        return np.concatenate([
            w, a, rates, (p - slow) / model.swell_time, grown, (gap / tau).ravel(),
            [power, energy.damping_power(w, joints), *lost],
        ])

    if at.remembers or model.swell_share or model.inflation_limit:
        return rhs, None
    return rhs, jacobian_of(model, valve)


def jacobian_of(
    model: Model, valve: Callable[[float, Array], tuple[float, Array, Array]],
) -> Callable[[float, Array], Array]:
    """The exact Jacobian of the right-hand side of a model that neither creeps nor swells, behind its `valve`."""
    n = model.n
    body, joints, scratch = model.body(), model.joints(), workspace(n)
    differentiate, solve = twin(motion.acceleration_jacobian), twin(ldl_solve)
    a, a_phi, a_w = np.empty(n), np.empty((n, n)), np.empty((n, n))
    share = joints.gain - np.append(joints.gain[1:], 0.0)  # of the torque, on each absolute angle

    def jacobian(t: float, y: Array) -> Array:
        p, _, by_valve = valve(t, y)
        torque = float(model.torque_at(p))
        phi, w = y[:n].copy(), y[n : 2 * n].copy()
        differentiate(phi, w, model.base_angle, torque, body, joints, scratch, a, a_phi, a_w)
        J = np.zeros((y.size, y.size))
        J[:n, n : 2 * n] = np.eye(n)
        J[n : 2 * n, :n] = a_phi.T
        J[n : 2 * n, n : 2 * n] = a_w.T
        loss = 2.0 * joints.D * np.diff(w, prepend=0.0)
        J[-2:, n : 2 * n] = torque * share, loss - np.append(loss[1:], 0.0)
        if by_valve.any():
            push = share * section.secant(p, p, model.torque)
            J[-2, 2 * n] = push @ w
            solve(scratch.A, push)
            J[n : 2 * n, 2 * n] = push
            J[2 * n : 2 * n + 2, 2 * n : 2 * n + 2] = by_valve
        return J

    return jacobian


def behind_valve(valve: Valve, u: float, state: Array) -> tuple[float, Array, Array]:
    """Pressure behind a valve under the command u [Pa], the rates of its `state` (p, dp), and their Jacobian (2, 2)."""
    p, dp = state
    if valve.natural_frequency:
        omega = 2.0 * np.pi * valve.natural_frequency
        drag = 2.0 * valve.damping_ratio * omega
        slopes = np.array([[0.0, 1.0], [-omega * omega, -drag]])
        return p, np.array([dp, omega * omega * (u - p) - drag * dp]), slopes
    if not (valve.rise_time or valve.fall_time or valve.rise_rate or valve.fall_rate):
        return u, np.zeros(2), np.zeros((2, 2))
    lag = max(valve.rise_time if u >= p else valve.fall_time, SHORTEST_LAG)
    limit = (valve.rise_rate if u >= p else valve.fall_rate) or np.inf
    if abs(u - p) > limit * lag:
        return p, np.array([np.copysign(limit, u - p), 0.0]), np.zeros((2, 2))
    return p, np.array([(u - p) / lag, 0.0]), np.array([[-1.0 / lag, 0.0], [0.0, 0.0]])
