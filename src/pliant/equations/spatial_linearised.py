"""Jacobian of one time step of a chain in space by complex steps, and the tip outputs that controllers use.

The derivatives are complex steps through `spatial.step`, so that springs, tendons and gravity are all included.
"""

from __future__ import annotations

from pliant.equations.spatial import pose_links, step

TINY = 1e-20  # imaginary step: its square vanishes beside 1


def step_jacobian(x, v, h, torque, body, joints, work, slopes):
    """Advance coordinates x (N,) and rates v (N,) in place by one step h [s]. Write the derivatives of the new x and v
    (columns) with respect to the old x, the old v, the torques and the inputs of R tendons (rows) to slopes.J (3N + R,
    2N).

    `spatial.step` makes the same step without derivatives.

    J[i, k] = d(x', v')_k / d(x, v, t)_i. t are additional torques (N,) [N m] along the coordinates and then inputs (R,)
    [N] of tendons, constant over the step. `slopes` is a `symbols.SpatialSlopes`.

    Source: Squire and Trapp, Using complex variables to estimate derivatives of real functions (1998)
    """
    n = len(x)
    moved = slopes.work
    for row in range(slopes.J.shape[0]):
        for i in range(n):
            slopes.x[i] = x[i]
            slopes.v[i] = v[i]
        for i in range(len(moved.tau)):
            moved.tau[i] = torque[i]
        if row < n:
            slopes.x[row] = x[row] + TINY * 1j
        elif row < 2 * n:
            slopes.v[row - n] = v[row - n] + TINY * 1j
        else:
            moved.tau[row - 2 * n] = torque[row - 2 * n] + TINY * 1j
        step(slopes.x, slopes.v, h, moved.tau, body, joints, moved)
        for k in range(n):
            slopes.J[row, k] = slopes.x[k].imag / TINY
            slopes.J[row, n + k] = slopes.v[k].imag / TINY
    step(x, v, h, torque, body, joints, work)


def tip_outputs(x, strain, geometry, out):
    """Write the selected tip coordinates (x, y or z) [m] of a chain in space to `out`, from its joint angles `x` and
    segment strains.

    Output j is x, y or z as which[j] says. x has T angles, the strains have the shape (S,).

    `geometry` is (body, work, which), with which[j] = 0, 1, 2 for x, y, z. The planar function is
    `observation.tip_outputs`.
    """
    body, work, which = geometry
    n = len(body.mass)
    for i in range(len(x)):
        work.q[i] = x[i]
    for i in range(len(strain)):
        work.q[len(x) + i] = strain[i]
    pose_links(work.q, body, work)
    for j in range(len(out)):
        axis = which[j]
        out[j] = work.r[n, axis] + work.length[n] * work.R[n, axis, 2]


def turned(rest_shift, turn):
    """Write the changes [rad] of the joint angles to `turn` when the rest angles of the joints change by `rest_shift`
    [rad]. In space the two are equal.

    The planar function is `observation.turned`, for absolute link angles.
    """
    for i in range(len(rest_shift)):
        turn[i] = rest_shift[i]


def motion_of(v, joints):
    """Return the sum of squared joint rates, swing and twist, divided by the number of joints [rad^2/s^2], from the
    rates v (N,).

    The planar function is `observation.motion_of`.
    """
    power = v[0] * v[0]
    for i in range(1, joints.hardening.shape[1] - joints.tied.shape[1]):
        power = power + v[i] * v[i]
    return power / len(joints.unloaded)
