"""Exact Jacobian of one implicit time step of a planar chain of constant length, for estimators and controllers.

The derivatives are written out by hand from the two solves of the step and use its factors again. A test compares them
with complex-step derivatives of `motion.step`.
"""

from __future__ import annotations

from pliant.equations.elastic import spring_slope_between
from pliant.equations.motion import centrifugal, step
from pliant.numerics.ldl import ldl_solve


def step_jacobian(phi, w, h, torque, body, joints, work, J):
    """Advance link angles phi (n,) and rates w (n,) in place by one step h [s]. Write the derivatives of the new phi
    and w (columns) with respect to the old phi, the old w and the joint torques (rows) to J (3n, 2n).

    `motion.step` makes the same step without derivatives.

    J[v, u] = d(phi', w')_u / d(phi, w, t)_v. t_i [N m] is an additional torque of joint i, constant over the step.

    Paper: Eq. (5) [eq:eom], discretised and differentiated
    """
    n = len(phi)
    step(phi, w, h, torque, body, joints, work)
    for k in range(n):
        old = w[k] - work.a[k]
        work.t[k] = h * old * old
    centrifugal(work.S, work.t, work.r, work.r)
    ldl_solve(work.A, work.r)  # the first solve of the step, once more
    for v in range(3 * n):
        for u in range(2 * n):
            J[v, u] = 0.0 * w[0]
    turned_directions(w, h, body, work, J)
    for k in range(n):
        for u in range(2 * n):
            J[n + k, u] = 0.5 * h * J[k, u]  # the rates turn the middle directions by half a step
    tridiagonal_terms(phi, w, h, joints, work, J)
    for k in range(n):
        for j in range(k):
            sine = 2.0 * h * work.S[k, j]
            J[n + j, k] = J[n + j, k] - sine * (w[j] - work.a[j])
            J[n + k, j] = J[n + k, j] + sine * (w[k] - work.a[k])
    for v in range(3 * n):
        ldl_solve(work.A, J[v, :n])
        for j in range(n):
            move = 0.5 * J[v, j]
            if v == n + j:
                move = move + 1.0
            move = 2.0 * h * (w[j] - work.a[j] + 0.5 * work.r[j]) * move
            for k in range(j):
                J[v, n + k] = J[v, n + k] + work.S[j, k] * move
            for k in range(j + 1, n):
                J[v, n + k] = J[v, n + k] - work.S[k, j] * move
        ldl_solve(work.A, J[v, n:])
    finish(h, J)


def turned_directions(w, h, body, work, J):
    """Write the derivatives of the residuals of a time step's equations with respect to the mid-step link angles to the
    first n rows of the step's Jacobian J (3n, 2n).

    The rows hold the right-hand sides of both solves of `step_jacobian`.

    The first n entries of a row belong to the first solve (solution in `work.r`), the others to the second (`work.a`).
    """
    n = len(w)
    c = work.c
    s = work.s
    for stage in range(2):
        o = stage * n
        a = work.r
        if stage == 1:
            a = work.a
        for k in range(n):
            force = h * (body.gx * s[k] - body.gy * c[k])
            slope = 0.25 * h * h * (body.gx * c[k] + body.gy * s[k])
            J[k, o + k] = J[k, o + k] + body.h[k] * (force + slope * a[k])
            rate_k = w[k] - work.a[k] + 0.5 * stage * work.r[k]
            for j in range(k):
                rate_j = w[j] - work.a[j] + 0.5 * stage * work.r[j]
                cosine = h * body.B[k, j] * (c[k] * c[j] + s[k] * s[j])
                by_j = cosine * rate_j * rate_j - work.S[k, j] * a[j]
                by_k = cosine * rate_k * rate_k + work.S[k, j] * a[k]
                J[j, o + k] = J[j, o + k] + by_j
                J[k, o + k] = J[k, o + k] - by_j
                J[k, o + j] = J[k, o + j] + by_k
                J[j, o + j] = J[j, o + j] - by_k


def tridiagonal_terms(phi, w, h, joints, work, J):
    """Add the terms of joint springs, dampers and torques to the step's Jacobian J (3N, 2N), which at this stage holds
    the derivatives of the residuals of the step's equations.

    They belong to both right-hand sides of `step_jacobian`.

    phi and w are the values after the step; phi - h/2 w are the mid-step angles which the step extrapolated from its
    start. The slope of each spring includes the change of the step's matrix with these angles, for the solution of each
    stage. For a body that lengthens, w and the rows of J also contain its strains.
    """
    N = len(w)
    for i in range(len(joints.theta0)):
        bend = phi[i] - 0.5 * h * w[i] - joints.unloaded[i]
        if i > 0:
            bend = bend - phi[i - 1] + 0.5 * h * w[i - 1]
        else:
            bend = bend - joints.base_angle
        for stage in range(2):
            o = stage * N
            a = work.r
            if stage == 1:
                a = work.a
            change = a[i]
            if i > 0:
                change = change - a[i - 1]
            spring = h * spring_slope_between(i, joints, bend, 0.5 * h * change)
            damper = h * (0.5 * spring + joints.D[i])
            J[2 * N + i, o + i] = J[2 * N + i, o + i] + h
            J[i, o + i] = J[i, o + i] - spring
            J[N + i, o + i] = J[N + i, o + i] - damper
            if i > 0:
                J[2 * N + i, o + i - 1] = J[2 * N + i, o + i - 1] - h
                J[i - 1, o + i - 1] = J[i - 1, o + i - 1] - spring
                J[i, o + i - 1] = J[i, o + i - 1] + spring
                J[i - 1, o + i] = J[i - 1, o + i] + spring
                J[N + i - 1, o + i - 1] = J[N + i - 1, o + i - 1] - damper
                J[N + i, o + i - 1] = J[N + i, o + i - 1] + damper
                J[N + i - 1, o + i] = J[N + i - 1, o + i] + damper


def finish(h, J):
    """Convert J (3n, 2n) from derivatives of the rate changes of a time step to derivatives of the angles and rates
    after it.

    dphi' = dphi + h (dw + da/2), dw' = dw + da, for the change a of the rates.
    """
    n = J.shape[1] // 2
    for v in range(3 * n):
        for k in range(n):
            J[v, k] = 0.5 * h * J[v, n + k]
    for k in range(n):
        J[k, k] = J[k, k] + 1.0
        J[n + k, k] = J[n + k, k] + h
        J[n + k, n + k] = J[n + k, n + k] + 1.0
