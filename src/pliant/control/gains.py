"""The linear-quadratic regulator of outputs by one pressure or several about one rest.

The state holds angles, rates, valves, the commands on their way and the integrals of the outputs' errors. Only those
combinations of the outputs are integrated that the pressures move at rest: of a straight body the tip's x alone. What
is weighed is the outputs' error and the command; not the sum of the angles, whose lightly damped zeros near 9 Hz would
set a bound to the damping, and not the first joint, whose zeros lie in the right half-plane.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pliant.control.steady_inputs import Rest
from pliant.control.tuning import Tuning
from pliant.errors import InputError
from pliant.linear.sampled import KILO, Margins, Sampled, loop_curve, margins, sample

Array = np.ndarray
DRIVEN = 0.02  # of what full pressures move most: a combination of outputs that they move less is not integrated
SQUARE = 1e6  # errors in mm and pressures in kPa: the Riccati equation's numbers stay near one


class Gains(NamedTuple):
    """The regulator about one rest: N states (angles, rates, valves, commands on their way, integrals), C chambers.

    Pressures of the state and the command are in kPa, integrals in m s of the m outputs, weighed.
    """

    rest: Rest
    slope: Array  # (n, C) rad/Pa, of the angles at rest by the pressures; (n + S, C) where segments lengthen
    inverse: Array  # (C, m) Pa/m, least pressures for a change of the outputs at rest
    driven: Array  # (m, m) projection on what the pressures move
    A: Array  # (N, N)
    B: Array  # (N, C)
    Q: Array  # (N, N)
    R: Array  # (C, C)
    K: Array  # (C, N) of the command
    P: Array  # (N, N) cost of a state that is left to the regulator
    preview: Array  # (C, N) of the command to a slope of the cost of the next state


def regulator(rest: Rest, weight: Array, highest: Array, clock: tuple[float, float], tuning: Tuning) -> Gains:
    """Gains about a rest; `weight` (m,) in metres for a unit of each output, `clock` period and latency, s.

    Weighed are the outputs' errors, speeds and integrals, and each command by what it does at rest.

    Raises
    ------
    InputError
        When the pressures move none of the outputs.
    """
    from scipy.linalg import solve_discrete_are

    linear, plant = rest.linear, sample(rest.linear, *clock)
    row, gain = weight[:, None] * rest.row, weight[:, None] * rest.gain
    U, size, V = np.linalg.svd(gain * highest, full_matrices=False)
    r = int(np.sum(size > DRIVEN * size[0])) if size[0] > 0 else 0
    if r == 0:
        raise InputError(
            f"at rest under {rest.pressure.max() * 1e-3:.4g} kPa no small pressure moves the tip or another output of "
            "the task, as where the torque law begins with the square: fit it with a linear term, torque_1, or ask for "
            "other outputs"
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
    """A, B and Q with the integrals of rows `tip` of the state as last states, their squares counting `worth`."""
    N, r = A.shape[0], tip.shape[0]
    more_A, more_Q = np.eye(N + r), np.zeros((N + r, N + r))
    more_A[:N, :N], more_A[N:, :N] = A, period * tip
    more_Q[:N, :N], more_Q[N:, N:] = Q, worth * np.eye(r)
    return more_A, np.vstack([B, np.zeros((r, B.shape[1]))]), more_Q


def loop_margins(gains: Gains, period: float) -> tuple[Margins, ...]:
    """Return the margins of each chamber's loop, the others closed, cut at the command."""
    found = []
    for c in range(gains.B.shape[1]):
        others = np.delete(gains.B, c, axis=1) @ np.delete(gains.K, c, axis=0)
        found.append(margins(loop_curve(Sampled(gains.A - others, gains.B[:, [c]], (0,)), gains.K[c], period)))
    return tuple(found)
