"""Springs and dampers of a chain in space: nonlinear springs for the swing and the twist of each joint, linear or
nonlinear ones for strains.

The nonlinear law is that of `elastic`, applied to the size of a swing and to a twist.

The swing (a, b) of a joint has the energy K_a a^2 / 2 + K_b b^2 / 2 + W(m), m^2 = a^2 + (K_b / K_a) b^2. W is the
nonlinear part of the law of the first coordinate. With K_a = K_b no direction is preferred, and with b = 0 and a > 0
the law is that of the plane. In `hardening`, which has a column for each angle, the columns of b are not used. Columns
for strains follow if a segment has a nonlinear axial spring, else all axial springs are linear.

The wall of a segment carries the axial force and the bending moment, so that the strain e of the segment can change the
stiffness of its joints. With the axial force EA g(e), which the nonlinear spring of the segment gives, the fibres at
the distance y from the axis have the strain e + y kappa. Their energy, to second order in the curvature kappa, is that
of g plus g'(e) EI kappa^2 / 2. So where `joints.tied` is 1, the energy of the swing and of the twist of a joint is
multiplied by g'(e), the axial stiffness over that at rest. The bend then also pushes along the axis, with the
derivative of this energy by e. Hysteresis of the joints is not multiplied.

In a `SpatialJoints` record, `theta0` (N,), where the linear springs are unloaded, is 0. `unloaded` (n,) is 0, and its
length is the number of links. `line` holds the contribution of hysteresis, a linear function of the coordinates of each
joint: `spatial_memory`.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.elastic import LEAST_STRETCH, spring_curvature, spring_energy, spring_slope, spring_torque

TINY = 1e-24  # rad^2: under the root, so that the size of a swing has a derivative where the joint is straight
NO_STIFFNESS = 1e-60  # N m/rad: added to K_a so that K_b / K_a is finite
MOST_SWING = 16.0  # rad^2: a swing of 4 rad, up to which `spatial.stumpff` is accurate


def swing_size(i, joints, a, b):
    """Return the stiffness-weighted size [rad] of a joint's swing (a, b) [rad], coordinates i and i + 1, and the
    stiffness ratio K_b / K_a.
    """
    ratio = joints.K[i + 1] / (joints.K[i] + NO_STIFFNESS)
    return np.sqrt(a * a + ratio * (b * b) + TINY), ratio


def swing_torques(i, joints, a, b):
    """Return the torques [N m] of the spring of a swing (a, b) [rad], coordinates i and i + 1, about x and y."""
    m, ratio = swing_size(i, joints, a, b)
    more = spring_torque(i, joints, 0.0 * m, m) / m
    about_y = joints.K[i + 1] * (b - joints.theta0[i + 1]) + more * (ratio * b)
    return joints.K[i] * (a - joints.theta0[i]) + more * a, about_y


def swing_slopes(i, joints, a, b):
    """Return the derivatives [N m/rad] of the torques of `swing_torques`: about x by a, about y by a, about y by b."""
    m, ratio = swing_size(i, joints, a, b)
    more = spring_torque(i, joints, 0.0 * m, m) / m
    u = a / m
    w = ratio * b / m
    steeper = spring_slope(i, joints, m) - joints.K[i] - more
    across = joints.K[i + 1] + more * ratio + steeper * w * w
    return joints.K[i] + more + steeper * u * u, steeper * u * w, across


def swing_energy(i, joints, a, b):
    """Return the energy [J] of the spring of a swing (a, b) [rad], coordinates i and i + 1."""
    m, _ = swing_size(i, joints, a, b)
    a = a - joints.theta0[i]
    b = b - joints.theta0[i + 1]
    return 0.5 * (joints.K[i] * a * a + joints.K[i + 1] * b * b) + spring_energy(i, joints, 0.0 * m, m)


def joint_torques(x, v, joints, torque, ahead, t):
    """Write the net torque t (N,) [N m] of actuation, spring and damper along each coordinate of a chain in space.

    `torque` (N,) is the actuation torque. `ahead` [s] extrapolates x along the present rates v: half a step in the
    implicit midpoint rule, 0 elsewhere.

    Paper: Eq. (5) [eq:eom], in space
    """
    n = len(joints.unloaded)
    for i in range(0, 2 * n, 2):
        about_x, about_y = swing_torques(i, joints, x[i] + ahead * v[i], x[i + 1] + ahead * v[i + 1])
        t[i] = torque[i] - about_x - joints.D[i] * v[i]
        t[i + 1] = torque[i + 1] - about_y - joints.D[i + 1] * v[i + 1]
    for i in range(2 * n, joints.hardening.shape[1]):
        c = x[i] + ahead * v[i]
        t[i] = torque[i] - spring_torque(i, joints, c - joints.theta0[i], c) - joints.D[i] * v[i]
    for i in range(joints.hardening.shape[1], len(x)):
        t[i] = torque[i] - joints.K[i] * (x[i] + ahead * v[i]) - joints.D[i] * v[i]
    for i in range(len(joints.line)):
        k = partner(i, n)
        level = joints.line[i, 0] + joints.line[i, 1] * (x[i] + ahead * v[i])
        t[i] = t[i] - joints.K[i] * (level + joints.line[i, 2] * (x[k] + ahead * v[k]))
    for s in range(joints.tied.shape[1]):
        add_tied_torques(s, x, v, joints, ahead, t)


def stiffened(s, joints, strain):
    """Return the axial stiffness of segment s over that at rest, less 1, at its `strain`, and its first two
    derivatives by the strain.
    """
    i = joints.hardening.shape[1] - joints.tied.shape[1] + s
    second, third = spring_curvature(i, joints, strain)
    compliance = 1.0 / joints.K[i]
    return spring_slope(i, joints, strain) * compliance - 1.0, second * compliance, third * compliance


def add_tied_torques(s, x, v, joints, ahead, t):
    """Add the change of all torques t (N,) [N m] by the strain of segment s, which changes the stiffness of joints.

    The other arguments are those of `joint_torques`.
    """
    n = len(joints.unloaded)
    turns = joints.hardening.shape[1] - joints.tied.shape[1]
    more, rate, _ = stiffened(s, joints, x[turns + s] + ahead * v[turns + s])
    for k in range(n):
        i = 2 * k
        a = x[i] + ahead * v[i]
        b = x[i + 1] + ahead * v[i + 1]
        about_x, about_y = swing_torques(i, joints, a, b)
        energy = swing_energy(i, joints, a, b)
        t[i] = t[i] - joints.tied[k, s] * more * about_x
        t[i + 1] = t[i + 1] - joints.tied[k, s] * more * about_y
        if turns > 2 * n:
            i = 2 * n + k
            c = x[i] + ahead * v[i]
            energy = energy + spring_energy(i, joints, c - joints.theta0[i], c)
            t[i] = t[i] - joints.tied[k, s] * more * spring_torque(i, joints, c - joints.theta0[i], c)
        t[turns + s] = t[turns + s] - joints.tied[k, s] * rate * energy


def partner(i, n):
    """Return the index of the other swing coordinate of the same joint as coordinate i, for n joints; i itself for a
    twist.
    """
    return i + 1 - 2 * (i % 2) if i < 2 * n else i


def add_spring_slopes(q, half, joints, A):
    """Add the stiffness and damping terms of springs and dampers to the lower triangle of the implicit step's matrix A
    (N, N).

    The terms are h/2 D + h^2/4 K' at the mid-step coordinates q (N,).

    The step is h = 2 `half` [s].
    """
    n = len(joints.unloaded)
    quarter = half * half
    for i in range(0, 2 * n, 2):
        along, mixed, across = swing_slopes(i, joints, q[i], q[i + 1])
        A[i, i] = A[i, i] + half * joints.D[i] + quarter * along
        A[i + 1, i] = A[i + 1, i] + quarter * mixed
        A[i + 1, i + 1] = A[i + 1, i + 1] + half * joints.D[i + 1] + quarter * across
    for i in range(2 * n, joints.hardening.shape[1]):
        A[i, i] = A[i, i] + half * joints.D[i] + quarter * spring_slope(i, joints, q[i])
    for i in range(joints.hardening.shape[1], len(q)):
        A[i, i] = A[i, i] + half * joints.D[i] + quarter * joints.K[i]
    for i in range(len(joints.line)):
        A[i, i] = A[i, i] + quarter * joints.K[i] * joints.line[i, 1]
        if i < 2 * n and i % 2 == 1:
            A[i, i - 1] = A[i, i - 1] + quarter * joints.K[i] * joints.line[i, 2]
    for s in range(joints.tied.shape[1]):
        add_tied_slopes(s, q, quarter, joints, A)


def add_tied_slopes(s, q, quarter, joints, A):
    """Add `quarter` times the derivatives of the torques of `add_tied_torques` at q (N,), with the opposite sign, to
    the lower triangle of the matrix A (N, N).
    """
    n = len(joints.unloaded)
    turns = joints.hardening.shape[1] - joints.tied.shape[1]
    more, rate, bend = stiffened(s, joints, q[turns + s])
    row = A[turns + s]
    for k in range(n):
        part = quarter * joints.tied[k, s]
        i = 2 * k
        about_x, about_y = swing_torques(i, joints, q[i], q[i + 1])
        energy = swing_energy(i, joints, q[i], q[i + 1])
        along, mixed, across = swing_slopes(i, joints, q[i], q[i + 1])
        A[i, i] = A[i, i] + part * more * along
        A[i + 1, i] = A[i + 1, i] + part * more * mixed
        A[i + 1, i + 1] = A[i + 1, i + 1] + part * more * across
        row[i] = row[i] + part * rate * about_x
        row[i + 1] = row[i + 1] + part * rate * about_y
        if turns > 2 * n:
            i = 2 * n + k
            energy = energy + spring_energy(i, joints, q[i] - joints.theta0[i], q[i])
            A[i, i] = A[i, i] + part * more * spring_slope(i, joints, q[i])
            row[i] = row[i] + part * rate * spring_torque(i, joints, q[i] - joints.theta0[i], q[i])
        row[turns + s] = row[turns + s] + part * bend * energy


def elastic_energy(x, joints):
    """Return the energy [J] of all springs of a chain in space at the coordinates x (N,), 0 in the rest shape."""
    n = len(joints.unloaded)
    turns = joints.hardening.shape[1] - joints.tied.shape[1]
    value = 0.0 * x[0]
    for i in range(turns, joints.hardening.shape[1]):
        value = value + spring_energy(i, joints, x[i], x[i])
    for i in range(joints.hardening.shape[1], len(x)):
        value = value + 0.5 * joints.K[i] * x[i] * x[i]
    for k in range(n):
        energy = swing_energy(2 * k, joints, x[2 * k], x[2 * k + 1])
        if turns > 2 * n:
            c = x[2 * n + k]
            energy = energy + spring_energy(2 * n + k, joints, c - joints.theta0[2 * n + k], c)
        value = value + energy
        for s in range(joints.tied.shape[1]):
            more, _, _ = stiffened(s, joints, x[turns + s])
            value = value + joints.tied[k, s] * more * energy
    return value


def follows(x, v, h, joints):
    """Return whether a time step of h [s] is valid for a chain in space with coordinates x and rates v: no coordinate
    changes by more than 1 (1 rad for angles) in the step, and every spring has a positive stiffness.

    The planar function is `elastic.follows`.

    Further conditions are that no joint swings by more than 4 rad and that no segment is compressed to below 5 % of its
    length. Only real parts are compared.
    """
    for i in range(len(x)):
        if not abs((v[i] * h).real) <= 1.0:
            return False
    for i in range(0, 2 * len(joints.unloaded), 2):
        size = (x[i] * x[i] + x[i + 1] * x[i + 1]).real
        if not (size <= MOST_SWING and slope_at(i, joints, x).real > 0.0):
            return False
    for i in range(2 * len(joints.unloaded), nonlinear_springs(joints)):
        if not slope_at(i, joints, x).real > 0.0:
            return False
    for i in range(first_strain(joints), len(x)):
        if not x[i].real > LEAST_STRETCH - 1.0:
            return False
    return True


def slope_at(i, joints, x):
    """Return the slope [N m/rad] of the nonlinear spring of coordinate i at the coordinates x (N,).

    Coordinate i is the first angle of a swing, a twist or a strain.
    """
    if i < 2 * len(joints.unloaded):
        m, _ = swing_size(i, joints, x[i], x[i + 1])
        return spring_slope(i, joints, m)
    return spring_slope(i, joints, x[i])


def first_strain(joints):
    """Return the index of the first strain among the coordinates, which follows the angles."""
    return joints.hardening.shape[1] - joints.tied.shape[1]


def nonlinear_springs(joints):
    """Return the number of coordinates that have a column in `joints.hardening`: the angles, then strains if one has a
    nonlinear spring.
    """
    return joints.hardening.shape[1]
