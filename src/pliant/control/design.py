"""Design of a linear-quadratic regulator that makes outputs such as the tip position follow a reference.

If the reference is a path that is known ahead, the optimal preview is added to the steady inputs.

Source: Anderson and Moore, Optimal Control: Linear Quadratic Methods, 1990, ch. 4

Gains of the linear-quadratic regulator of outputs by one or several pressures, about one equilibrium.

The state holds angles, rates, valve states, delayed commands and the integrals of the outputs' errors. Only those
combinations of the outputs are integrated that the pressures can change at equilibrium: for a straight body only the
tip's x. The cost weights the outputs' errors and the commands. It does not weight the sum of the angles, whose lightly
damped zeros near 9 Hz would limit the damping, nor the first joint, whose zeros lie in the right half-plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pliant.control.steady_inputs import (
    Rest,
    equilibria,
    output_values,
    output_weights,
    rest_under,
    steady_inputs,
    written,
)
from pliant.control.tuning import Limits, Tuning
from pliant.control.valve import SupplyValve, check_followed
from pliant.errors import InputError
from pliant.linear.sampled import KILO, Margins, Sampled, least_margins, loop_curve, margins, periods_late, sample
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation import state

Array = np.ndarray
APART = 0.04  # s between the equilibria about which a path is linearised
SHOWN = 5  # equilibria whose margins are shown


DRIVEN = 0.02  # least static gain, relative to the largest, of a combination of outputs that is integrated
SQUARE = 1e6  # errors in mm and pressures in kPa: the Riccati equation's numbers stay near one


class Gains(NamedTuple):
    """Gains and weights of the linear-quadratic regulator about one equilibrium, for N states, C chambers and m
    outputs.

    The states are angles, rates, valve states, delayed commands and integrals. Pressures of state and command are in
    kPa, integrals in m s of the m weighted outputs.
    """

    rest: Rest
    slope: Array  # (n, C) rad/Pa, static change of the angles by the pressures; (n + S, C) if segments lengthen
    inverse: Array  # (C, m) Pa/m, smallest pressures for a static change of the outputs
    driven: Array  # (m, m) projection on the output combinations that the pressures can change
    A: Array  # (N, N)
    B: Array  # (N, C)
    Q: Array  # (N, N)
    R: Array  # (C, C)
    K: Array  # (C, N) feedback gain of the command
    P: Array  # (N, N) cost to go of a state under the regulator
    preview: Array  # (C, N) gain of the command on a gradient of the next state's cost


def regulator(rest: Rest, weight: Array, highest: Array, clock: tuple[float, float], tuning: Tuning) -> Gains:
    """Compute the gains of the linear-quadratic regulator of m outputs by C pressures, about the equilibrium `rest`.

    `weight` (m,) is the length [m] that a unit of each output counts as, `highest` (C,) are the highest pressures [Pa],
    and `clock` holds control period and latency [s]. The cost weights the outputs' errors, speeds and integrals, and
    each command by its static effect.

    Raises
    ------
    InputError
        When the pressures cannot change any of the outputs.
    """
    from scipy.linalg import solve_discrete_are

    linear, plant = rest.linear, sample(rest.linear, *clock)
    row, gain = weight[:, None] * rest.row, weight[:, None] * rest.gain
    U, size, V = np.linalg.svd(gain * highest, full_matrices=False)
    r = int(np.sum(size > DRIVEN * size[0])) if size[0] > 0 else 0
    if r == 0:
        raise InputError(
            f"at rest under {', '.join(f'{p:.4g}' for p in rest.pressure)} (SI units) a small change of the inputs "
            "does not move the tip or any other output of the task, which happens if the torque law has no linear "
            "term: fit the model with the linear term torque_1, or choose other outputs"
        )
    basis, n, N, m = U[:, :r], linear.position.size, plant.A.shape[0], len(weight)
    unit = np.where(np.arange(N) < 2 * n, 1.0, KILO)
    A, B = plant.A * unit / unit[:, None], plant.B * KILO / unit[:, None]
    tip, move, size_of = np.zeros((m, N)), np.zeros((m, N)), np.linalg.norm(gain, axis=0)
    tip[:, :n], move[:, n : 2 * n] = row[:, :n], tuning.damping_time * row[:, :n]
    Q = tip.T @ tip + move.T @ move + 1e-9 * np.mean(row[:, :n] ** 2) * np.diag(np.arange(N) < 2 * n)
    R = SQUARE * tuning.effort * np.diag((np.maximum(size_of, 1e-3 * size_of.max()) * KILO) ** 2)
    some = with_integrals(A, B, SQUARE * Q, basis.T @ tip, clock[0], SQUARE * tuning.integral_time**-2)
    P = solve_discrete_are(*some, R)
    whole = np.zeros((N + r, N + m))  # from all integrals to those of `basis`
    whole[:N, :N], whole[N:, N:] = np.eye(N), basis.T
    preview = np.linalg.solve(R + some[1].T @ P @ some[1], some[1].T)
    full = with_integrals(A, B, SQUARE * Q, tip, clock[0], 0.0)
    return Gains(
        rest, -np.linalg.solve(linear.A, linear.B)[:n], highest[:, None] * (V[:r].T / size[:r]) @ basis.T,
        basis @ basis.T, *full[:2], whole.T @ some[2] @ whole, R, preview @ P @ some[0] @ whole, whole.T @ P @ whole,
        preview @ whole,
    )


def with_integrals(
    A: Array, B: Array, Q: Array, tip: Array, period: float, worth: float
) -> tuple[Array, Array, Array]:
    """Return the system matrices A, B and the weight Q after r states are appended: the time integrals of r outputs.

    `tip` (r, N) are the outputs as rows of the state, and `worth` is the weight of the integrals.
    """
    N, r = A.shape[0], tip.shape[0]
    more_A, more_Q = np.eye(N + r), np.zeros((N + r, N + r))
    more_A[:N, :N], more_A[N:, :N] = A, period * tip
    more_Q[:N, :N], more_Q[N:, N:] = Q, worth * np.eye(r)
    return more_A, np.vstack([B, np.zeros((r, B.shape[1]))]), more_Q


def loop_margins(gains: Gains, period: float) -> tuple[Margins, ...]:
    """Return the stability margins of each chamber's control loop with the other loops closed."""
    each = []
    for c in range(gains.B.shape[1]):
        others = np.delete(gains.B, c, axis=1) @ np.delete(gains.K, c, axis=0)
        each.append(margins(loop_curve(Sampled(gains.A - others, gains.B[:, [c]], (0,)), gains.K[c], period)))
    return tuple(each)


