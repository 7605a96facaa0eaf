"""Springs, dampers, drive and gravity of Eq. (5)."""

from __future__ import annotations

import numpy as np

LEAST_STRETCH = 0.05  # of a segment: pressed further, it is none
TERMS = 2  # of a spring's torque beyond the linear one: the first rows of `symbols.Joints.hardening`
ROWS = TERMS + 1  # of `hardening`: the last one, R, bounds what the first term does to the slope
TWO_THIRDS = 2.0 / 3.0


def spring_torque(i, joints, q, bend):
    """Torque of the spring of joint i, N m, on numbers or arrays: K q + K2 bend^2 + K3 bend^3, as many as `TERMS` says.

    `q` [rad] is the joint's angle from where its spring holds nothing, `bend` [rad] the angle from the unloaded rest
    shape; the two differ where hysteresis moves the first. K2 = K s, K3 = K a make springs K q (1 + s q + a q^2), which
    soften (s < 0) and then stiffen (a > 0) with the angle; s = a = 0 is the paper's.

    K2 comes with a factor (2/3) r (2 + r) / (1 + r), r = 1 / sqrt(1 + R bend^2), R = (4 s / (3 f))^2: its slope runs
    steadily from 0 at rest to -f K far out on the side that softens, f K on the other, so that for f < 1 the torque
    never runs out. R = 0 is no bound.

    The law of the springs is written in this and the next three functions, and nowhere else. On whole arrays i is a
    slice of joints.

    Paper: Eq. (5) [eq:eom]
    """
    more = 0.0 * bend
    for k in range(TERMS - 1, 0, -1):
        more = (more + joints.hardening[k, i]) * bend
    r = 1.0 / np.sqrt(1.0 + joints.hardening[TERMS, i] * bend * bend)
    more = more + joints.hardening[0, i] * (r * (2.0 + r) / (1.0 + r) * TWO_THIRDS)
    return joints.K[i] * q + more * bend * bend


def spring_slope(i, joints, bend):
    """Slope d(torque)/d(angle) of the spring of joint i, N m/rad: K + K2 bend (2/3) r (2 + r^2) + 3 K3 bend^2."""
    more = 0.0 * bend
    for k in range(TERMS - 1, 0, -1):
        more = (more + (k + 2.0) * joints.hardening[k, i]) * bend
    r = 1.0 / np.sqrt(1.0 + joints.hardening[TERMS, i] * bend * bend)
    more = more + joints.hardening[0, i] * (r * (2.0 + r * r) * TWO_THIRDS)
    return joints.K[i] + more * bend


def spring_slope_between(i, joints, bend, change):
    """Slope of a spring in the linearised step, N m/rad: that at the middle `bend` and how it changes with it.

    d/d(bend) of [torque + slope times half of `change`], both at `bend`: the slope of K and K2 there with half of
    `change` times 2 K2 r^5, and p K_p bend^(p-2) (bend + (p-1)/2 change) for p = 3, 4 ...
    """
    r = 1.0 / np.sqrt(1.0 + joints.hardening[TERMS, i] * bend * bend)
    curved = r * (2.0 + r * r) * TWO_THIRDS * bend + r * r * r * r * r * change
    slope = joints.K[i] + joints.hardening[0, i] * curved
    moved = bend + 0.5 * change
    power = bend
    for k in range(1, TERMS):
        moved = moved + 0.5 * change
        slope = slope + (k + 2.0) * joints.hardening[k, i] * power * moved
        power = power * bend
    return slope


def spring_energy(i, joints, q, bend):
    """Energy of the spring of joint i, J, 0 at rest: K q^2 / 2 + K2 bend^3 (2/3) / (1 + 1/r) + K3 bend^4 / 4."""
    root = np.sqrt(1.0 + joints.hardening[TERMS, i] * bend * bend)
    more = joints.hardening[0, i] * bend * bend * bend * (TWO_THIRDS / (1.0 + root))
    for k in range(1, TERMS):
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
        bend = phi[i] - angle - joints.unloaded[i] + ahead * dq
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
        bend = phi[i] - angle - joints.unloaded[i] + ahead * (w[i] - rate)
        slope[i] = spring_slope(i, joints, bend)
        angle = phi[i]
        rate = w[i]


def tangent(i, phi, joints):
    """Slope of the spring of joint i, N m/rad: what is not positive holds nothing."""
    angle = phi[i] - joints.unloaded[i]
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
        bend = phi[i] - before - joints.unloaded[i]
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
    for i in range(len(joints.theta0), joints.hardening.shape[1]):
        if not spring_slope(i, joints, phi[i]).real > 0.0:
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
