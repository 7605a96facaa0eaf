"""Generalized inertia matrix M of Eq. (5) of a planar chain, in joint angles and in absolute link angles."""

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
