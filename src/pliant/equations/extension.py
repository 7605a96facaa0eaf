"""Planar chain whose segments lengthen: Eq. (5) with one uniform axial strain as an additional coordinate for each
segment.

Coordinates are x = (phi_1 ... phi_n, e_1 ... e_S), rates v = dx/dt. Link k is st_k l_k long, st_k = 1 + sum_s a_ks e_s,
where a_ks is the fraction of link k that lies in segment s. Link 0 is the part between the origin and the first joint,
which lengthens too, and turns with the base alone. With u_k = st_k e(phi_k), e = (-sin, cos), n = (-cos, -sin), the
kinetic energy is 1/2 sum_kl B_kl u'_k . u'_l. B is the constant of the chain that does not lengthen, with the rotary
inertia on its diagonal, since the rotary inertia of a rod scales with its stretch in the same way. A payload with the
moment of inertia J at the last tip does not lengthen: it adds J to M_(phi n, phi n) alone. So

M_(phi k, phi l) = B_kl st_k st_l cos(phi_k - phi_l),  M_(phi k, e s) = st_k sum_l B_kl a_ls sin(phi_l - phi_k),
M_(e s, e t) = sum_kl a_ks a_lt B_kl cos(phi_k - phi_l)

All other inertial terms are the forces b_k = sum_l B_kl u''_l (`carried`), projected on n_k for phi_k and on e_k for
the strains. Chains without such segments use `motion` instead. Derived for Eq. (5) [eq:eom].
"""

from __future__ import annotations

import numpy as np

from pliant.equations.elastic import joint_tangents, joint_torques, spring_slope, spring_torque
from pliant.numerics.ldl import ldl_factor, ldl_solve


def place(x, v, ahead, body, joints, work):
    """Write the cosine and sine of the angle, and the stretch, of each link and of the part before joint 1 to `work`.
    The coordinates are x + ahead v, extrapolated by the time `ahead` [s] along the rates v.
    """
    n = len(joints.theta0)
    for k in range(n + 1):
        angle = joints.base_angle + ahead * joints.spin[0]
        if k > 0:
            angle = x[k - 1] + ahead * v[k - 1]
        stretch = 1.0
        for s in range(len(x) - n):
            stretch = stretch + body.share[k, s] * (x[n + s] + ahead * v[n + s])
        work.c[k] = np.cos(angle)
        work.s[k] = np.sin(angle)
        work.stretch[k] = stretch


def carried(body, work):
    """Multiply the constant inertia matrix B (n + 1, n + 1) by one vector per link, (work.ax, work.ay), and write the
    products to work.bx and work.by. Row 0 belongs to the part before the first joint.

    b_k = sum_l B_kl a_l, with a the vectors in work.ax, work.ay and b those in work.bx, work.by.

    One sweep in each direction suffices, because B_kl = l_k h_l for k < l.
    """
    last = len(body.l) - 1
    x = 0.0 * work.ax[0]
    y = 0.0 * work.ay[0]
    for k in range(last + 1):
        work.bx[k] = body.B[k, k] * work.ax[k] + body.h[k] * x
        work.by[k] = body.B[k, k] * work.ay[k] + body.h[k] * y
        x = x + body.l[k] * work.ax[k]
        y = y + body.l[k] * work.ay[k]
    x = 0.0 * x
    y = 0.0 * y
    for k in range(last, -1, -1):
        work.bx[k] = work.bx[k] + body.l[k] * x
        work.by[k] = work.by[k] + body.l[k] * y
        x = x + body.h[k] * work.ax[k]
        y = y + body.h[k] * work.ay[k]


def along_strain(s, body, work):
    """Return the generalized force of strain number s due to one force vector (work.bx, work.by) on the part before the
    first joint and on each of the n links.

    sum_k a_ks e_k . b_k, with a_ks the fraction of link k that lies in segment s and e_k the direction of link k.
    """
    value = 0.0 * work.bx[0]
    for k in range(len(body.l)):
        value = value + body.share[k, s] * (work.c[k] * work.by[k] - work.s[k] * work.bx[k])
    return value


def inertia(body, work, M):
    """Write the lower triangle of the inertia matrix M (n + S, n + S) of n link angles and S strains, for the link
    poses in `work`.

    `place` writes the poses of the links to `work`.
    """
    n = len(body.l) - 1
    c = work.c
    s = work.s
    for k in range(n):
        for j in range(k):
            stretched = body.B[k + 1, j + 1] * work.stretch[k + 1] * work.stretch[j + 1]
            M[k, j] = stretched * (c[k + 1] * c[j + 1] + s[k + 1] * s[j + 1])
        M[k, k] = body.B[k + 1, k + 1] * work.stretch[k + 1] * work.stretch[k + 1]
    M[n - 1, n - 1] = M[n - 1, n - 1] + body.tip_inertia
    for i in range(M.shape[0] - n):
        for k in range(n + 1):
            work.ax[k] = -body.share[k, i] * s[k]
            work.ay[k] = body.share[k, i] * c[k]
        carried(body, work)
        for k in range(n):
            M[n + i, k] = -work.stretch[k + 1] * (c[k + 1] * work.bx[k + 1] + s[k + 1] * work.by[k + 1])
        for j in range(i + 1):
            M[n + i, n + j] = along_strain(j, body, work)


