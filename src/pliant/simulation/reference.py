"""Reference simulations by SciPy's adaptive solvers, for comparison with `simulate`.

The paper solves with ode15s; BDF and LSODA are related methods. Valve pressures and energies are states of the solver
here, so that only the equation of motion is shared with the fixed-step simulation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from pliant.compiler.choose import twin
from pliant.equations import symbols
from pliant.equations.chamber import share_out, slow_rates, torque_now
from pliant.errors import SimulationError
from pliant.mechanics import Mechanics, mechanics_of
from pliant.mechanics.springs import axial_springs_of, springs_of
from pliant.model import Memory, Model, Valve
from pliant.model.features import ALL, FIRST_ORDER, IN_SPACE, LAWS, SPRINGS, TENDONS, WALLS, Consumer
from pliant.numerics.ldl import ldl_solve
from pliant.simulation.drive import inputs_of, merge
from pliant.simulation.inputs import Input
from pliant.simulation.state import given_way

Array = np.ndarray
METHODS = ("LSODA", "BDF", "Radau")
SHORTEST_LAG = 1e-6  # s, for 0 where a valve lags in one direction only, because its pressure is a state here


class Start(NamedTuple):
    """Initial state of a reference simulation."""

    phi: Array  # (n,) rad
    w: Array  # (n,) rad/s
    pressure: Array  # (C,) Pa, just before the first time
    memory: Array  # (n, branches) rad


def solve_reference(
    model: Model, pressure: Input | Sequence[Input], times: Array, start: Start, method: str, rtol: float
) -> tuple[Array, Array, Array, Array, Array]:
    """Simulate by an adaptive SciPy solver; return angles, rates, energies, hysteresis states and hoop stretch at
    `times`.

    Absolute angles and rates are (T, n), energies (T, 3) [J] input work and the losses of dampers and hysteresis,
    states (T, n, branches), stretch (T, C). The solver restarts at each breakpoint of the pressures.
    """
    from scipy.integrate import solve_ivp  # slow import, not needed by the default method

    refuse_unfollowed(model, method)
    rows, inputs = layout(model), inputs_of(model, pressure)
    bends = [p.breakpoints + c.valve.dead_time for p, c in zip(inputs, model.chambers, strict=True)]
    corners = merge(times[[0, -1]], np.concatenate(bends), 1e-9 * (times[-1] - times[0]))
    y, atol = first(model, rows, start), tolerances(rows, rtol)
    out = np.empty((times.size, y.size))
    out[0] = y
    for left, right in pairwise(corners):
        due = np.flatnonzero((times > left) & (times <= right))
        ask = np.unique(np.append(times[due], right))
        rhs, jacobian = right_hand_side(model, inputs, left, right)
        solution = solve_ivp(
            rhs, (left, right), y, method=method, t_eval=ask, rtol=rtol, atol=atol, jac=jacobian,
            events=softest(model),
        )
        if solution.status == 1:
            lost = given_way(model, solution.y_events[0][0][rows.phi], 1e-6)
            raise SimulationError(f"{solution.t_events[0][0] - times[0]:.6g} s after the start {lost}")
        if not solution.success or not np.isfinite(solution.y).all():
            raise SimulationError(
                f"{method} stopped between {left:.6g} and {right:.6g} s: {solution.message} Use method='accurate'"
            )
        out[due] = solution.y[:, : due.size].T
        y = solution.y[:, -1]
    memory = np.zeros((times.size, *start.memory.shape))
    creep = len(model.memory.creep_share)
    memory[:, :, :creep] = out[:, rows.creep].reshape(times.size, mechanics_of(model).remembering, creep)
    work = np.zeros((times.size, 3))
    work[:, : 2 + rows.remembers] = out[:, rows.work : rows.size]
    stretch = np.stack([out[:, c.stretch].sum(axis=1) ** 0.25 for c in rows.chambers], axis=1)
    return out[:, rows.phi], out[:, rows.w], work, memory, stretch


SCIPY = SPRINGS | LAWS | WALLS | FIRST_ORDER | IN_SPACE | TENDONS | {
    "dead_time", "second_order", "creep", "lengthening", "curved_segments", "tied_segments",
}


def refuse_unfollowed(model: Model, method: str) -> None:
    """Raise InputError if the model has laws that the SciPy `method` with variable step cannot integrate."""
    Consumer(f"method={method!r}", SCIPY, remedy=dict.fromkeys(ALL, "use method='midpoint'")).check(model)


def first(model: Model, at: StateLayout, start: Start) -> Array:
    """Return the state vector of the SciPy solver at the start of a simulation."""
    y = np.zeros(at.size)
    y[at.phi], y[at.w] = start.phi, start.w
    for c, chamber, p in zip(at.chambers, model.chambers, start.pressure, strict=True):
        y[c.p], y[c.slow], y[c.stretch] = p, p, float(chamber.growth_at(p))
    y[at.creep] = start.memory[:, : len(model.memory.creep_share)].ravel()
    return y


def tolerances(at: StateLayout, rtol: float) -> Array:
    """Return the absolute tolerance of each state of the SciPy solver."""
    atol = np.full(at.size, rtol * 1e-3)  # rad and J
    for c in at.chambers:
        atol[c.p], atol[c.dp], atol[c.slow] = rtol * 1e2, rtol * 1e4, rtol * 1e2  # Pa and Pa/s
    return atol


def softest(model: Model) -> Callable[[float, Array], float] | None:
    """Return a SciPy event that stops the solver where a spring loses its stiffness, or None for linear springs."""
    chain, joints, segments = mechanics_of(model), springs_of(model), axial_springs_of(model)
    strains = model.size - len(model.extensions)
    if not (joints.hardening.any() or segments.hardening.any()):
        return None

    def least(_t: float, y: Array) -> float:
        x = y[: model.size]
        slopes = joints.slope(chain.joint_angles(x)) / joints.K, segments.slope(x[strains:]) / segments.K
        return float(np.concatenate(slopes).min())

    least.terminal = True  # type: ignore[attr-defined]  # SciPy's way
    return least


class Place(NamedTuple):
    """Indices of one chamber's pressure, lagged pressure and hoop stretch in the SciPy solver's state vector."""

    p: int
    dp: int
    slow: slice  # lagged pressure: one index, or none without viscoelastic lag
    stretch: slice  # fourth power of the hoop stretch: one index, or none for a rigid wall


class StateLayout(NamedTuple):
    """Indices of angles, rates, chamber states, creep and energies in the SciPy solver's state vector."""

    phi: slice
    w: slice
    chambers: tuple[Place, ...]
    creep: slice  # relaxed angles of the creep branches, joint coordinate by joint coordinate
    work: int  # first index of: work of the pressure, loss of the dampers, loss of creep (if any)
    remembers: bool
    size: int


