"""The exact Jacobian of one implicit step of `extension.step`: as `linearised`, of a body that lengthens.

Both solves of the step ask that F = h f + M a meets what drive, springs and dampers give. Seen by link k that is
st_k n_k . (b_k - h h_k g), and e_k . of the same by the strains, with b_k what an acceleration of each u_l meets:
`met` along n_l and e_l. A turn of link j moves its own two directions and, through b, all other links.
"""

from __future__ import annotations

from pliant.equations.elastic import spring_slope_between
from pliant.equations.extension import along_strain, carried, inertial_forces, step
from pliant.equations.linearised import finish, tridiagonal_terms
from pliant.numerics.ldl import ldl_solve


def step_jacobian(x, v, h, torque, body, joints, work, J):
    """Advance x and v (N,), N = n + S, in place as `extension.step`, and give the Jacobian J (3N, 2N) of that step.

    J[v, u] = d(x', v')_u / d(x, v, t)_v, row by variable, t [N m] being a further torque of each joint and of each
    strain that is held over the step.

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
    """Take from row (N,) the change of h f as the rates work.v (N,) change by work.t (N,); the latter is used up.

    Half of h f at v + t less that at v - t: exact, since f goes with the square of the rates.
    """
    N = len(row)
    for side in range(2):
        for i in range(N):
            work.t[i] = work.v[i] + work.t[i]
        inertial_forces(work.t, body, work, work.f)
        for i in range(N):
            work.t[i] = work.v[i] - work.t[i]  # back to the change, to the other side
            row[i] = row[i] + (side - 0.5) * h * work.f[i]


def moved_middles(v, h, body, work, J):
    """Right-hand sides of both solves of `step_jacobian` for a move of each middle angle and strain.

    The first N entries of a row belong to the first solve (in `work.r`), the others to the second (in `work.a`).
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
    """Acceleration of u_k over a step along n_k and e_k: h times that of the rates work.v, and that of a (N,)."""
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
    """What a move does to the directions by which a link sees b - h h_k g, b in `work.bx`, and to gravity's slope."""
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
    """Into `work.ax`: how the accelerations that `met` tells change with angle or strain `row`."""
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
    """Take from row (N,) what the vectors b_k in `work.bx` do to each angle and strain."""
    n = len(body.l) - 1
    for k in range(n):
        across = work.c[k + 1] * work.bx[k + 1] + work.s[k + 1] * work.by[k + 1]
        row[k] = row[k] + work.stretch[k + 1] * across
    for s in range(len(row) - n):
        row[n + s] = row[n + s] - along_strain(s, body, work)


def axial_terms(x, v, h, joints, work, J):
    """Add what springs and dampers of the strains, and their torques, give to both solves of `step_jacobian`.

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
