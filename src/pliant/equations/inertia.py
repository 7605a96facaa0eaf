"""Generalized inertia matrix M and Coriolis matrix C of Eq. (5) of a planar chain, in joint angles and in absolute
link angles. dM/dt - 2C is skew-symmetric.
"""

from __future__ import annotations


def inertia_from_jacobians(J, m, I, J_tip, m_tip, M):
    """Write the inertia matrix M (n, n) [kg m^2] in joint angles, from the Jacobians J (n, 2, n) of the links' centres
    of mass.

    M = sum_i m_i J_i^T J_i + I_i 1_i^T 1_i + m_tip J_tip^T J_tip,  1_i = (1, ..., 1, 0, ..., 0) with i ones

    J_tip (2, n) is the Jacobian of the last link's tip, where the cap of mass m_tip [kg] sits.

    Paper: Eq. (5) [eq:eom], by the recursive formulation of Godage et al., IJRR 35(6), 2016
    """
    n = len(m)
    for a in range(n):
        for b in range(n):
            value = m_tip * (J_tip[0, a] * J_tip[0, b] + J_tip[1, a] * J_tip[1, b])
            for i in range(max(a, b), n):
                value = value + m[i] * (J[i, 0, a] * J[i, 0, b] + J[i, 1, a] * J[i, 1, b]) + I[i]
            M[a, b] = value


def body_constants(l, m, c, m_tip, B, h):
    """Write the constants of a planar chain's inertia in absolute angles: matrix B (n, n) [kg m^2] and first moments h
    (n,) [kg m].

    From link lengths l (n,) [m], masses m (n,) [kg], and the mass m_tip [kg] at the last tip.

    With a_jk = l_k (k < j), c_j (k = j), 0 (k > j):  B_kl = sum_j m_j a_jk a_jl + m_tip l_k l_l and
    h_k = sum_j m_j a_jk + m_tip l_k. c_j [m] is the distance of the centre of mass of link j from its joint.
    """
    n = len(l)
    for k in range(n):
        beyond = m_tip
        for j in range(k + 1, n):
            beyond = beyond + m[j]
        h[k] = m[k] * c[k] + beyond * l[k]
        B[k, k] = m[k] * c[k] * c[k] + beyond * l[k] * l[k]
        for j in range(k):
            B[j, k] = l[j] * h[k]
            B[k, j] = B[j, k]


def inertia_absolute(c, s, B, I, M):
    """Write the inertia matrix M (n, n) [kg m^2] in absolute link angles, from the cosines c and sines s of these
    angles.

    M_kl = B_kl cos(phi_k - phi_l) + I_k delta_kl
    """
    n = len(c)
    for k in range(n):
        for j in range(k):
            M[k, j] = B[k, j] * (c[k] * c[j] + s[k] * s[j])
            M[j, k] = M[k, j]
        M[k, k] = B[k, k] + I[k]


def to_joint_angles(X, Y):
    """Transform an inertia or Coriolis matrix X (n, n) from absolute link angles to joint angles, and write the result
    to Y.

    Y = T^T X T, with T the lower triangle of ones.

    This holds for M and for C, because phi = T q with a constant T.
    """
    n = X.shape[0]
    for a in range(n - 1, -1, -1):
        for b in range(n - 1, -1, -1):
            value = X[a, b]
            if a + 1 < n:
                value = value + Y[a + 1, b]
            if b + 1 < n:
                value = value + Y[a, b + 1]
            if a + 1 < n and b + 1 < n:
                value = value - Y[a + 1, b + 1]
            Y[a, b] = value


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
