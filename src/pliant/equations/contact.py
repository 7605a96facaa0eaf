"""Generalized forces of point forces on the links of a planar chain, and the generalized momentum used to detect
contact.
"""

from __future__ import annotations

import numpy as np


def point_force(phi, l, link, along, across, fx, fy, Q):
    """Write the generalized forces Q (n,) [N m] of one point force (fx, fy) [N] on link `link` of a planar chain with
    link angles phi (n,).

    Q is in absolute angles, the force in the base frame.

    Q_k = f . dx/dphi_k = l_k n_k . f for k < link,  (a n_k - b e_k) . f for k = link,  0 beyond

    with e = (-sin, cos), n = (-cos, -sin). a = `along` and b = `across` [m] are the distances of the point x along the
    link from its joint and across the link. Suffix sums of Q are the joint torques r_k = (x - p^{k-1}) x f.

    Source: virtual work of a point force on the chain of Eq. (3) [eq:Rp^i]
    """
    for k in range(len(phi)):
        c = np.cos(phi[k])
        s = np.sin(phi[k])
        normal = -c * fx - s * fy
        if k < link:
            Q[k] = l[k] * normal
        elif k == link:
            Q[k] = along * normal + across * (s * fx - c * fy)
        else:
            Q[k] = 0.0 * normal


def add_link_loads(phi, w, ahead, load, body, joints, work):
    """Add the joint torques [N m] due to external forces at points of the links to work.tau (n,).

    `load` (n, 2) [N m] holds for each link the sum of force times lever, so that, as for weight,
    Q_k = -(load_k0 cos phi_k + load_k1 sin phi_k). tau_i receives the sum of Q_k over the links which joint i moves,
    k >= i. The angles are phi + ahead w, with `ahead` in s. `extension.add_link_loads` does the same for links that
    lengthen, `spatial_points.add_link_loads` in space.

    Source: `point_force`, with along f for a link's own point and l_k f for the links before it; across as (f_y, -f_x)
    """
    total = 0.0 * phi[0]
    for k in range(len(phi) - 1, -1, -1):
        angle = phi[k] + ahead * w[k]
        total = total - load[k, 0] * np.cos(angle) - load[k, 1] * np.sin(angle)
        work.tau[k] = work.tau[k] + total


def momentum(phi, w, body, p):
    """Write the generalized momentum p = M w (n,) [N m s] of a planar chain, from absolute link angles phi (n,) [rad]
    and rates w [rad/s].
    """
    n = len(phi)
    for k in range(n):
        p[k] = (body.B[k, k] + body.I[k]) * w[k]
        for j in range(n):
            if j != k:
                p[k] = p[k] + body.B[k, j] * np.cos(phi[k] - phi[j]) * w[j]


def momentum_rate(phi, w, t, body, rate):
    """Write the rate (n,) [N m] that the generalized momentum of a planar chain would have without contact. t (n + 1,)
    [N m] holds the net torques of the n joints and then a 0, because no joint follows the last link.

    d(M w)_k/dt = t_k - t_{k+1} - g_k - sum_l B_kl sin(phi_k - phi_l) w_k w_l + Q_k,  here with Q = 0

    Q are the generalized forces of contact. The sum is C^T w. An observer finds Q by comparing this rate with the
    momentum, without differentiating w.

    Source: De Luca and Mattone (2003), written for Eq. (5) [eq:eom]
    """
    n = len(phi)
    for k in range(n):
        rate[k] = t[k] - t[k + 1] - body.h[k] * (body.gx * np.cos(phi[k]) + body.gy * np.sin(phi[k]))
        for j in range(n):
            rate[k] = rate[k] - body.B[k, j] * np.sin(phi[k] - phi[j]) * w[k] * w[j]