def inertial_forces(v, body, joints, work, f):
    """Write the centrifugal, Coriolis and gravity forces f (n + S,) [N m] of n link angles and S strains, at the rates
    v (n + S,).

    f_k = st_k n_k . (b_k - h_k g),  f_s = sum_k a_ks e_k . (b_k - h_k g)

    with b of `carried` for the accelerations 2 st'_l w_l n_l - st_l w_l^2 e_l of the u_l at constant rates. That of the
    part before the first joint also has st_0 n_0 times the angular acceleration of the base.
    """
    n = len(body.l) - 1
    c = work.c
    s = work.s
    for k in range(n + 1):
        turn = joints.spin[0]
        if k > 0:
            turn = v[k - 1]
        growth = 0.0 * v[0]
        for i in range(len(f) - n):
            growth = growth + body.share[k, i] * v[n + i]
        inward = work.stretch[k] * turn * turn
        across = 2.0 * growth * turn
        if k == 0:
            across = across + work.stretch[k] * joints.spin[1]
        work.ax[k] = inward * s[k] - across * c[k]
        work.ay[k] = -inward * c[k] - across * s[k]
    carried(body, work)
    for k in range(n + 1):
        work.bx[k] = work.bx[k] - body.h[k] * body.gx
        work.by[k] = work.by[k] - body.h[k] * body.gy
    for k in range(n):
        f[k] = -work.stretch[k + 1] * (c[k + 1] * work.bx[k + 1] + s[k + 1] * work.by[k + 1])
    for i in range(len(f) - n):
        f[n + i] = along_strain(i, body, work)


def acceleration(x, v, torque, body, joints, work, a):
    """Write the accelerations a (n + S,) of n link angles [rad/s^2] and S segment strains [1/s^2], at coordinates x and
    rates v.

    `torque` (n + S,) [N m] is the actuation of each joint and each strain. `work.A` keeps the factors of M. The planar
    chain of constant length has `motion.acceleration`.

    Paper: Eq. (5) [eq:eom], of a body that lengthens
    """
    n = len(joints.theta0)
    t = work.t
    place(x, v, 0.0, body, joints, work)
    joint_torques(x, v, joints, torque, 0.0, t)
    inertial_forces(v, body, joints, work, work.f)
    for k in range(n):
        a[k] = t[k] - t[k + 1] - work.f[k]
    axial_forces(x, v, joints, torque, 0.0, a)
    for i in range(n, len(x)):
        a[i] = a[i] - work.f[i]
    inertia(body, work, work.A)
    ldl_factor(work.A)
    ldl_solve(work.A, a)


def axial_forces(x, v, joints, torque, ahead, f):
    """Write the net axial force of actuation, spring and damper in each of S segments, times the segment's length [N
    m], to the last S entries of f (n + S,).

    The law of the springs is that of the joints, with the strain in the place of the angle: EA e (1 + s e + a e^2) with
    bounded softening, see `elastic.spring_torque`. `ahead` [s] extrapolates x along the rates v.
    """
    n = len(joints.theta0)
    for i in range(n, joints.hardening.shape[1]):
        e = x[i] + ahead * v[i]
        f[i] = torque[i] - spring_torque(i, joints, e, e) - joints.D[i] * v[i]
    for i in range(joints.hardening.shape[1], len(x)):
        f[i] = torque[i] - joints.K[i] * (x[i] + ahead * v[i]) - joints.D[i] * v[i]
    for i in range(len(joints.rest)):
        f[n + i] = f[n + i] + joints.K[n + i] * joints.rest[i]


def step(x, v, h, torque, body, joints, work):
    """Advance n link angles and S strains x (n + S,), and their rates v, in place by one implicit step h [s] under the
    mean actuation `torque`.

    The rule is that of `motion.step`.

    Springs, dampers and the slope of gravity are implicit, for the axial springs as for the joints. Terms quadratic in
    the rates are evaluated at the rates in mid-step by a second solve with the same factors. `work.a` keeps the change
    of v.

    Source: as `motion.step`, written for Eq. (5) [eq:eom] of a body that lengthens
    """
    n = len(joints.theta0)
    half = 0.5 * h
    A = work.A
    r = work.r
    a = work.a
    t = work.t
    place(x, v, half, body, joints, work)
    joint_torques(x, v, joints, torque, half, t)
    for k in range(n):
        r[k] = h * (t[k] - t[k + 1])
    axial_forces(x, v, joints, torque, half, r)
    for i in range(n, len(x)):
        r[i] = h * r[i]
    inertia(body, work, A)
    joint_tangents(x, v, joints, half, a)
    for i in range(n, joints.hardening.shape[1]):
        a[i] = spring_slope(i, joints, x[i] + half * v[i])
    implicit_terms(half, body, joints, work, A)
    ldl_factor(A)
    inertial_forces(v, body, joints, work, work.f)
    for i in range(len(x)):
        a[i] = r[i] - h * work.f[i]
    ldl_solve(A, a)
    for i in range(len(x)):
        work.v[i] = v[i] + 0.5 * a[i]
    inertial_forces(work.v, body, joints, work, work.f)
    for i in range(len(x)):
        a[i] = r[i] - h * work.f[i]
    ldl_solve(A, a)
    for i in range(len(x)):
        x[i] = x[i] + h * (v[i] + 0.5 * a[i])
        v[i] = v[i] + a[i]


