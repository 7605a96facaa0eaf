"""The arithmetic of a prediction over a horizon, compiled: a valve and a body under commands that are known."""

from __future__ import annotations

from pliant.equations.linearised import step_jacobian


def valve_ahead(sent, by_node, pieces, state, scratch, values, slopes):
    """States of a valve at the ends of K periods, and their derivatives by the N numbers that make its commands.

    Each period begins with the command before and ends with the next one: `sent` (K + 1,) in order, their derivatives
    `by_node` (K + 1, N). `pieces` are (A, B), (2, 2, r, r) and (2, 2, r): the exact step of each piece of a period, for
    a command below and above the pressure. `state` (r,) moves in place; `scratch` is (r, N + 1).
    `values` (K, r) and `slopes` (K, r, N) take the results.
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
    """Angles and rates (K, N) at the ends of K steps of h [s] from x and v (N,), which move in place.

    `torque` (K, N + R) [N m] is held over each step, with commands of tendons behind; `jacobians` (K, 3 N + R, 2 N)
    takes those of `step_jacobian`. `chain` are (body, joints, work, slopes, J): what `Mechanics.slopes` returns, and J
    of it.
    """
    body, joints, work, slopes, J = chain
    for k in range(len(torque)):
        step_jacobian(x, v, h, torque[k], body, joints, work, slopes)
        for a in range(J.shape[0]):
            for b in range(J.shape[1]):
                jacobians[k, a, b] = J[a, b]
        for i in range(len(x)):
            places[k, i] = x[i]
            rates[k, i] = v[i]