def layout(model: Model) -> StateLayout:
    """Return the indices of the states of `model` in the SciPy solver's state vector. Strains of segments follow the
    angles, and their rates follow the angular rates.
    """
    n, branches = model.size, len(model.memory.creep_share)
    slices, end = [], 2 * n
    for c in model.chambers:
        slow = end + 2
        stretch = slow + c.swells
        slices.append(Place(end, end + 1, slice(slow, stretch), slice(stretch, stretch + c.grows)))
        end = stretch + c.grows
    work = end + mechanics_of(model).remembering * branches
    return StateLayout(
        slice(0, n), slice(n, 2 * n), tuple(slices), slice(end, work), work, branches > 0, work + 2 + (branches > 0)
    )


Valves = Callable[[int, float, Array], tuple[float, Array, Array]]  # pressure, rates, Jacobian of a chamber's valve


def right_hand_side(
    model: Model, inputs: Sequence[Input], left: float, right: float,
) -> tuple[Callable[[float, Array], Array], Callable[[float, Array], Array] | None]:
    """Return the functions for the time derivative of the solver's states and for its Jacobian.
    They are valid between two breakpoints of the input.

    The Jacobian is None for models with creep, viscoelastic lag, inflation or tendons: the solver then approximates it.
    """
    rows = layout(model)
    chain = mechanics_of(model)
    body, joints, scratch = chain.parts()
    accelerate = chain.acceleration()
    gain = model.actuation.columns
    a, torque = np.empty(model.size), np.empty(gain.shape[1])
    chambers = [(c.kernel(), part) for c, part in zip(model.chambers, rows.chambers, strict=True)]
    slack = 1e-9 * (right - left)

    def valve(c: int, t: float, y: Array) -> tuple[float, Array, Array]:
        behind = model.chambers[c].valve
        u = float(inputs[c](min(max(t, left + slack), right - slack) - behind.dead_time))
        return behind_valve(behind, u, y[rows.chambers[c].p : rows.chambers[c].dp + 1])

    def rhs(t: float, y: Array) -> Array:
        phi, w = y[rows.phi].copy(), y[rows.w].copy()
        moved = []
        for c, (law, part) in enumerate(chambers):
            p, rates, _ = valve(c, t, y)
            chamber_torque, slow_rates = torque_and_rates(law, p, y[part.slow], y[part.stretch])
            share_out(c, chamber_torque, gain, torque)
            moved += [rates, *slow_rates]
        remembered = crept_springs(chain, model.memory, phi, y[rows.creep]) if rows.remembers else (joints, [], [])
        springs, crept, lost = remembered
        accelerate(phi, w, torque, body, springs, scratch, a)
        turning = chain.joint_rates(w)
        pull, rub = (scratch.pull, scratch.rub) if model.actuation.tendons else (0.0, 0.0 * turning)
        power = (torque[: model.size] + pull) @ turning, joints.D @ turning**2 - rub @ turning
        return np.concatenate([w, a, *moved, crept, [*power, *lost]])

    if rows.remembers or model.actuation.remembers or model.actuation.tendons:
        return rhs, None
    return rhs, jacobian_of(model, valve)


