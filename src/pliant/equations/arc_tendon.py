"""Tendons of a chain in space: tension by how far one is drawn in, torques on the joints, and their slope.

A tendon r at constant levers g_r (N,) [m] along its path has the length l_0 - g_r . x, exact for a body that bends in
arcs. Drawn in by u it pulls with T = k (u - g_r . x) + T_0, never with less than nothing where it can hang slack.
"""

from __future__ import annotations

import numpy as np


def tension(r, q, command, body):
    """Return the tension T [N] of tendon r at coordinates q (N,), and dT/ds, s = command + T_0 - k g . q.

    `command` is k u [N]. T = (s + sqrt(s^2 + e^2)) / 2: smooth where the tendon comes taut, over an edge of 2 e [N]; a
    pair of opposite tendons on one motor that never hang slack pulls with T = s.
    """
    s = command + body.pretension[r]
    for i in range(len(q)):
        s = s - body.tendon_stiffness[r] * (body.lever[r, i] * q[i])
    root = np.sqrt(s * s + body.edge[r] * body.edge[r])
    slack = 0.5 * body.slack[r]
    return s + slack * (root - s), 1.0 - slack + slack * (s / root)


def add_pull(q, torque, body, work):
    """Add to work.t (N,) the torques of all tendons at coordinates q (N,), and write them to work.pull; N m.

    What draws them in [N] is behind torque (N,).
    """
    n = len(q)
    for i in range(n):
        work.pull[i] = 0.0 * q[i]
    for r in range(len(body.tendon_stiffness)):
        T, _ = tension(r, q, torque[n + r], body)
        for i in range(n):
            work.pull[i] = work.pull[i] + body.lever[r, i] * T
    for i in range(n):
        work.t[i] = work.t[i] + work.pull[i]


def add_pull_slopes(q, quarter, torque, body, A):
    """Add to the lower triangle of A (N, N) `quarter` [s^2] times the stiffness of the taut tendons: k g g^T dT/ds."""
    n = len(q)
    for r in range(len(body.tendon_stiffness)):
        _, slope = tension(r, q, torque[n + r], body)
        stiff = quarter * (slope * body.tendon_stiffness[r])
        for i in range(n):
            for j in range(i + 1):
                A[i, j] = A[i, j] + stiff * (body.lever[r, i] * body.lever[r, j])
