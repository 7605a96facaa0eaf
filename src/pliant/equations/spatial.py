"""Chain of links in space: Eq. (5) with two swing angles at every joint, and optionally a twist angle.

Coordinates x = (a_1, b_1 ... a_n, b_n), then (c_1 ... c_n) where joints twist, all in rad. The rotation of link k is
R_k = P_k exp([a_k, b_k, 0]) Rz(c_k) with P_k = R_{k-1} R_rest,k. The link points along z_k, the third column of R_k.
R_0, of the part before the first joint, is constant. The functions use y = a^2 + b^2 and Stumpff's functions c_j(y):
exp(v) = c0 + c1 [v] + c2 v v^T, and its angular velocity is J_l dv/dt with J_l = 1 + c2 [v] + c3 [v]^2. These need no
branch, root or division, and are regular in all directions for swings below 2 pi.

All vectors are in the fixed axes of the world, so that no vector is transformed from link to link. A link is a body of
revolution with its centre of mass on its axis: its inertia is a mass and the moments along and across the axis.

Where segments lengthen, their strains (S,) follow the angles in x: `spatial_extension`.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.spatial_extension import (
    add_strain_inertia,
    lengthen_link,
    strain_forces,
    stretch_links,
    stretch_rates,
)
from pliant.equations.spatial_springs import add_spring_slopes, joint_torques
from pliant.numerics.ldl import ldl_factor, ldl_solve_by_columns

TERMS = 14  # of the series: exact to rounding for swings up to 4 rad
FACTORIALS = np.cumprod(np.arange(1.0, 2 * TERMS + 4))  # of 1, 2, 3 ...
C4 = tuple((-1.0) ** j / float(FACTORIALS[2 * j + 3]) for j in range(TERMS))  # (-1)^j / (2 j + 4)!
C5 = tuple((-1.0) ** j / float(FACTORIALS[2 * j + 4]) for j in range(TERMS))


def stumpff(y):
    """Return Stumpff's functions c2(y) and c3(y) and their derivatives by y, which describe rotations by an angle
    sqrt(y).

    c_k(y) = sum_j (-y)^j / (2 j + k)!

    They follow from the series of c4 and c5 with c_k = 1/k! - y c_{k+2} and c_k' = (k c_{k+2} - c_{k+1}) / 2. Exact to
    rounding for y <= 16.

    Source: Stiefel and Scheifele, Linear and Regular Celestial Mechanics (1971), Sec. 11
    """
    c4 = C4[TERMS - 1] * y + C4[TERMS - 2]
    c5 = C5[TERMS - 1] * y + C5[TERMS - 2]
    for j in range(TERMS - 3, -1, -1):
        c4 = c4 * y + C4[j]
        c5 = c5 * y + C5[j]
    c3 = 1.0 / 6.0 - y * c5
    return 0.5 - y * c4, c3, c4 - 0.5 * c3, 1.5 * c5 - 0.5 * c4


def pose_links(x, body, work):
    """Write rotation and start position of each link, and the rotation axis of each joint angle, to `work`, at the
    coordinates x (N,).

    work.R (n + 1, 3, 3) receives the rotations, work.r (n + 1, 3) the start positions [m], and work.S (T, 3) the axes
    of the T angles.

    R[0] and r[0] belong to the part before the first joint, and r[k] is the joint of link k, counted from 1. Row i of S
    is the angular velocity of all links beyond the joint for a unit rate of x_i. `work.P` (n, 3, 3) receives the frames
    of the joints, and `work.series` (n, 4) the results of `stumpff`.
    """
    n = len(body.mass)
    stretch_links(x, body, work)
    for i in range(3):
        work.r[0, i] = 0.0
        for j in range(3):
            work.R[0, i, j] = body.base[i, j]
    for k in range(n):
        for i in range(3):
            work.r[k + 1, i] = work.r[k, i] + work.length[k] * work.R[k, i, 2]
            for j in range(3):
                turned = work.R[k, i, 0] * body.rest[k, 0, j] + work.R[k, i, 1] * body.rest[k, 1, j]
                work.P[k, i, j] = turned + work.R[k, i, 2] * body.rest[k, 2, j]
        swing(k, x[2 * k], x[2 * k + 1], work)
        if len(work.S) > 2 * n:
            twist(2 * n + k, k + 1, x[2 * n + k], work)


def swing(k, a, b, work):
    """Write the rotation of link k after its joint swings by the rotation vector (a, b, 0) [rad] to `work`. Also write
    the axes about which the link turns when a or b changes.

    k counts from 0. `work.P` holds the frame of the joint before the swing.
    """
    y = a * a + b * b
    c2, c3, d2, d3 = stumpff(y)
    work.series[k, 0] = c2
    work.series[k, 1] = c3
    work.series[k, 2] = d2
    work.series[k, 3] = d3
    c1 = 1.0 - y * c3
    cross = c3 * a * b
    mixed = c2 * a * b
    for i in range(3):
        px = work.P[k, i, 0]
        py = work.P[k, i, 1]
        pz = work.P[k, i, 2]
        work.S[2 * k, i] = px * (1.0 - c3 * b * b) + py * cross - pz * (c2 * b)
        work.S[2 * k + 1, i] = px * cross + py * (1.0 - c3 * a * a) + pz * (c2 * a)
        work.R[k + 1, i, 0] = px * (1.0 - c2 * b * b) + py * mixed - pz * (c1 * b)
        work.R[k + 1, i, 1] = px * mixed + py * (1.0 - c2 * a * a) + pz * (c1 * a)
        work.R[k + 1, i, 2] = (px * b - py * a) * c1 + pz * (1.0 - c2 * y)


def twist(i, k, angle, work):
    """Turn link k about its own axis by `angle` [rad] in work.R, and write this axis to row i of work.S."""
    c = np.cos(angle)
    s = np.sin(angle)
    for j in range(3):
        x = work.R[k, j, 0]
        y = work.R[k, j, 1]
        work.S[i, j] = work.R[k, j, 2]
        first = c * x + s * y  # x and y may be views
        work.R[k, j, 1] = c * y - s * x
        work.R[k, j, 0] = first


def composites(body, work):
    """Write first moment C (n, 3) [kg m] and inertia J (n, 3, 3) [kg m^2] of each link together with all links beyond
    it to `work`.

    Both are about the joint at the start of the link. J is the link's own inertia plus
    J_next + m l^2 (1 - z z^T) + l (2 (z . C) 1 - z C^T - C z^T), with m the mass and C the first moment of the links
    beyond it.
    """
    n = len(body.mass)
    mass = 0.0 * body.mass[0]  # beyond the link
    for k in range(n - 1, -1, -1):
        length = work.length[k + 1]
        across = work.lateral[k] + body.mass[k] * work.centre[k] * work.centre[k] + mass * length * length
        moment = body.mass[k] * work.centre[k] + mass * length
        round_axis = body.axial[k] - across
        for i in range(3):
            z = work.R[k + 1, i, 2]
            work.C[k, i] = moment * z
            for j in range(i + 1):
                work.J[k, i, j] = round_axis * z * work.R[k + 1, j, 2]
            work.J[k, i, i] = work.J[k, i, i] + across
        if k < n - 1:
            carry(k, length, work)
        for i in range(3):
            for j in range(i):
                work.J[k, j, i] = work.J[k, i, j]
        mass = mass + body.mass[k]


def carry(k, length, work):
    """Add the first moment and inertia of the links beyond link k to those of link k in `work`. `length` [m] is that of
    link k.
    """
    along = 0.0 * length
    for i in range(3):
        along = along + work.R[k + 1, i, 2] * work.C[k + 1, i]
    for i in range(3):
        z = length * work.R[k + 1, i, 2]
        for j in range(i + 1):
            pair = z * work.C[k + 1, j] + length * work.R[k + 1, j, 2] * work.C[k + 1, i]
            work.J[k, i, j] = work.J[k, i, j] + work.J[k + 1, i, j] - pair
        work.J[k, i, i] = work.J[k, i, i] + 2.0 * length * along
        work.C[k, i] = work.C[k, i] + work.C[k + 1, i]


def inertia(quarter, body, work, A):
    """Write the lower triangle of the matrix A (N, N) of an implicit time step h: the inertia M plus h^2/4 times the
    gravity stiffness. `quarter` [s^2] is h^2/4.

    For coordinate i nearer to the base than j, M_ij = s_i . (J s_j + (r_j - r_i) x f_j) with f_j = s_j x C. The slope
    of gravity is s_i . (g x f_j), which equals a shift of r_j by `quarter` g. Between the two coordinates of a swing
    the slope is made symmetric. The contribution of the turn of their axes, which vanishes where the joint is straight,
    is neglected.

    Source: Featherstone, Rigid Body Dynamics Algorithms, Sec. 6.2, in fixed axes
    """
    n = len(body.mass)
    turns = len(work.S)
    composites(body, work)
    for j in range(turns):
        moment_of_turn(j, j // 2 if j < 2 * n else j - 2 * n, quarter, body, work)
    for j in range(turns):
        k = j // 2 if j < 2 * n else j - 2 * n
        for i in range(turns):
            before = i // 2 if i < 2 * n else i - 2 * n
            if before < k or (before == k and i <= j):
                value = work.S[i, 0] * work.N[j, 0] + work.E[i, 0] * work.F[j, 0]
                value = value + (work.S[i, 1] * work.N[j, 1] + work.E[i, 1] * work.F[j, 1])
                A[max(i, j), min(i, j)] = value + (work.S[i, 2] * work.N[j, 2] + work.E[i, 2] * work.F[j, 2])
    for k in range(n):
        i = 2 * k
        sc = work.S[i, 0] * work.C[k, 0] + work.S[i, 1] * work.C[k, 1] + work.S[i, 2] * work.C[k, 2]
        tc = work.S[i + 1, 0] * work.C[k, 0] + work.S[i + 1, 1] * work.C[k, 1] + work.S[i + 1, 2] * work.C[k, 2]
        sg = work.S[i, 0] * body.gx + work.S[i, 1] * body.gy + work.S[i, 2] * body.gz
        tg = work.S[i + 1, 0] * body.gx + work.S[i + 1, 1] * body.gy + work.S[i + 1, 2] * body.gz
        A[i + 1, i] = A[i + 1, i] + 0.5 * quarter * (sc * tg - sg * tc)
    add_strain_inertia(quarter, body, work, A)


def moment_of_turn(j, k, quarter, body, work):
    """Write the force and the moment about the origin that a unit acceleration of coordinate j requires, to row j of
    work.F and work.N.

    Row j of work.E receives E = r x s, for the axis s of the coordinate at the joint position r.

    Coordinate j belongs to link k, counted from 0. All three are rows of `work`.
    """
    sx = work.S[j, 0]
    sy = work.S[j, 1]
    sz = work.S[j, 2]
    x = work.r[k + 1, 0]
    y = work.r[k + 1, 1]
    z = work.r[k + 1, 2]
    fx = sy * work.C[k, 2] - sz * work.C[k, 1]
    fy = sz * work.C[k, 0] - sx * work.C[k, 2]
    fz = sx * work.C[k, 1] - sy * work.C[k, 0]
    work.E[j, 0] = y * sz - z * sy
    work.E[j, 1] = z * sx - x * sz
    work.E[j, 2] = x * sy - y * sx
    x = x + quarter * body.gx
    y = y + quarter * body.gy
    z = z + quarter * body.gz
    work.F[j, 0] = fx
    work.F[j, 1] = fy
    work.F[j, 2] = fz
    work.N[j, 0] = work.J[k, 0, 0] * sx + work.J[k, 0, 1] * sy + work.J[k, 0, 2] * sz + (y * fz - z * fy)
    work.N[j, 1] = work.J[k, 1, 0] * sx + work.J[k, 1, 1] * sy + work.J[k, 1, 2] * sz + (z * fx - x * fz)
    work.N[j, 2] = work.J[k, 2, 0] * sx + work.J[k, 2, 1] * sy + work.J[k, 2, 2] * sz + (x * fy - y * fx)


def inertial_forces(x, v, body, work, f):
    """Write the centrifugal, Coriolis and gravity forces f (N,) [N m] of a chain in space, at coordinates x and rates v
    (N,).

    `work` holds the pose at x. The accelerations of the links at zero acceleration of x are computed from the base,
    which accelerates by -g, to the tip. The moments which these need about each joint are summed from the tip to the
    base. The moment of one link is z x (c F + I_across z'') + I_along ((alpha . z) z + (omega . z) z').

    Source: Featherstone, Rigid Body Dynamics Algorithms, Sec. 5.3 (Newton and Euler, recursively), in fixed axes
    """
    n = len(body.mass)
    stretch_rates(v, body, work)
    for i in range(3):
        work.omega[i] = 0.0
        work.alpha[i] = 0.0
    work.lift[0] = -body.gx
    work.lift[1] = -body.gy
    work.lift[2] = -body.gz
    turn_base(body, work)
    for k in range(n):
        swing_rates(k, x, v, work)
        if len(work.S) > 2 * n:
            turn_on(work.S[2 * n + k], v[2 * n + k], work)
        link_force(k, body, work)
    for k in range(n - 1, -1, -1):
        if k < n - 1:
            pass_down(k, work.length[k + 1], work)
        for i in range(2 * k, 2 * k + 2):
            f[i] = work.S[i, 0] * work.M[k, 0] + work.S[i, 1] * work.M[k, 1] + work.S[i, 2] * work.M[k, 2]
        if len(work.S) > 2 * n:
            i = 2 * n + k
            f[i] = work.S[i, 0] * work.M[k, 0] + work.S[i, 1] * work.M[k, 1] + work.S[i, 2] * work.M[k, 2]
    strain_forces(body, work, f)


def turn_base(body, work):
    """Write the angular velocity and acceleration of a base that turns to `work`, and add the acceleration of the first
    joint about the origin to work.lift. A base that does not turn adds no operation.

    With u = st l z along the part before the first joint, u'' = alpha x u + omega x (omega x u) + 2 st' l omega x z.
    """
    if len(body.spin) > 0:
        for i in range(3):
            work.omega[i] = body.spin[0, i]
            work.alpha[i] = body.spin[1, i]
        for i in range(3):
            j = (i + 1) % 3
            m = (i + 2) % 3
            work.turn[i] = work.omega[j] * work.R[0, m, 2] - work.omega[m] * work.R[0, j, 2]
        twice = 0.0 * work.omega[0]
        if body.share.shape[1] > 0:
            twice = 2.0 * work.growth[0] * body.length[0]
        for i in range(3):
            j = (i + 1) % 3
            m = (i + 2) % 3
            second = work.alpha[j] * work.R[0, m, 2] - work.alpha[m] * work.R[0, j, 2]
            second = second + (work.omega[j] * work.turn[m] - work.omega[m] * work.turn[j])
            work.lift[i] = work.lift[i] + (work.length[0] * second + twice * work.turn[i])


def swing_rates(k, x, v, work):
    """Add the contribution of the swing of joint k to the angular velocity and the angular acceleration in `work`. Both
    are summed over the joints from base to tip.

    In the frame of the joint, at constant rates (da, db) of the swing, the derivative of J_l dv/dt by time is
    kappa (d3 b + c3 db, -(d3 a + c3 da), d2), with kappa = a db - b da and d_j the rate of c_j.
    """
    a = x[2 * k]
    b = x[2 * k + 1]
    da = v[2 * k]
    db = v[2 * k + 1]
    kappa = a * db - b * da
    growth = 2.0 * (a * da + b * db)
    c3 = work.series[k, 1]
    d3 = work.series[k, 3] * growth
    px = kappa * (d3 * b + c3 * db)
    py = -kappa * (d3 * a + c3 * da)
    pz = kappa * (work.series[k, 2] * growth)
    for i in range(3):
        work.alpha[i] = work.alpha[i] + (work.P[k, i, 0] * px + work.P[k, i, 1] * py + work.P[k, i, 2] * pz)
        work.turn[i] = work.S[2 * k, i] * da + work.S[2 * k + 1, i] * db
    turn_on(work.turn, 1.0, work)


def turn_on(axis, rate, work):
    """Add a rotation at `rate` [rad/s] about `axis` (3,) to the angular velocity and acceleration in `work`. The axis
    itself turns with the angular velocity before this addition.
    """
    tx = axis[0] * rate
    ty = axis[1] * rate
    tz = axis[2] * rate
    wx = work.omega[0]
    wy = work.omega[1]
    wz = work.omega[2]
    work.alpha[0] = work.alpha[0] + (wy * tz - wz * ty)
    work.alpha[1] = work.alpha[1] + (wz * tx - wx * tz)
    work.alpha[2] = work.alpha[2] + (wx * ty - wy * tx)
    work.omega[0] = wx + tx
    work.omega[1] = wy + ty
    work.omega[2] = wz + tz


def link_force(k, body, work):
    """Write the inertial and gravity force [N] of link k, and its moment about the joint [N m], to work.L[k] and
    work.M[k].

    work.lift, the acceleration of the joint less gravity, is updated for the next link.
    """
    wx = work.omega[0]
    wy = work.omega[1]
    wz = work.omega[2]
    x = work.R[k + 1, 0, 2]
    y = work.R[k + 1, 1, 2]
    z = work.R[k + 1, 2, 2]
    dx = wy * z - wz * y  # z'
    dy = wz * x - wx * z
    dz = wx * y - wy * x
    ux = (work.alpha[1] * z - work.alpha[2] * y) + (wy * dz - wz * dy)  # z''
    uy = (work.alpha[2] * x - work.alpha[0] * z) + (wz * dx - wx * dz)
    uz = (work.alpha[0] * y - work.alpha[1] * x) + (wx * dy - wy * dx)
    reach = body.mass[k] * work.centre[k]
    across = work.lateral[k] + reach * work.centre[k]
    hx = reach * work.lift[0] + across * ux
    hy = reach * work.lift[1] + across * uy
    hz = reach * work.lift[2] + across * uz
    spin = body.axial[k] * (wx * x + wy * y + wz * z)
    gain = body.axial[k] * (work.alpha[0] * x + work.alpha[1] * y + work.alpha[2] * z)
    work.M[k, 0] = y * hz - z * hy + gain * x + spin * dx
    work.M[k, 1] = z * hx - x * hz + gain * y + spin * dy
    work.M[k, 2] = x * hy - y * hx + gain * z + spin * dz
    work.L[k, 0] = body.mass[k] * work.lift[0] + reach * ux
    work.L[k, 1] = body.mass[k] * work.lift[1] + reach * uy
    work.L[k, 2] = body.mass[k] * work.lift[2] + reach * uz
    lengthen_link(k, (dx, dy, dz), body, work)
    work.lift[0] = work.lift[0] + work.length[k + 1] * ux
    work.lift[1] = work.lift[1] + work.length[k + 1] * uy
    work.lift[2] = work.lift[2] + work.length[k + 1] * uz


def pass_down(k, length, work):
    """Add the force and moment of all links beyond link k to those of link k, in work.L and work.M. `length` [m] is
    that of link k.
    """
    x = length * work.R[k + 1, 0, 2]
    y = length * work.R[k + 1, 1, 2]
    z = length * work.R[k + 1, 2, 2]
    fx = work.L[k + 1, 0]
    fy = work.L[k + 1, 1]
    fz = work.L[k + 1, 2]
    work.M[k, 0] = work.M[k, 0] + work.M[k + 1, 0] + (y * fz - z * fy)
    work.M[k, 1] = work.M[k, 1] + work.M[k + 1, 1] + (z * fx - x * fz)
    work.M[k, 2] = work.M[k, 2] + work.M[k + 1, 2] + (x * fy - y * fx)
    work.L[k, 0] = work.L[k, 0] + fx
    work.L[k, 1] = work.L[k, 1] + fy
    work.L[k, 2] = work.L[k, 2] + fz


def acceleration(x, v, torque, body, joints, work, a):
    """Write the accelerations a (N,) of a chain in space: angles [rad/s^2], then strains [1/s^2], at coordinates x and
    rates v.

    `torque` (N,) [N m] is the actuation along each coordinate. `work.A` keeps the factors of M.

    Paper: Eq. (5) [eq:eom], in space
    """
    pose_links(x, body, work)
    joint_torques(x, v, joints, torque, 0.0, work.t)
    inertial_forces(x, v, body, work, work.f)
    for i in range(len(x)):
        a[i] = work.t[i] - work.f[i]
    inertia(0.0, body, work, work.A)
    ldl_factor(work.A)
    ldl_solve_by_columns(work.A, a)


def step(x, v, h, torque, body, joints, work):
    """Advance the coordinates x (N,) and rates v (N,) of a chain in space in place by one implicit step h [s], under
    the mean `torque` (N,) [N m].

    Springs, dampers and the slope of gravity are implicit. Terms quadratic in the rates are evaluated at the rates in
    mid-step by a second solve with the same factors. `work.a` keeps the change of v.

    Source: as `motion.step`, written for Eq. (5) [eq:eom] in space
    """
    build_step(x, v, h, torque, body, joints, work)
    a = work.a
    ldl_factor(work.A)
    inertial_forces(work.q, v, body, work, work.f)
    for i in range(len(x)):
        a[i] = h * (work.t[i] - work.f[i])
    ldl_solve_by_columns(work.A, a)
    for i in range(len(x)):
        work.v[i] = v[i] + 0.5 * a[i]
    inertial_forces(work.q, work.v, body, work, work.f)
    for i in range(len(x)):
        a[i] = h * (work.t[i] - work.f[i])
    ldl_solve_by_columns(work.A, a)
    for i in range(len(x)):
        x[i] = x[i] + h * (v[i] + 0.5 * a[i])
        v[i] = v[i] + a[i]


def build_step(x, v, h, torque, body, joints, work):
    """Write the matrix and torques of one implicit time step of a chain in space into `work`, without solving the
    equations.

    `work.q` (N,) receives the mid-step coordinates, with their pose, and `work.t` (N,) the torques there. `work.A` (N,
    N) receives the matrix, not factored.

    Source: as `step`
    """
    half = 0.5 * h
    for i in range(len(x)):
        work.q[i] = x[i] + half * v[i]
    pose_links(work.q, body, work)
    joint_torques(x, v, joints, torque, half, work.t)
    inertia(half * half, body, work, work.A)
    add_spring_slopes(work.q, half, joints, work.A)
