"""Springs, dampers, drive and gravity of Eq. (5)."""

from __future__ import annotations

LEAST_STRETCH = 0.05  # of a segment: pressed further, it is none


TERMS = 2  # of a spring's torque beyond the linear one: the rows of `symbols.Joints.hardening`


def spring_torque(i, joints, q, bend):
    """Torque of the spring of joint i, N m, on numbers or arrays: K q + K2 bend^2 + K3 bend^3, as many as `TERMS` says.

    `q` [rad] is the joint's angle from where its spring holds nothing, `bend` [rad] the angle from the unloaded rest
    shape; the two differ where hysteresis moves the first. K2 = K s, K3 = K a make springs K q (1 + s q + a q^2), which
    soften (s < 0) and then stiffen (a > 0) with the angle; s = a = 0 is the paper's.

    The law of the springs is written in this and the next three functions, and nowhere else. On whole arrays i is a
    slice of joints.

    Paper: Eq. (5) [eq:eom]
    """
    more = joints.hardening[TERMS - 1, i]
    for k in range(TERMS - 2, -1, -1):
        more = more * bend + joints.hardening[k, i]
    return joints.K[i] * q + more * bend * bend


def spring_slope(i, joints, bend):
    """Slope d(torque)/d(angle) of the spring of joint i, N m/rad: K + 2 K2 bend + 3 K3 bend^2."""
    more = (TERMS + 1.0) * joints.hardening[TERMS - 1, i]
    for k in range(TERMS - 2, -1, -1):
        more = more * bend + (k + 2.0) * joints.hardening[k, i]
    return joints.K[i] + more * bend


def spring_slope_between(i, joints, bend, change):
    """Slope of a spring in the linearised step, N m/rad: that at the middle `bend` and how it changes with it.

    d/d(bend) of [torque + slope times half of `change`], both at `bend`: the sum of K and
    p K_p bend^(p-2) (bend + (p-1)/2 change) for p = 2, 3 ...
    """
    moved = bend + 0.5 * change
    slope = joints.K[i] + 2.0 * joints.hardening[0, i] * moved
    power = bend
    for k in range(1, TERMS):
        moved = moved + 0.5 * change
        slope = slope + (k + 2.0) * joints.hardening[k, i] * power * moved
        power = power * bend
    return slope


def spring_energy(i, joints, q, bend):
    """Energy of the spring of joint i, J, 0 in the rest shape: K q^2 / 2 + K2 bend^3 / 3 + K3 bend^4 / 4."""
    more = 0.0 * bend
    for k in range(TERMS):
        term = joints.hardening[k, i] * bend * bend * bend
        for _ in range(k):
            term = term * bend
        more = more + term / (k + 3.0)
    return 0.5 * joints.K[i] * q * q + more


def joint_torques(phi, w, joints, torque, ahead, t):
    """Net torque t (n,) of drive, spring and damper at each joint, with t[n] = 0 behind the last one; N m.

    t_i = torque_i - spring_torque(q_i + ahead dq_i) - D_i dq_i

    `ahead` [s] looks ahead along the present velocity: half a step in the implicit midpoint rule, 0 elsewhere.

    Paper: Eq. (5) [eq:eom]
    """
    n = len(joints.theta0)
    angle = joints.base_angle
    rate = 0.0 * w[0]
    for i in range(n):
        q = phi[i] - angle - joints.theta0[i]
        dq = w[i] - rate
        bend = phi[i] - angle - joints.unbent[i] + ahead * dq
        spring = spring_torque(i, joints, q + ahead * dq, bend)
        t[i] = torque[i] - spring - joints.D[i] * dq
        angle = phi[i]
        rate = w[i]
    t[n] = 0.0 * t[0]


def joint_tangents(phi, w, joints, ahead, slope):
    """Slopes (n,) of the springs of `joint_torques`; N m/rad."""
    angle = joints.base_angle
    rate = 0.0 * w[0]
    for i in range(len(joints.theta0)):
        bend = phi[i] - angle - joints.unbent[i] + ahead * (w[i] - rate)
        slope[i] = spring_slope(i, joints, bend)
        angle = phi[i]
        rate = w[i]


def tangent(i, phi, joints):
    """Slope of the spring of joint i, N m/rad: what is not positive holds nothing."""
    angle = phi[i] - joints.unbent[i]
    if i > 0:
        angle = angle - phi[i - 1]
    else:
        angle = angle - joints.base_angle
    return spring_slope(i, joints, angle)


def bending_energy(phi, joints):
    """Energy of the springs of all joints at absolute angles phi, J."""
    value = 0.0 * phi[0]
    before = joints.base_angle
    for i in range(len(joints.theta0)):
        q = phi[i] - before - joints.theta0[i]
        bend = phi[i] - before - joints.unbent[i]
        value = value + spring_energy(i, joints, q, bend)
        before = phi[i]
    return value


def follows(phi, w, h, joints):
    """Whether a step of h [s] could follow the chain to where it is, on real parts; not for what is not a number.

    No link turns by more than a radian, no spring has softened to nothing; and where segments lengthen, no strain
    changes by more than 1, none is pressed to nothing.
    """
    for i in range(len(joints.theta0)):
        if not (abs((w[i] * h).real) <= 1.0 and tangent(i, phi, joints).real > 0.0):
            return False
    for i in range(len(joints.theta0), len(phi)):
        if not (abs((w[i] * h).real) <= 1.0 and phi[i].real > LEAST_STRETCH - 1.0):
            return False
    return True


def gravity_absolute(c, s, body, g):
    """Gravity torques g (n,) on the left-hand side of Eq. (5), in absolute angles; N m.

    g_k = h_k (gx cos phi_k + gy sin phi_k), the slope of the potential -sum m (gx x + gy y); c, s: cos, sin of phi.
    """
    for k in range(len(c)):
        g[k] = body.h[k] * (body.gx * c[k] + body.gy * s[k])


def to_joint_torques(g):
    """Carry torques from absolute to joint angles, in place: T^T g, T the lower triangle of ones (suffix sums)."""
    for i in range(len(g) - 2, -1, -1):
        g[i] = g[i] + g[i + 1]
