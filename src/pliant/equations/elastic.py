"""Springs, dampers, drive and gravity of Eq. (5)."""

from __future__ import annotations

LEAST_STRETCH = 0.05  # of a segment: pressed further, it is none


def joint_torques(phi, w, joints, torque, ahead, t):
    """Net torque t (n,) of drive, spring and damper at each joint, with t[n] = 0 behind the last one; N m.

    t_i = torque_i - K_i q_m - K2_i q_m^2 - K3_i q_m^3 - D_i dq_i,  q_m = q_i + ahead dq_i

    K2 = K s, K3 = K a make springs K q (1 + s q + a q^2), which soften (s < 0) and then stiffen (a > 0) with the angle;
    s = a = 0 is the paper's.

    `ahead` [s] looks ahead along the present velocity: half a step in the implicit midpoint rule, 0 elsewhere.

    Paper: Eq. (5) [eq:eom]
    """
    n = len(joints.theta0)
    angle = joints.base_angle
    rate = 0.0 * w[0]
    for i in range(n):
        q = phi[i] - angle - joints.theta0[i]
        dq = w[i] - rate
        more = phi[i] - angle - joints.unbent[i] + ahead * dq
        spring = joints.K[i] * (q + ahead * dq) + (joints.K2[i] + joints.K3[i] * more) * more * more
        t[i] = torque[i] - spring - joints.D[i] * dq
        angle = phi[i]
        rate = w[i]
    t[n] = 0.0 * t[0]


def joint_tangents(phi, w, joints, ahead, slope):
    """Slopes K_i + 2 K2_i q_m + 3 K3_i q_m^2 (n,) of the springs of `joint_torques`; N m/rad."""
    angle = joints.base_angle
    rate = 0.0 * w[0]
    for i in range(len(joints.theta0)):
        more = phi[i] - angle - joints.unbent[i] + ahead * (w[i] - rate)
        slope[i] = joints.K[i] + (2.0 * joints.K2[i] + 3.0 * joints.K3[i] * more) * more
        angle = phi[i]
        rate = w[i]


def tangent(i, phi, joints):
    """Slope K_i + 2 K2_i q_i + 3 K3_i q_i^2 of the spring of joint i, N m/rad: what is not positive holds nothing."""
    angle = phi[i] - joints.unbent[i]
    if i > 0:
        angle = angle - phi[i - 1]
    else:
        angle = angle - joints.base_angle
    return joints.K[i] + (2.0 * joints.K2[i] + 3.0 * joints.K3[i] * angle) * angle


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