@dataclass(frozen=True)
class LqrDesign:
    """Result of a regulator design: for every control period, the reference of the outputs, the pressures that hold
    them there, and the linear-quadratic gains about this equilibrium.

    Attributes
    ----------
    model : Model
    outputs : tuple of str
    still : array (m,)
        Values of the outputs without pressure.
    period, latency : float
        Control period, and age of the measured state [s].
    gains : tuple of Gains
    at : array (K,)
        Index of the gains to use in each period.
    wanted : array (K, m)
        Reference of the outputs, as changes from `still`.
    pressure, angle : array (K, C), (K, n)
        Pressures [Pa] and angles [rad] of the reference equilibrium; (K, n + S), strains last, if the body lengthens.
    beside : array (K, N)
        Deviation of the reference state from that equilibrium [rad, rad/s, kPa]: its rates and, on a planned
        trajectory, the dynamic deviation of the model. It is 0 in the last period, which is held.
    lead, ahead : array (K, C), (K + 1, N)
        Preview of the later reference: addition to the steady inputs [kPa], and gradient of the cost by the state.
    path : bool
        Whether the reference is a path that is known ahead.
    tuning : Tuning
    late : int
        Number of periods by which the measured state is late.
    supply : tuple of SupplyValve or None
        The rig's valve of each chamber, None to use the model's; empty: the model's valve for all chambers.
    along : (array (K,), array (K, m)), optional
        For one chamber: target displacement of the tip [m] and direction of its path.
    """

    model: Model
    outputs: tuple[str, ...]
    still: Array
    period: float
    latency: float
    gains: tuple[Gains, ...]
    at: Array
    wanted: Array
    pressure: Array
    angle: Array
    beside: Array
    lead: Array
    ahead: Array
    path: bool
    tuning: Tuning
    late: int
    supply: tuple[SupplyValve | None, ...] = ()
    along: tuple[Array, Array] | None = None

    @cached_property
    def waiting(self) -> tuple[int, ...]:
        """Number of commands in transit to each chamber because of dead time and latency. One command is sent per
        control period.
        """
        late = (c.valve.dead_time + self.latency for c in self.model.chambers)
        return tuple(periods_late(t, self.period)[2] for t in late)

    @cached_property
    def orders(self) -> tuple[int, ...]:
        """Number of valve states of each chamber: 0 (no lag), 1 (first order) or 2 (second order)."""
        valves = (c.valve for c in self.model.chambers)
        return tuple(2 if v.natural_frequency else int(v.rise_time + v.fall_time > 0) for v in valves)

    @cached_property
    def resting(self) -> Array:
        """Steady values (N, C) of the N regulator states: column c is for a constant pressure of 1 kPa in chamber c of
        C and none in the others. Only valve states and commands in transit are filled in; the other states are 0.
        """
        steady, first = np.zeros((self.gains[0].A.shape[0], len(self.orders))), 2 * self.model.size
        for sizes, count in ((self.orders, 1), (self.waiting, None)):  # the valve's pressure is 1, its rate is 0
            for c, size in enumerate(sizes):
                steady[first : first + size, c][:count] = 1.0
                first += size
        return steady

    def periods(self, first: int, count: int) -> Array:
        """Return the indices (count,) of `count` periods from `first` on. Beyond the end of the reference the last one
        is repeated.
        """
        return np.minimum(np.arange(first, first + count), len(self.at) - 1)

    def shift(self, k: int) -> Array:
        """Return how much the N regulator states change (N,) relative to the reference because the reference moves from
        period k to k + 1.
        """
        then, n = min(k + 1, len(self.at) - 1), self.model.size
        out = self.gains[self.at[k]].A @ self.beside[k] - self.beside[then]
        out[:n] += self.angle[k] - self.angle[then]
        return np.asarray(out + self.resting @ (self.pressure[k] - self.pressure[then]) / KILO)

    @cached_property
    def margins(self) -> dict[int, tuple[Margins, ...]]:
        """Stability margins of each chamber's control loop with the other loops closed, for about five of the
        regulator's equilibria.

        The keys are indices into `gains`.
        """
        some = np.unique(np.linspace(0, len(self.gains) - 1, SHOWN).round().astype(int))
        return {int(k): loop_margins(self.gains[k], self.period) for k in some}

    @property
    def least_margins(self) -> Margins:
        """The smallest gain, phase and delay margins over all chambers and equilibria."""
        return least_margins(m for each in self.margins.values() for m in each)

    def __str__(self) -> str:
        rows = []
        for k, each in self.margins.items():
            level = written(self.model, self.gains[k].rest.pressure)
            rows += [f"{level}, {chamber.name}: {m}" for chamber, m in zip(self.model.chambers, each, strict=True)]
        return "\n".join(rows)


