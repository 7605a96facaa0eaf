"""Spring, damper, actuation and gravity torques of a planar chain, as they enter Eq. (5)."""

from __future__ import annotations

import numpy as np

from pliant.equations.spring_terms import SPRING_TERMS

LEAST_STRETCH = 0.05  # smallest admissible ratio of a segment's length to its unstretched length
TERMS = len(SPRING_TERMS)  # nonlinear terms of a spring's torque: the first rows of `symbols.Joints.hardening`
ROWS = TERMS + 1  # of `hardening` if a spring is bounded: the last one, R, bounds the slope of the first term
TWO_THIRDS = 2.0 / 3.0


def spring_torque(i, joints, q, bend):
    """Return the torque K q + K2 bend^2 + K3 bend^3 [N m] of the nonlinear spring of joint i. `bend` [rad] is the joint
    angle from the rest shape. q [rad] is the same angle, but measured from a zero that hysteresis shifts.

    q and `bend` are scalars or arrays; without hysteresis they are equal. The number of terms beyond K q is `TERMS`.
    With K2 = K s and K3 = K a the torque is K q (1 + s q + a q^2), which softens (s < 0) and then stiffens (a > 0) with
    the angle. The paper has s = a = 0.

    K2 is multiplied by (2/3) r (2 + r) / (1 + r), r = 1 / sqrt(1 + R bend^2), R = (4 s / (3 f))^2. The slope of this
    term then goes from 0 at rest to -f K at large angles on the side that softens, and to f K on the other side. For
    f < 1 the slope of K q and this term together stays positive. R = 0 means no bound.

    Only this and the next four functions contain the law of the springs. For whole arrays, i is a slice of joints.

    Paper: Eq. (5) [eq:eom]
    """
    more = 0.0 * bend
    for k in range(TERMS - 1, 0, -1):
        more = (more + joints.hardening[k, i]) * bend
    r = 1.0 / bound_root(i, joints, bend)
    more = more + joints.hardening[0, i] * (r * (2.0 + r) / (1.0 + r) * TWO_THIRDS)
    return joints.K[i] * q + more * bend * bend


def bound_root(i, joints, bend):
    """Return 1 / r of `spring_torque` for the spring of joint i at the angle `bend` [rad].

    Where no spring of a chain is bounded, `hardening` has no row for R, and no square root is computed.
    """
    if joints.hardening.shape[0] > TERMS:
        return np.sqrt(1.0 + joints.hardening[TERMS, i] * bend * bend)
    return 1.0


def spring_slope(i, joints, bend):
    """Return d(torque)/d(angle) [N m/rad] of the nonlinear spring of joint i, at the angle `bend` [rad] from its
    unloaded shape.

    K + K2 bend (2/3) r (2 + r^2) + 3 K3 bend^2, with r as in `spring_torque`.
    """
    more = 0.0 * bend
    for k in range(TERMS - 1, 0, -1):
        more = (more + (k + 2.0) * joints.hardening[k, i]) * bend
    r = 1.0 / bound_root(i, joints, bend)
    more = more + joints.hardening[0, i] * (r * (2.0 + r * r) * TWO_THIRDS)
    return joints.K[i] + more * bend


def spring_curvature(i, joints, bend):
    """Return the second and the third derivative of the torque of the nonlinear spring of joint i by its angle [N
    m/rad^2, N m/rad^3], at the angle `bend` [rad] from its unloaded shape.

    The derivatives of `spring_slope`: 2 K2 r^5 + 6 K3 bend and -10 K2 R bend r^7 + 6 K3, with r as in `spring_torque`.
    """
    second = 0.0 * bend
    third = 0.0 * bend
    for k in range(TERMS - 1, 0, -1):
        third = third * bend + (k + 2.0) * (k + 1.0) * k * joints.hardening[k, i]
        second = (second + (k + 2.0) * (k + 1.0) * joints.hardening[k, i]) * bend
    r = 1.0 / bound_root(i, joints, bend)
    bounded = 2.0 * joints.hardening[0, i] * (r * r * r * r * r)
    if joints.hardening.shape[0] > TERMS:
        third = third - 5.0 * joints.hardening[TERMS, i] * bend * r * r * bounded
    return second + bounded, third


