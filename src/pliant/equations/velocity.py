"""Velocities of the links of a planar chain, Eq. (4), with their Jacobians and Hessians, in the frame of each link."""

from __future__ import annotations

import numpy as np


def body_velocities(q, dq, theta0, l, omega, v):
    """Write the angular velocity omega (n,) [rad/s] and tip velocity v (n, 2) [m/s] of each link, in its own frame,
    from joint angles q and rates dq.

    Omega_i = R_i^T (Omega_{i-1} R_i + dR_i/dt)               ->  omega_i = omega_{i-1} + dq_i
    upsilon_i = R_i^T (upsilon_{i-1} + Omega_{i-1} p_i + dp_i/dt)  with p_i = R_i (0, l_i)

    Paper: Eq. (4) [eq:wvi_recursive]; omega = [Omega]_21 where the paper prints [Omega]_12.  # D3
    """
    w = 0.0 * dq[0]
    vx = w
    vy = w
    for i in range(len(l)):
        c = np.cos(q[i] + theta0[i])
        s = np.sin(q[i] + theta0[i])
        px = -s * l[i]
        py = c * l[i]
        # Omega_{i-1} p_i = w (-py, px);  dp_i/dt = dq_i (-py, px)
        ux = vx - w * py - dq[i] * py
        uy = vy + w * px + dq[i] * px
        vx = c * ux + s * uy
        vy = -s * ux + c * uy
        w = w + dq[i]
        omega[i] = w
        v[i, 0] = vx
        v[i, 1] = vy


def body_jacobian(q, theta0, l, c, J):
    """Write the Jacobians J (n, 2, n) [m/rad] that map the joint rates to the velocity of one point on each of n links,
    in the link's own frame. The point of link i lies at the distance c_i [m] along the link.

    v_i = J_i dq and J_i = R_i^T J_{i-1} - l_i e_x 1_{m<=i}, with c_i in place of l_i in the last step. The angular
    velocity is omega_i = sum_{m<=i} dq_m.

    Source: Godage et al., IJRR 35(6), 2016, for the planar chain; from Eq. (4) [eq:wvi_recursive]
    """
    n = len(l)
    for m in range(n):
        ux = 0.0 * q[0]
        uy = 0.0 * q[0]
        for i in range(n):
            if i < m:
                J[i, 0, m] = ux
                J[i, 1, m] = uy
                continue
            cq = np.cos(q[i] + theta0[i])
            sq = np.sin(q[i] + theta0[i])
            turned = cq * ux + sq * uy
            uy = -sq * ux + cq * uy
            J[i, 0, m] = turned - c[i]
            J[i, 1, m] = uy
            ux = turned - l[i]


def body_hessian(q, theta0, l, c, H):
    """Write the Hessians H (n, 2, n, n) [m/rad^2] of one point on each of n links: the derivatives with respect to the
    joint angles of its Jacobian in the link's frame. The point of link i lies at the distance c_i [m] along the link.

    H[i, :, m, k] = dJ_i[:, m] / dq_k

    H_i[:, m, k] = R^{iT} (p^{k-1} - p^{m-1}) for m < k <= i, else 0, with J of `body_jacobian`. Seen from link i, a
    turn of joint k turns the part of the chain before it.

    Source: Godage et al., IJRR 35(6), 2016, for the planar chain
    """
    n = len(l)
    for i in range(n):
        for m in range(n):
            for k in range(n):
                H[i, 0, m, k] = 0.0 * q[0]
                H[i, 1, m, k] = 0.0 * q[0]
        for m in range(i + 1):
            x = 0.0 * q[0]
            y = 0.0 * q[0]
            for k in range(m + 1, i + 1):
                # (x, y) = p^{k-1} - p^{m-1} in the frame of link k-1, then carried on to link i
                cq = np.cos(q[k - 1] + theta0[k - 1])
                sq = np.sin(q[k - 1] + theta0[k - 1])
                turned = cq * x + sq * y
                y = -sq * x + cq * y + l[k - 1]
                x = turned
                ax = x
                ay = y
                for j in range(k, i + 1):
                    cj = np.cos(q[j] + theta0[j])
                    sj = np.sin(q[j] + theta0[j])
                    turned = cj * ax + sj * ay
                    ay = -sj * ax + cj * ay
                    ax = turned
                H[i, 0, m, k] = ax
                H[i, 1, m, k] = ay