def design_outputs(
    model: Model, outputs: tuple[str, ...], wanted: Array, limits: Limits, period: float, *,
    tuning: Tuning | None = None, latency: float = 0.0, path: bool = False,
) -> LqrDesign:
    """Return a linear-quadratic regulator that uses one or several pressures to make outputs, such as the tip position,
    follow a reference.

    Parameters
    ----------
    model : Model
        Model with one or several chambers and their valves, without hysteresis or with it frozen; it may lengthen.
    outputs : tuple of str
        Names among tip_x, tip_y [m] and angle_sum [rad], the angle of the last link; in space also tip_z [m].
    wanted : array (K, m)
        Reference for each period: changes of the outputs from their values without pressure.
    limits : Limits
    period : float
        Control period [s].
    tuning : Tuning, optional
    latency : float
        Age of the measured state [s]; it is treated as additional dead time.
    path : bool
        True if the reference is a path, which is known ahead and followed while it moves. False if it consists of
        set-points at which the outputs come to rest.

    Raises
    ------
    InputError
        When the reference is out of reach or not finite, or a valve has a slow settling part, a dead band or an opening
        time.
    """
    wanted = np.asarray(wanted, dtype=float)
    check_reference(wanted, len(outputs))
    check_followed(model)
    tuning, highest = tuning or Tuning(), limits.each(model.actuation.count)
    weight = output_weights(model, outputs)
    still = output_values(model, mechanics_of(model).coordinates(state.equilibrium(model, 0.0)), outputs)
    knots = posts(wanted, max(1, round(APART / period)))
    known: dict[bytes, int] = {}
    gains: list[Gains] = []
    for row in wanted[knots]:
        if row.tobytes() not in known:
            start = gains[-1].rest.pressure if gains else np.zeros(highest.size)
            rest = steady_inputs(model, outputs, still + row, highest, start)
            known[row.tobytes()] = len(gains)
            gains.append(regulator(rest, weight, highest, (period, latency), tuning))
    index, rows = np.array([known[row.tobytes()] for row in wanted[knots]]), np.arange(len(wanted))
    pressure = between(rows, knots, [gains[i].rest.pressure for i in index])
    angle = between(rows, knots, [gains[i].rest.linear.position for i in index])
    beside = np.zeros((len(rows), gains[0].A.shape[0]))
    if path and len(rows) > 1:
        beside[:-1, model.size : 2 * model.size] = np.gradient(angle, period, axis=0)[:-1]  # the last row holds on
    lead, ahead = np.zeros_like(pressure), np.zeros((len(rows) + 1, gains[0].A.shape[0]))
    design = LqrDesign(
        model, outputs, still, period, latency, tuple(gains), index[np.searchsorted(knots, rows)], wanted, pressure,
        angle, beside, lead, ahead, path, tuning, round(latency / period),
    )
    if path:
        look_ahead(design)
    return design


