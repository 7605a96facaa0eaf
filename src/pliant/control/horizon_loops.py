"""Compiled loops that predict a valve's pressure and the motion of the actuator over a horizon."""

from __future__ import annotations

from pliant.equations.linearised import step_jacobian


def valve_ahead(sent, by_node, pieces, state, scratch, values, slopes):
    """Write a valve's r states at the ends of K periods to `values` (K, r), and their derivatives with respect to the
    commands at the N node times of a plan to `slopes` (K, r, N).

    Each period begins under the previous command and ends under the next one: `sent` (K + 1,) holds the commands in
    order, and `by_node` (K + 1, N) their derivatives. `pieces` are (A, B), of shapes (2, 2, r, r) and (2, 2, r): the
    exact step of each part of a period, for a command below and above the pressure. `state` (r,) is updated in place;
    `scratch` is (r, N + 1).
    """
    A, B = pieces
    r = len(state)
    N = by_node.shape[1]
    for k in range(len(values)):
        for i in range(r):
            for j in range(N):
                slopes[k, i, j] = slopes[k - 1, i, j] if k > 0 else 0.0
        for piece in range(2):
            command = sent[k + piece]
            side = 1 if command > state[0] else 0
            for i in range(r):
                for j in range(N):
                    scratch[i, j] = B[piece, side, i] * by_node[k + piece, j]
                scratch[i, N] = B[piece, side, i] * command
                for m in range(r):
                    for j in range(N):
                        scratch[i, j] = scratch[i, j] + A[piece, side, i, m] * slopes[k, m, j]
                    scratch[i, N] = scratch[i, N] + A[piece, side, i, m] * state[m]
            for i in range(r):
                for j in range(N):
                    slopes[k, i, j] = scratch[i, j]
                state[i] = scratch[i, N]
        for i in range(r):
            values[k, i] = state[i]


def body_ahead(x, v, h, torque, chain, places, rates, jacobians):
    """Integrate the motion of N coordinates over K steps of `h` [s]. Write positions to `places` (K, N), rates to
    `rates` (K, N), and to `jacobians` the derivatives of the state after each step
    with respect to the state before it and the torques.

    `x` and `v` (N,) are updated in place. `torque` (K, N + R) [N m] is held over each step, with tendon commands last.
    The Jacobians of `step_jacobian` are written to `jacobians` (K, 3 N + R, 2 N). `chain` holds (body, joints, slopes),
    where `slopes` is the result of `Mechanics.slopes`.
    """
    body, joints, slopes = chain
    J = slopes.J
    for k in range(len(torque)):
        step_jacobian(x, v, h, torque[k], body, joints, slopes)
        for a in range(J.shape[0]):
            for b in range(J.shape[1]):
                jacobians[k, a, b] = J[a, b]
        for i in range(len(x)):
            places[k, i] = x[i]
            rates[k, i] = v[i]
