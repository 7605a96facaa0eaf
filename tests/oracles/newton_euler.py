"""Newton-Euler for a planar chain, written from forces and moments: no Jacobian, no Lagrangian, no M.

`inverse` gives the joint torques of a motion, `forward` the motion of given torques by articulated bodies.
Link i lies along +y of its own frame with its centre of mass at (0, c_i).
"""

from __future__ import annotations

import numpy as np


def turn(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def inverse(chain, q, dq, ddq):
    """Joint torques (n,) that make the chain move so, against inertia and gravity."""
    n = chain.n
    omega, alpha = np.cumsum(dq), np.cumsum(ddq)
    R = [turn(a) for a in q + chain.theta0]
    R[0] = turn(chain.base_angle) @ R[0]
    acceleration = -np.array([chain.gx, chain.gy])  # gravity as a base that accelerates upward
    force, moment = [], []
    for i in range(n):
        at_joint = R[i].T @ acceleration

        def point(r, at_joint=at_joint, i=i):
            return at_joint + np.array([-alpha[i] * r, -(omega[i] ** 2) * r])

        cap = chain.m_tip * point(chain.l[i]) if i == n - 1 else np.zeros(2)
        body = chain.m[i] * point(chain.c[i])
        force.append(body + cap)
        moment.append(chain.I[i] * alpha[i] - chain.c[i] * body[0] - chain.l[i] * cap[0])
        acceleration = point(chain.l[i])
    F, N, torques = np.zeros(2), 0.0, np.zeros(n)
    for i in reversed(range(n)):
        beyond = R[i + 1] @ F if i + 1 < n else np.zeros(2)
        N = N + moment[i] - chain.l[i] * beyond[0]
        F = force[i] + beyond
        torques[i] = N
    return torques


def forward(chain, q, dq, torques):
    """Joint accelerations (n,) by Featherstone's articulated-body algorithm, in planar vectors (moment, force)."""
    n = chain.n
    omega = np.cumsum(dq)
    X, inertia, bias, twist_rate = [], [], [], []
    for i in range(n):
        m, c, cap = chain.m[i], chain.c[i], chain.m_tip * (i == n - 1)
        first = m * c + cap * chain.l[i]
        second = chain.I[i] + m * c**2 + cap * chain.l[i] ** 2
        inertia.append(np.array([[second, -first, 0], [-first, m + cap, 0], [0, 0, m + cap]]))
        bias.append(np.array([0, 0, -(omega[i] ** 2) * first]))
        angle = q[i] + chain.theta0[i] + (chain.base_angle if i == 0 else 0.0)
        lever = np.eye(3)  # motion at the joint of link i from motion at the joint of link i - 1
        lever[1, 0] = -chain.l[i - 1] if i else 0.0
        rotate = np.eye(3)
        rotate[1:, 1:] = turn(angle).T
        X.append(rotate @ lever)
        carried = np.array([0, 0, -(omega[i - 1] ** 2) * chain.l[i - 1]]) if i else np.zeros(3)
        twist_rate.append(rotate @ carried)
    U, d, u = [None] * n, [0.0] * n, [0.0] * n
    for i in reversed(range(n)):
        U[i] = inertia[i][:, 0]
        d[i] = U[i][0]
        u[i] = torques[i] - bias[i][0]
        if i:
            rest = inertia[i] - np.outer(U[i], U[i]) / d[i]
            push = bias[i] + rest @ twist_rate[i] + U[i] * u[i] / d[i]
            inertia[i - 1] = inertia[i - 1] + X[i].T @ rest @ X[i]
            bias[i - 1] = bias[i - 1] + X[i].T @ push
    motion, ddq = np.array([0.0, -chain.gx, -chain.gy]), np.zeros(n)
    for i in range(n):
        motion = X[i] @ motion + twist_rate[i]
        ddq[i] = (u[i] - U[i] @ motion) / d[i]
        motion = motion + np.array([ddq[i], 0, 0])
    return ddq