def spring_energy(i, joints, q, bend):
    """Return the elastic energy [J] of the nonlinear spring of joint i. `bend` [rad] is the joint angle from the rest
    shape. q [rad] is the same angle, but measured from a zero that hysteresis shifts.

    K q^2 / 2 + K2 bend^3 (2/3) / (1 + 1/r) + K3 bend^4 / 4, with q, bend and r as in `spring_torque`.
    """
    root = bound_root(i, joints, bend)
    more = joints.hardening[0, i] * bend * bend * bend * (TWO_THIRDS / (1.0 + root))
    for k in range(1, TERMS):
        term = joints.hardening[k, i] * bend * bend * bend
        for _ in range(k):
            term = term * bend
        more = more + term / (k + 3.0)
    return 0.5 * joints.K[i] * q * q + more


def joint_torques(phi, w, joints, torque, ahead, t):
    """Write the net torques [N m] of actuation, spring and damper at the n joints to the first n entries of t (n + 1,).
    The last entry becomes 0, because no joint follows the last link.

    t_i = torque_i - spring_torque(q_i + ahead dq_i) - D_i dq_i

    `torque` (n,) is the actuation torque. `ahead` [s] extrapolates the angles along the present rates w: half a step in
    the implicit midpoint rule, 0 elsewhere.

    Paper: Eq. (5) [eq:eom]
    """
    n = len(joints.theta0)
    angle = joints.base_angle
    rate = joints.spin[0]
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
    """Write the stiffness (n,) [N m/rad] of each joint's spring to `slope`. The link angles are phi + ahead w,
    extrapolated by the time `ahead` [s] along the rates w.

    `joint_torques` gives the torques of the same springs.
    """
    angle = joints.base_angle
    rate = joints.spin[0]
    for i in range(len(joints.theta0)):
        bend = phi[i] - angle - joints.unloaded[i] + ahead * (w[i] - rate)
        slope[i] = spring_slope(i, joints, bend)
        angle = phi[i]
        rate = w[i]


def tangent(i, phi, joints):
    """Return the stiffness [N m/rad] of the spring of joint i, at the absolute link angles phi (n,) [rad].

    A slope that is not positive means that the spring no longer holds the joint.
    """
    angle = phi[i] - joints.unloaded[i]
    if i > 0:
        angle = angle - phi[i - 1]
    else:
        angle = angle - joints.base_angle
    return spring_slope(i, joints, angle)


def bending_energy(phi, joints):
    """Return the elastic energy [J] of all joint springs at the absolute link angles phi (n,) [rad]."""
    value = 0.0 * phi[0]
    before = joints.base_angle
    for i in range(len(joints.theta0)):
        q = phi[i] - before - joints.theta0[i]
        bend = phi[i] - before - joints.unloaded[i]
        value = value + spring_energy(i, joints, q, bend)
        before = phi[i]
    return value


def follows(phi, w, h, joints):
    """Return whether a time step of h [s] is valid for a planar chain with link angles phi and rates w: no link turns
    by more than 1 rad in the step, and every spring has a positive stiffness.

    Where segments lengthen, further conditions are that no strain changes by more than 1 and that no segment is
    compressed to below 5 % of its length. Only real parts are compared.
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
    """Write the gravity torques g (n,) [N m] on the left-hand side of Eq. (5) in absolute angles, from cosines c and
    sines s of the link angles.

    g_k = h_k (gx cos phi_k + gy sin phi_k), the slope of the potential -sum m (gx x + gy y), with c = cos(phi) and
    s = sin(phi).
    """
    for k in range(len(c)):
        g[k] = body.h[k] * (body.gx * c[k] + body.gy * s[k])


def to_joint_torques(g):
    """Transform generalized torques g (n,) [N m] from absolute link angles to joint angles, in place.

    T^T g, with T the lower triangle of ones.

    The product is computed by suffix sums.
    """
    for i in range(len(g) - 2, -1, -1):
        g[i] = g[i] + g[i + 1]
