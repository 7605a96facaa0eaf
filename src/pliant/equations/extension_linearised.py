"""Exact Jacobian of one implicit time step of a planar chain whose segments lengthen.

The step is `extension.step`.

Both solves of the step balance F = h f + M a with the torques of actuation, springs and dampers. The component of F for
the angle of link k is st_k n_k . (b_k - h h_k g), and for a strain it is e_k . of the same vector. b_k is the sum of
`extension.carried` for the accelerations of all u_l; `met` returns these along n_l and e_l. A turn of link j changes
its own two directions and, through b, the forces of all other links.
"""

from __future__ import annotations

from pliant.equations.elastic import spring_slope_between
from pliant.equations.extension import along_strain, carried, inertial_forces, step
from pliant.equations.linearised import finish, tridiagonal_terms
from pliant.numerics.ldl import ldl_solve


def step_jacobian(x, v, h, torque, body, joints, work, J):
    """Advance coordinates x (N,) and rates v (N,) in place by one step h [s]. Write the derivatives of the new x and v
    (columns) with respect to the old x, the old v and the torques (rows) to J (3N, 2N).

    `extension.step` makes the same step without derivatives. N = n + S, for n link angles and S strains.

    J[v, u] = d(x', v')_u / d(x, v, t)_v. t (N,) [N m] are additional torques of the joints and strains, constant over
    the step.

    Paper: Eq. (5) [eq:eom] of a body that lengthens, discretised and differentiated
    """
    N = len(x)
    step(x, v, h, torque, body, joints, work)
    for i in range(N):
        work.v[i] = v[i] - work.a[i]
    inertial_forces(work.v, body, work, work.f)
    for i in range(N):
        work.r[i] = work.r[i] - h * work.f[i]
    ldl_solve(work.A, work.r)  # the first solve of the step, once more
    for row in range(3 * N):
        for u in range(2 * N):
            J[row, u] = 0.0 * v[0]
    moved_middles(v, h, body, work, J)
    for k in range(N):
        for u in range(2 * N):
            J[N + k, u] = 0.5 * h * J[k, u]  # the rates move the middle by half a step
    tridiagonal_terms(x, v, h, joints, work, J)
    axial_terms(x, v, h, joints, work, J)
    for i in range(N):
        work.v[i] = v[i] - work.a[i]
    for k in range(N):
        for i in range(N):
            work.t[i] = 0.0 * v[0]
        work.t[k] = 1.0 + 0.0 * v[0]
        other_rates(h, body, work, J[N + k, :N])
    for i in range(N):
        work.v[i] = v[i] - work.a[i] + 0.5 * work.r[i]
    for row in range(3 * N):
        ldl_solve(work.A, J[row, :N])
        for i in range(N):
            work.t[i] = 0.5 * J[row, i]
            if row == N + i:
                work.t[i] = work.t[i] + 1.0
        other_rates(h, body, work, J[row, N:])
        ldl_solve(work.A, J[row, N:])
    finish(h, J)


def other_rates(h, body, work, row):
    """Subtract a change of the impulse [N m s] of the inertial forces over a time step from `row` (N,), a part of a row
    of the step's Jacobian. It is the change that follows when the rates v change by work.t (N,).

    work.t is overwritten.

    work.v (N,) are the rates v, f(v) the inertial forces at these rates, and h [s] the step.

    The change is h/2 (f(v + t) - f(v - t)), which is exact because f is quadratic in the rates.
    """
    N = len(row)
    for side in range(2):
        for i in range(N):
            work.t[i] = work.v[i] + work.t[i]
        inertial_forces(work.t, body, work, work.f)
        for i in range(N):
            work.t[i] = work.v[i] - work.t[i]  # v - t in the second pass
            row[i] = row[i] + (side - 0.5) * h * work.f[i]


def moved_middles(v, h, body, work, J):
    """Write the derivatives of the residuals of a time step's equations with respect to the mid-step coordinates to the
    first N rows of the step's Jacobian J (3N, 2N).

    The rows hold the right-hand sides of both solves of `step_jacobian`.

    The first N entries of a row belong to the first solve (solution in `work.r`), the others to the second (`work.a`).
    """
    N = len(v)
    for stage in range(2):
        o = stage * N
        a = work.r
        if stage == 1:
            a = work.a
        for i in range(N):
            work.v[i] = v[i] - work.a[i] + 0.5 * stage * work.r[i]
        for k in range(len(body.l)):
            across, along = met(k, h, a, body, work)
            work.ax[k] = -across * work.c[k] - along * work.s[k]
            work.ay[k] = -across * work.s[k] + along * work.c[k]
        carried(body, work)
        own_directions(h, a, body, work, J, o)
        for row in range(N):
            other_links(row, h, a, body, work)
            carried(body, work)
            seen(body, work, J[row, o : o + N])


