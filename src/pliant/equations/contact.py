"""Forces at points of the body: what they do to the links, and the momentum that betrays them."""

from __future__ import annotations

import numpy as np


def point_force(phi, l, link, along, across, fx, fy, Q):
    """Generalized forces Q (n,) in absolute angles of a force (fx, fy) [N] at a point fixed to link `link`; N m.

    Q_k = f . dx/dphi_k = l_k n_k . f for k < link,  (a n_k - b e_k) . f for k = link,  0 beyond

    with e = (-sin, cos), n = (-cos, -sin), a `along` the link from its joint and b `across` it, m. Suffix sums of Q are
    the joint torques r_k = (x - p^{k-1}) x f.

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
    """Add to the joint torques work.tau (n,) those of forces at points of the links, N m.

    `load` (n, 2) is what each link carries times the force, so that Q_k = -(load_k0 cos phi_k + load_k1 sin phi_k), as
    weight does; tau_i takes the sum of Q_k over the links that it moves, k >= i. Angles are those `ahead` [s] along w.
    Where links lengthen, `extension.add_link_loads` stands here; in space `spatial_points.add_link_loads`.

    Source: `point_force`, with along f for a link's own point and l_k f for the links before it; across as (f_y, -f_x)
    """
    total = 0.0 * phi[0]
    for k in range(len(phi) - 1, -1, -1):
        angle = phi[k] + ahead * w[k]
        total = total - load[k, 0] * np.cos(angle) - load[k, 1] * np.sin(angle)
        work.tau[k] = work.tau[k] + total


def momentum(phi, w, body, p):
    """Generalized momentum p = M w (n,) in absolute angles, N m s."""
    n = len(phi)
    for k in range(n):
        p[k] = (body.B[k, k] + body.I[k]) * w[k]
        for j in range(n):
            if j != k:
                p[k] = p[k] + body.B[k, j] * np.cos(phi[k] - phi[j]) * w[j]


def momentum_rate(phi, w, t, body, rate):
    """Rate of the momentum (n,) that joint torques t (n + 1,) and gravity alone would make; N m.

    d(M w)_k/dt = t_k - t_{k+1} - g_k - sum_l B_kl sin(phi_k - phi_l) w_k w_l + Q_k,  here without Q

    The sum is C^T w: no derivative of a rate is needed to find Q.

    Source: De Luca and Mattone (2003), written for Eq. (5) [eq:eom]
    """
    n = len(phi)
    for k in range(n):
        rate[k] = t[k] - t[k + 1] - body.h[k] * (body.gx * np.cos(phi[k]) + body.gy * np.sin(phi[k]))
        for j in range(n):
            rate[k] = rate[k] - body.B[k, j] * np.sin(phi[k] - phi[j]) * w[k] * w[j]
