"""Positions, directions and velocities of the links of a planar chain: Eqs. (1)-(4). Joint i moves link i, and frame i
has its origin at the tip of link i. Velocities, their Jacobians and Hessians are in the frame of each link.
"""

from __future__ import annotations

import numpy as np


def link_transform(q, theta0, l, R, p):
    """Write the rotation R (2, 2) and the tip position p (2,) [m] of one link, in the frame of the previous link, for
    the joint angle q [rad].

    T_i = R_z(q_i + theta_i0) P_y(l_i),  p_i = R_i (0, l_i)

    Paper: Eq. (1) [eq:Ti]; printed R_y and P_z, its text and SE(2) mean R_z and P_y.  # D1
    """
    c = np.cos(q + theta0)
    s = np.sin(q + theta0)
    R[0, 0] = c
    R[0, 1] = -s
    R[1, 0] = s
    R[1, 1] = c
    p[0] = -s * l
    p[1] = c * l


def forward(q, theta0, l, R_rel, p_rel, R_abs, p_abs):
    """Write the rotations R_abs (n, 2, 2) and tip positions p_abs (n, 2) [m] of all n links in the base frame, from the
    joint angles q (n,) [rad].

    R_rel (n, 2, 2) and p_rel (n, 2) receive the same of each link in the frame of the link before it.

    T^i = prod_{k<=i} T_k,  R^i = R^{i-1} R_i,  p^i = p^{i-1} + R^{i-1} p_i

    Paper: Eq. (2) [eq:T^i] (the product ends at i, not n  # D2) and Eq. (3) [eq:Rp^i]
    """
    link_transform(q[0], theta0[0], l[0], R_abs[0], p_abs[0])
    for i in range(len(l)):
        link_transform(q[i], theta0[i], l[i], R_rel[i], p_rel[i])
    for i in range(1, len(l)):
        for a in range(2):
            p_abs[i, a] = p_abs[i - 1, a] + R_abs[i - 1, a, 0] * p_rel[i, 0] + R_abs[i - 1, a, 1] * p_rel[i, 1]
            for b in range(2):
                R_abs[i, a, b] = R_abs[i - 1, a, 0] * R_rel[i, 0, b] + R_abs[i - 1, a, 1] * R_rel[i, 1, b]


def absolute_angles(q, theta0, base_angle, phi):
    """Write the absolute angles of the links, from the +y axis, to phi (n,) [rad], from the joint angles q (n,) [rad].

    phi_i = base_angle + sum_{k<=i} (q_k + theta_k0)
    """
    angle = base_angle
    for i in range(len(q)):
        angle = angle + q[i] + theta0[i]
        phi[i] = angle


def relative_angles(phi, theta0, base_angle, q):
    """Write the joint angles to q (n,) [rad], measured from the rest shape, from the absolute link angles phi (n,)
    [rad].

    This is the inverse of `absolute_angles`.
    """
    before = base_angle
    for i in range(len(phi)):
        q[i] = phi[i] - before - theta0[i]
        before = phi[i]


def tips(phi, l, x0, y0, p):
    """Write the tip positions of the links to p (n, 2) [m], from the absolute link angles phi (n,) [rad] and lengths l
    (n,) [m].

    (x0, y0) [m] is the position of the first joint.

    p^i = p^{i-1} + l_i (-sin phi_i, cos phi_i)

    Paper: Eq. (3) [eq:Rp^i] in absolute angles
    """
    x = x0
    y = y0
    for i in range(len(l)):
        x = x - l[i] * np.sin(phi[i])
        y = y + l[i] * np.cos(phi[i])
        p[i, 0] = x
        p[i, 1] = y


def angles_from_tips(p, x0, y0, l, phi):
    """Write the lengths l (n,) [m] and absolute angles phi (n,) [rad] of the links whose tips are at p (n, 2) [m].

    (x0, y0) [m] is the position of the first joint.

    l_i = |p^i - p^{i-1}|,  phi_i = atan2(-dx, dy), continued so that neighbours differ by less than pi
    """
    x = x0
    y = y0
    before = 0.0
    for i in range(p.shape[0]):
        dx = p[i, 0] - x
        dy = p[i, 1] - y
        l[i] = np.sqrt(dx * dx + dy * dy)
        turn = np.arctan2(-dx, dy) - before
        before = before + turn - 2.0 * np.pi * np.floor(0.5 * turn / np.pi + 0.5)
        phi[i] = before
        x = p[i, 0]
        y = p[i, 1]


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