def implicit_terms(half, body, joints, work, A):
    """Add the damping, stiffness and gravity terms of an implicit time step to the lower triangle of its matrix A.
    `half` [s] is half of the step.

    The terms are h/2 D + h^2/4 (K + G), with h = 2 `half`.

    G is the slope of gravity: h_k st_k (g_y cos - g_x sin) on the diagonal of the angles, a_ks h_k (g_x cos + g_y sin)
    between an angle and a strain. `work.a` holds the slopes of the joint springs [N m/rad].
    """
    n = len(joints.theta0)
    quarter = half * half
    for k in range(n):
        c = work.c[k + 1]
        s = work.s[k + 1]
        spring = half * joints.D[k] + quarter * work.a[k]
        slope = body.h[k + 1] * work.stretch[k + 1] * (body.gy * c - body.gx * s)
        A[k, k] = A[k, k] + quarter * slope + spring
        if k > 0:
            A[k - 1, k - 1] = A[k - 1, k - 1] + spring
            A[k, k - 1] = A[k, k - 1] - spring
        weight = quarter * body.h[k + 1] * (body.gx * c + body.gy * s)
        for i in range(n, A.shape[0]):
            A[i, k] = A[i, k] + body.share[k + 1, i - n] * weight
    for i in range(n, joints.hardening.shape[1]):
        A[i, i] = A[i, i] + half * joints.D[i] + quarter * work.a[i]
    for i in range(joints.hardening.shape[1], A.shape[0]):
        A[i, i] = A[i, i] + half * joints.D[i] + quarter * joints.K[i]


def add_link_loads(x, v, ahead, load, body, joints, work):
    """Add the generalized forces [N m] of external forces on an extensible planar chain to work.tau (n + S,), for n
    joints and S strains.

    `load` (n + 1, 4) [N m] holds two vectors for each link, beginning with the part before the first joint: L_k, the
    sum of forces times their distance along the link, which stretches with it, and R_k, the sum of forces times their
    distance across the link, which does not stretch. Q_k = n_k . (st_k L_k + R_k) and Q_s = sum_k a_ks e_k . L_k, at
    the angles and strains x + ahead v (`ahead` in s).

    Source: virtual work, as `contact.add_link_loads`
    """
    n = len(body.l) - 1
    t = work.tau
    total = 0.0 * t[0]
    for k in range(n, -1, -1):
        angle = joints.base_angle + ahead * joints.spin[0]
        if k > 0:
            angle = x[k - 1] + ahead * v[k - 1]
        c = np.cos(angle)
        s = np.sin(angle)
        stretch = 1.0
        for i in range(len(x) - n):
            stretch = stretch + body.share[k, i] * (x[n + i] + ahead * v[n + i])
            t[n + i] = t[n + i] + body.share[k, i] * (load[k, 1] * c - load[k, 0] * s)
        if k > 0:
            total = total - (stretch * load[k, 0] + load[k, 2]) * c - (stretch * load[k, 1] + load[k, 3]) * s
            t[k - 1] = t[k - 1] + total


def kinetic_energy(x, v, body, joints, work):
    """Return the kinetic energy 1/2 v^T M v [J] of an extensible planar chain with coordinates x
    and rates v (n + S,).

    1/2 sum_k u'_k . b_k + 1/2 J w_n^2 with u'_k = st_k w_k n_k + st'_k e_k
    """
    n = len(joints.theta0)
    place(x, v, 0.0, body, joints, work)
    for k in range(n + 1):
        turn = 0.0 * v[0]
        if k > 0:
            turn = work.stretch[k] * v[k - 1]
        growth = 0.0 * v[0]
        for s in range(len(x) - n):
            growth = growth + body.share[k, s] * v[n + s]
        work.ax[k] = -turn * work.c[k] - growth * work.s[k]
        work.ay[k] = growth * work.c[k] - turn * work.s[k]
    carried(body, work)
    value = 0.5 * body.tip_inertia * v[n - 1] * v[n - 1]
    for k in range(n + 1):
        value = value + 0.5 * (work.ax[k] * work.bx[k] + work.ay[k] * work.by[k])
    return value


def gravity_energy(x, v, body, joints, work):
    """Return the gravitational energy -sum m (gx x + gy y) [J] of an extensible planar chain, 0 where all mass is at
    the origin.
    """
    place(x, v, 0.0, body, joints, work)
    value = 0.0 * x[0]
    for k in range(len(body.l)):
        value = value + body.h[k] * work.stretch[k] * (body.gx * work.s[k] - body.gy * work.c[k])
    return value
