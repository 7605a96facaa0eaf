"""Positions and directions of the links of a planar chain: Eqs. (1)-(3). Joint i moves link i, and frame i has its
origin at the tip of link i.
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