def check_reference(wanted: Array, outputs: int) -> None:
    """Raise InputError unless a reference is finite and has the shape (K, outputs), with one row for each period."""
    if wanted.ndim != 2 or wanted.shape[1] != outputs or not len(wanted):
        raise InputError(
            f"the reference must have the shape (K, {outputs}), with a row for each of K periods and a column for each "
            f"output, got shape {wanted.shape}"
        )
    if bad := int((~np.isfinite(wanted)).sum()):
        raise InputError(f"the reference must be finite, but {bad} of its {wanted.size} numbers are not: correct them")


def design_lqr(
    model: Model, highest: float, period: float, *, tuning: Tuning | None = None, latency: float = 0.0, grid: int = 9,
) -> LqrDesign:
    """Return a linear-quadratic regulator of the tip position for a model with one chamber. It is designed about
    equilibria at pressures from 0 to `highest` [Pa].

    Parameters
    ----------
    model : Model
        Model with one chamber and its valve.
    highest : float
        Highest pressure [Pa].
    period : float
        Control period [s].
    tuning : Tuning, optional
    latency : float
        Age of the measured state [s]; it is treated as additional dead time.
    grid : int
        Number of pressures at which the model is linearised.

    Returns
    -------
    LqrDesign
        ``print(design)`` shows its stability margins.

    Raises
    ------
    InputError
        When `highest` is not positive, no small pressure moves the tip at rest, or the valve has a slow settling
        part, a dead band or an opening time.

    Examples
    --------
    >>> from pliant.control import design_lqr
    >>> design = design_lqr(model, highest=190e3, period=4e-3)  # doctest: +SKIP
    >>> print(design)  # doctest: +SKIP
    """
    check_followed(model)
    family, tuning, outputs = equilibria(model, highest), tuning or Tuning(), ("tip_x", "tip_y")
    limit, pressure = np.array([float(highest)]), np.linspace(0.0, highest, grid)[:, None]
    rests = [rest_under(model, p, outputs) for p in pressure]
    gains = tuple(regulator(rest, np.ones(2), limit, (period, latency), tuning) for rest in rests)
    angle, N = np.array([rest.linear.position for rest in rests]), gains[0].A.shape[0]
    return LqrDesign(
        model, outputs, family.tip[0], period, latency, gains, np.arange(grid),
        np.array([rest.value for rest in rests]) - family.tip[0], pressure, angle, np.zeros((grid, N)),
        np.zeros((grid, 1)), np.zeros((grid + 1, N)), False, tuning, round(latency / period),
    )


def posts(wanted: Array, apart: int) -> Array:
    """Choose the periods for which the model is linearised about its equilibrium, and return their indices. `wanted`
    (K, m) is the reference of m outputs in K periods.

    They are the first and last period, those where the reference starts or stops moving, and every `apart`-th one while
    it moves.
    """
    last = len(wanted) - 1
    moves = np.append(np.any(np.diff(wanted, axis=0) != 0.0, axis=1), False)
    turns = np.flatnonzero(np.diff(moves.astype(int))) + 1
    return np.unique(np.concatenate([[0, last], turns, np.arange(0, last + 1, apart)[moves[::apart]]]).astype(int))


def between(rows: Array, knots: Array, values: list[Array]) -> Array:
    """Return values (K, ...) at the K periods `rows`, interpolated linearly between the `values` at the periods
    `knots`.
    """
    return np.stack([np.interp(rows, knots, column) for column in np.array(values).T], axis=1)


def look_ahead(design: LqrDesign) -> None:
    """Compute, for each period, how the commands anticipate the later reference. `design.lead` receives the pressures
    to be added to the steady ones, and `design.ahead` the gradient of the cost with respect to the state.

    s_k = (A - B K)' (P d_k + s_(k+1)), with d_k = `shift`.
    """
    for k in range(len(design.at) - 1, -1, -1):
        gains = design.gains[design.at[k]]
        later = gains.P @ design.shift(k) + design.ahead[k + 1]
        design.lead[k] = -gains.preview @ later
        design.ahead[k] = (gains.A - gains.B @ gains.K).T @ later