def met(k, h, a, body, work):
    """Return the change of the velocity of link k's tip relative to the link's start over a step of h [s], divided by
    the link's unstretched length [1/s]: the component across the link and that along it.

    This is h times the acceleration at constant rates `work.v`, plus the part of the change a (N,) of the rates.
    """
    n = len(body.l) - 1
    turn = 0.0 * a[0]
    alpha = 0.0 * a[0]
    if k > 0:
        turn = work.v[k - 1]
        alpha = a[k - 1]
    growth = 0.0 * a[0]
    along = -h * work.stretch[k] * turn * turn
    for s in range(len(a) - n):
        growth = growth + body.share[k, s] * work.v[n + s]
        along = along + body.share[k, s] * a[n + s]
    return 2.0 * h * growth * turn + work.stretch[k] * alpha, along


def own_directions(h, a, body, work, J, o):
    """Add the effect of the changing directions of the links to the step's Jacobian J. The step projects the force on
    each link onto the directions across and along this link, which turn and stretch with it.

    The force is b - h h_k g, projected on the link's own directions n_k and e_k.

    The derivative of gravity's slope is included.

    b is in `work.bx`, `work.by`. `o` is the first column of the solve at hand.
    """
    n = len(body.l) - 1
    quarter = 0.25 * h * h
    for k in range(1, n + 1):
        c = work.c[k]
        s = work.s[k]
        weight = body.h[k] * (body.gy * c - body.gx * s)  # along e_k
        across = -body.h[k] * (body.gx * c + body.gy * s)  # along n_k
        by_e = c * work.by[k] - s * work.bx[k] - h * weight
        by_n = -c * work.bx[k] - s * work.by[k] - h * across
        grown = 0.0 * a[0]
        for i in range(len(a) - n):
            grown = grown + body.share[k, i] * a[n + i]
            both = body.share[k, i] * (by_n + quarter * weight * a[k - 1])
            J[k - 1, o + n + i] = J[k - 1, o + n + i] - both
            J[n + i, o + k - 1] = J[n + i, o + k - 1] - both
        turned = work.stretch[k] * (quarter * across * a[k - 1] - by_e) + quarter * weight * grown
        J[k - 1, o + k - 1] = J[k - 1, o + k - 1] - turned


def other_links(row, h, a, body, work):
    """Write the derivatives of each link's velocity change in a time step with respect to the coordinate number `row`,
    as x and y components, to work.ax and work.ay (n + 1,).

    The velocity change of link k is that of `met`.
    """
    n = len(body.l) - 1
    for k in range(n + 1):
        across = 0.0 * a[0]
        along = 0.0 * a[0]
        if row == k - 1:
            turned = met(k, h, a, body, work)
            across = turned[1]
            along = -turned[0]
        elif row >= n and k > 0:
            across = body.share[k, row - n] * a[k - 1]
            along = -h * body.share[k, row - n] * work.v[k - 1] * work.v[k - 1]
        work.ax[k] = -across * work.c[k] - along * work.s[k]
        work.ay[k] = -across * work.s[k] + along * work.c[k]


def seen(body, work, row):
    """Subtract from `row` (N,), part of a row of the step's Jacobian, the generalized forces of the force vectors
    (work.bx, work.by) on the links: one for each link angle, then one for each strain.
    """
    n = len(body.l) - 1
    for k in range(n):
        across = work.c[k + 1] * work.bx[k + 1] + work.s[k + 1] * work.by[k + 1]
        row[k] = row[k] + work.stretch[k + 1] * across
    for s in range(len(row) - n):
        row[n + s] = row[n + s] - along_strain(s, body, work)


def axial_terms(x, v, h, joints, work, J):
    """Add the derivatives of the segments' axial springs, dampers and torques to the step's Jacobian J (3N, 2N).

    x and v are those after the step, as in `linearised.tridiagonal_terms`.
    """
    N = len(joints.K)
    for i in range(len(joints.theta0), N):
        spring = h * joints.K[i]
        for stage in range(2):
            o = stage * N + i
            if i < joints.hardening.shape[1]:
                change = work.r[i]
                if stage == 1:
                    change = work.a[i]
                spring = h * spring_slope_between(i, joints, x[i] - 0.5 * h * v[i], 0.5 * h * change)
            J[i, o] = J[i, o] - spring
            J[N + i, o] = J[N + i, o] - h * (0.5 * spring + joints.D[i])
            J[2 * N + i, o] = J[2 * N + i, o] + h