def crept_springs(chain: Mechanics, memory: Memory, phi: Array, states: Array) -> tuple[Any, Array, list[float]]:
    """Return joint springs that have the same torques as springs and creep branches together, the rates of the creep
    states, and the power [W] that creep dissipates.

    At a given state, creep acts as stiffer springs with other rest angles. In space it is added as a linear function,
    which the strain of a segment does not multiply.
    """
    joints, rows = chain.joints, chain.remembering
    share, tau = np.array(memory.creep_share), np.array(memory.creep_time)
    xi, stiff = states.reshape(rows, -1), 1.0 + share.sum()
    left = chain.joint_coordinates(phi)[:rows, None] - xi
    rates, power = (left / tau).ravel(), [joints.K[:rows] @ (left**2 @ (share / tau))]
    if chain.dimension == 3:
        line = np.stack([-xi @ share, np.full(rows, share.sum()), np.zeros(rows)], axis=1)
        return joints._replace(line=line), rates, power
    K, rest = joints.K.copy(), joints.theta0.copy()
    K[:rows] *= stiff
    rest[:rows] += xi @ share / stiff
    return joints._replace(K=K, theta0=rest), rates, power


def torque_and_rates(
    own: symbols.ChamberConstants, p: float, slow: Array, wall: Array
) -> tuple[float, tuple[Array, Array]]:
    """Return the torque [N m] of a chamber at pressure p [Pa], and the rates of its lagged pressure and stretch.

    There is none or one of each slow state.
    """
    late, y = (slow[0] if slow.size else p), (wall[0] if wall.size else 1.0)
    slow_rate, growth = slow_rates(p, late, y, own)
    return float(torque_now(p, late, y, own)), (0.0 * slow + slow_rate, 0.0 * wall + growth)


def jacobian_of(model: Model, valve: Valves) -> Callable[[float, Array], Array]:
    """Return a function for the exact Jacobian of the solver's states, for models without creep, lag or inflation."""
    n, rows, gain = model.size, layout(model), model.actuation.gain
    body, joints, scratch = mechanics_of(model).parts()
    solve = twin(ldl_solve)
    differentiate = mechanics_of(model).acceleration_jacobian()
    out = symbols.Slopes(np.empty(n), np.empty((n, n)), np.empty((n, n)))
    T = mechanics_of(model).to_joints  # to the angles and rates of joints
    share = gain @ T  # of a torque, on each absolute angle

    def jacobian(t: float, y: Array) -> Array:
        behind = [valve(c, t, y) for c in range(len(gain))]
        torques = model.actuation.torques([p for p, _, _ in behind])
        torque = np.zeros(n)
        for c, chamber_torque in enumerate(torques):
            share_out(c, chamber_torque, gain, torque)
        phi, w = y[:n].copy(), y[n : 2 * n].copy()
        differentiate(phi, w, torque, body, joints, scratch, out)
        J = np.zeros((y.size, y.size))
        J[:n, n : 2 * n] = np.eye(n)
        J[n : 2 * n, :n] = out.a_phi.T
        J[n : 2 * n, n : 2 * n] = out.a_w.T
        J[-2:, n : 2 * n] = torques @ share, 2.0 * (joints.D * (T @ w)) @ T
        for c, (p, _, by_valve) in enumerate(behind):
            if by_valve.any():
                column = rows.chambers[c].p
                push = share[c] * model.chambers[c].law_slope(p)
                J[-2, column] = push @ w
                solve(scratch.A, push)
                J[n : 2 * n, column] = push
                J[column : column + 2, column : column + 2] = by_valve
        return J

    return jacobian


def behind_valve(valve: Valve, u: float, state: Array) -> tuple[float, Array, Array]:
    """Return the pressure [Pa] behind a valve under a command u [Pa], and the rates and Jacobian of the valve's state.
    The state holds the pressure and its rate.
    """
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
