"""Gains of the linear-quadratic regulator of outputs by one or several pressures, about one equilibrium.

The state holds angles, rates, valve states, delayed commands and the integrals of the outputs' errors. Only those
combinations of the outputs are integrated that the pressures can change at equilibrium: for a straight body only the
tip's x. The cost weights the outputs' errors and the commands. It does not weight the sum of the angles, whose lightly
damped zeros near 9 Hz would limit the damping, nor the first joint, whose zeros lie in the right half-plane.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pliant.control.steady_inputs import Rest
from pliant.control.tuning import Tuning
from pliant.errors import InputError
from pliant.linear.sampled import KILO, Margins, Sampled, loop_curve, margins, sample

Array = np.ndarray
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
    found = []
    for c in range(gains.B.shape[1]):
        others = np.delete(gains.B, c, axis=1) @ np.delete(gains.K, c, axis=0)
        found.append(margins(loop_curve(Sampled(gains.A - others, gains.B[:, [c]], (0,)), gains.K[c], period)))
    return tuple(found)
