"""Centrifugal and Coriolis matrix C of Eq. (5), in a form for which dM/dt - 2C is skew-symmetric."""

from __future__ import annotations


def coriolis_from_hessian(J, H, m, J_tip, H_tip, m_tip, dq, C):
    """Write the Coriolis matrix C (n, n) [N m s] of Eq. (5) in joint angles, from the Christoffel symbols of the
    inertia M.

    J (n, 2, n) and H (n, 2, n, n) are the body Jacobians and Hessians of the links' centres of mass.

    dM_ab/dq_r = sum_i m_i (H_i[:, a, r] . J_i[:, b] + J_i[:, a] . H_i[:, b, r])
    C_ab = sum_r 1/2 (dM_ab/dq_r + dM_ar/dq_b - dM_rb/dq_a) dq_r

    Paper: Eq. (5) [eq:eom], by the recursive formulation of Godage et al., IJRR 35(6), 2016
    """
    n = len(m)
    tip = (J_tip, H_tip, m_tip)
    for a in range(n):
        for b in range(n):
            total = 0.0 * dq[0]
            for r in range(n):
                total = total + 0.5 * dq[r] * (
                    inertia_derivative(J, H, m, tip, (a, b, r))
                    + inertia_derivative(J, H, m, tip, (a, r, b))
                    - inertia_derivative(J, H, m, tip, (r, b, a))
                )
            C[a, b] = total


def inertia_derivative(J, H, m, tip, at):
    """Return the derivative dM_ab/dq_r [kg m^2/rad] of an entry of the inertia matrix with respect to a joint angle.
    `at` holds the indices (a, b, r).

    `tip` is (J_tip, H_tip, m_tip): Jacobian, Hessian and mass [kg] of the cap at the tip.

    The other arguments are those of `coriolis_from_hessian`.
    """
    a, b, r = at
    J_tip, H_tip, m_tip = tip
    value = m_tip * (
        H_tip[0, a, r] * J_tip[0, b] + H_tip[1, a, r] * J_tip[1, b]
        + J_tip[0, a] * H_tip[0, b, r] + J_tip[1, a] * H_tip[1, b, r]
    )
    for i in range(len(m)):
        value = value + m[i] * (
            H[i, 0, a, r] * J[i, 0, b] + H[i, 1, a, r] * J[i, 1, b]
            + J[i, 0, a] * H[i, 0, b, r] + J[i, 1, a] * H[i, 1, b, r]
        )
    return value


def coriolis_absolute(c, s, B, w, C):
    """Write the Coriolis matrix C (n, n) [N m s] in absolute link angles, from their cosines c, sines s and rates w
    [rad/s].

    c = cos(phi), s = sin(phi), w = dphi/dt for absolute angles phi (n,) [rad].

    C_kl = B_kl sin(phi_k - phi_l) w_l;  Mdot - 2C = -B_kl sin(phi_k - phi_l) (w_k + w_l) is skew-symmetric
    """
    n = len(c)
    for k in range(n):
        for j in range(n):
            C[k, j] = B[k, j] * (s[k] * c[j] - c[k] * s[j]) * w[j]
