"""The equation of motion of a planar chain, Eq. (5): acceleration, its exact derivatives, and one linearly implicit
time step.

M ddq + (C + D) dq + K q = tau

All functions except the last use absolute angles phi with w = dphi/dt. M is then B_kl cos(phi_k - phi_l) with constant
B, springs and dampers are tridiagonal, and for up to about eight links this dense form needs less work than a
recursion. `acceleration_recursive` follows the paper's recursion in joint angles; a test checks that the two are equal.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.chain import body_hessian, body_jacobian
from pliant.equations.elastic import joint_tangents, joint_torques
from pliant.equations.inertia import coriolis_from_hessian, inertia_from_jacobians
from pliant.numerics.ldl import ldl_factor, ldl_solve


def acceleration(phi, w, torque, body, joints, work, a):
    """Write the angular accelerations a (n,) [rad/s^2] of the links at absolute link angles phi (n,) [rad] and rates w
    (n,) [rad/s].

    `torque` (n,) [N m] is the actuation torque of each joint.

    (M a)_k = t_k - t_{k+1} - g_k - sum_l B_kl sin(phi_k - phi_l) w_l^2;  `work.A` keeps the factors of M.

    Paper: Eq. (5) [eq:eom]
    """
    n = len(phi)
    c = work.c
    s = work.s
    A = work.A
    t = work.t
    for k in range(n):
        c[k] = np.cos(phi[k])
        s[k] = np.sin(phi[k])
    joint_torques(phi, w, joints, torque, 0.0, t)
    for k in range(n):
        a[k] = t[k] - t[k + 1] - body.h[k] * (body.gx * c[k] + body.gy * s[k])
        A[k, k] = body.B[k, k] + body.I[k]
    for k in range(n):
        for j in range(k):
            A[k, j] = body.B[k, j] * (c[k] * c[j] + s[k] * s[j])
            lever = body.B[k, j] * (s[k] * c[j] - c[k] * s[j])
            a[k] = a[k] - lever * w[j] * w[j]
            a[j] = a[j] + lever * w[k] * w[k]
    ldl_factor(A)
    ldl_solve(A, a)


def acceleration_jacobian(phi, w, torque, body, joints, work, out):
    """Write the link accelerations (n,) [rad/s^2] and their derivatives by the link angles phi and rates w to `out`, a
    `Slopes` record.

    Each row holds the derivatives by one variable, so that each right-hand side of the shared factors is contiguous.

    Paper: Eq. (5) [eq:eom], differentiated
    """
    a = out.a
    a_phi = out.a_phi
    a_w = out.a_w
    acceleration(phi, w, torque, body, joints, work, a)
    n = len(phi)
    c = work.c
    s = work.s
    for k in range(n):
        for j in range(n):
            a_phi[k, j] = 0.0 * a[0]
            a_w[k, j] = 0.0 * a[0]
        a_phi[k, k] = body.h[k] * (body.gx * s[k] - body.gy * c[k])
    for k in range(n):
        for j in range(k):
            cosine = body.B[k, j] * (c[k] * c[j] + s[k] * s[j])
            sine = body.B[k, j] * (s[k] * c[j] - c[k] * s[j])
            by_j = cosine * w[j] * w[j] - sine * a[j]  # d(residual of k)/d phi_j is -by_j
            by_k = cosine * w[k] * w[k] + sine * a[k]
            a_phi[j, k] = a_phi[j, k] + by_j
            a_phi[k, k] = a_phi[k, k] - by_j
            a_phi[k, j] = a_phi[k, j] + by_k
            a_phi[j, j] = a_phi[j, j] - by_k
            a_w[j, k] = a_w[j, k] - 2.0 * sine * w[j]
            a_w[k, j] = a_w[k, j] + 2.0 * sine * w[k]
    joint_tangents(phi, w, joints, 0.0, work.r)
    for i in range(n):  # spring and damper between link i-1 and link i
        a_phi[i, i] = a_phi[i, i] - work.r[i]
        a_w[i, i] = a_w[i, i] - joints.D[i]
        if i > 0:
            a_phi[i - 1, i - 1] = a_phi[i - 1, i - 1] - work.r[i]
            a_phi[i, i - 1] = a_phi[i, i - 1] + work.r[i]
            a_phi[i - 1, i] = a_phi[i - 1, i] + work.r[i]
            a_w[i - 1, i - 1] = a_w[i - 1, i - 1] - joints.D[i]
            a_w[i, i - 1] = a_w[i, i - 1] + joints.D[i]
            a_w[i - 1, i] = a_w[i - 1, i] + joints.D[i]
    for i in range(n):
        ldl_solve(work.A, a_phi[i])
        ldl_solve(work.A, a_w[i])


def step(phi, w, h, torque, body, joints, work):
    """Advance link angles phi (n,) and rates w (n,) in place by one step h [s] of the linearised implicit midpoint
    rule.

    `torque` (n,) [N m] is the mean actuation torque of each joint over the step.

    (M + h/2 D + h^2/4 (K' + G)) dw = h [tau - K q_m - K2 q_m^2 - K3 q_m^3 - D dq - g(q_m) - S(q_m) w_m^2],
    K' = K + 2 K2 q_m + 3 K3 q_m^2,  q_m = q + h/2 dq,  phi += h (w + dw/2),  w += dw

    Springs, dampers and the slope G of gravity are implicit, so that the linear part is stable at any step size. S w^2
    is evaluated at w_m = w + dw/2 by a second solve with the same factors, which makes the rule second order.

    Source: theory of linearly implicit one-step methods (Hairer and Wanner II, Sec. IV.7), written for Eq. (5) [eq:eom]
    """
    n = len(phi)
    half = 0.5 * h
    quarter = half * half
    c = work.c
    s = work.s
    A = work.A
    S = work.S
    r = work.r
    a = work.a
    t = work.t
    for k in range(n):
        c[k] = np.cos(phi[k] + half * w[k])
        s[k] = np.sin(phi[k] + half * w[k])
    joint_torques(phi, w, joints, torque, half, t)
    joint_tangents(phi, w, joints, half, a)
    for k in range(n):
        r[k] = h * (t[k] - t[k + 1] - body.h[k] * (body.gx * c[k] + body.gy * s[k]))
        slope = body.h[k] * (body.gy * c[k] - body.gx * s[k])
        A[k, k] = body.B[k, k] + body.I[k] + quarter * slope + half * joints.D[k] + quarter * a[k]
        for j in range(k):
            A[k, j] = body.B[k, j] * (c[k] * c[j] + s[k] * s[j])
            S[k, j] = body.B[k, j] * (s[k] * c[j] - c[k] * s[j])
    for k in range(1, n):
        implicit = half * joints.D[k] + quarter * a[k]
        A[k - 1, k - 1] = A[k - 1, k - 1] + implicit
        A[k, k - 1] = A[k, k - 1] - implicit
    ldl_factor(A)
    for k in range(n):
        t[k] = h * w[k] * w[k]
    centrifugal(S, t, r, a)
    ldl_solve(A, a)
    for k in range(n):
        middle = w[k] + 0.5 * a[k]
        t[k] = h * middle * middle
    centrifugal(S, t, r, a)
    ldl_solve(A, a)
    for k in range(n):
        phi[k] = phi[k] + h * (w[k] + 0.5 * a[k])
        w[k] = w[k] + a[k]


def centrifugal(S, square, r, a):
    """Subtract the centrifugal terms of a planar chain from the impulses r (n,) [N m s] of a time step, and write the
    difference to a (n,).

    a_k = r_k - sum_l S_kl square_l. `square` (n,) holds the time step times the squared rates. S (n, n) [kg m^2] is
    skew-symmetric and is given by its lower triangle.
    """
    n = len(r)
    for k in range(n):
        a[k] = r[k]
    for k in range(n):
        for j in range(k):
            a[k] = a[k] - S[k, j] * square[j]
            a[j] = a[j] + S[k, j] * square[k]


def acceleration_recursive(q, dq, torques, links, ddq):
    """Write the joint accelerations ddq (n,) [rad/s^2] from joint angles q and rates dq (n,), by the paper's recursion
    of Eqs. (4), (5).

    The sequence is Eq. (4) -> Jacobians -> M and C -> Eq. (5).

    `torques` (n,) [N m] is tau - K q - D dq, `links` a `symbols.Links`. Gravity enters through the Jacobians. This
    function allocates arrays and is slow; tests compare `acceleration` with it.

    Paper: Eqs. (4), (5) [eq:wvi_recursive] [eq:eom], by Godage et al., IJRR 35(6), 2016
    """
    l, theta0, m, c, I, m_tip, gx, gy, base_angle = links
    n = len(l)
    kind = (q + dq + torques).dtype
    J = np.zeros((n, 2, n), dtype=kind)
    J_tips = np.zeros((n, 2, n), dtype=kind)
    H = np.zeros((n, 2, n, n), dtype=kind)
    H_tips = np.zeros((n, 2, n, n), dtype=kind)
    M = np.zeros((n, n), dtype=kind)
    C = np.zeros((n, n), dtype=kind)
    body_jacobian(q, theta0, l, c, J)
    body_jacobian(q, theta0, l, l, J_tips)
    body_hessian(q, theta0, l, c, H)
    body_hessian(q, theta0, l, l, H_tips)
    inertia_from_jacobians(J, m, I, J_tips[n - 1], m_tip, M)
    coriolis_from_hessian(J, H, m, J_tips[n - 1], H_tips[n - 1], m_tip, dq, C)
    for a in range(n):
        ddq[a] = torques[a]
        for b in range(n):
            ddq[a] = ddq[a] - C[a, b] * dq[b]
    angle = base_angle
    for i in range(n):
        angle = angle + q[i] + theta0[i]
        fx = np.cos(angle) * gx + np.sin(angle) * gy  # gravity in the frame of link i
        fy = -np.sin(angle) * gx + np.cos(angle) * gy
        for a in range(n):
            ddq[a] = ddq[a] + m[i] * (J[i, 0, a] * fx + J[i, 1, a] * fy)
            if i == n - 1:
                ddq[a] = ddq[a] + m_tip * (J_tips[i, 0, a] * fx + J_tips[i, 1, a] * fy)
    ldl_factor(M)
    ldl_solve(M, ddq)
