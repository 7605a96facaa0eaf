"""Implicit time step of a planar chain of links at a cost that grows linearly with the number of links, for long
chains.

The results equal those of `motion.step`. In absolute angles the inertia is h_k l_j cos(phi_k - phi_j) below its
diagonal. The equations of a step are therefore the minimum of a sum over links, in which link k depends on the other
links only through v_k = sum_{j<=k} l_j (cos, sin)(phi_j) x_j and on x_k. The minimum is found link by link, from the
tip to the base and back. This is Featherstone's articulated-body algorithm without a change of frame. Springs and
dampers enter as an armature (an added rotor inertia) of each joint.

Source: Featherstone, Rigid Body Dynamics Algorithms, Ch. 7, rederived for the planar chain in absolute angles.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.elastic import joint_tangents, joint_torques
from pliant.equations.motion import step

LEAST_LINKS = 4


def step_articulated(phi, w, h, torque, body, joints, work):
    """Advance link angles phi (n,) [rad] and rates w (n,) [rad/s] in place by one step h [s], in O(n) operations. The
    result equals that of `motion.step`, which uses the full inertia matrix.

    `torque` (n,) [N m] is the mean actuation torque of each joint over the step. Chains of fewer than 4 links are
    passed to `motion.step`, because the rows of `work.A` and `work.S`, which hold the intermediate results, are too
    short for them.

    Paper: Eq. (5) [eq:eom]
    """
    n = len(phi)
    if n < LEAST_LINKS:
        step(phi, w, h, torque, body, joints, work)
    else:
        folded_step(phi, w, h, torque, body, joints, work)


def folded_step(phi, w, h, torque, body, joints, work):
    """Advance link angles phi (n,) [rad] and rates w (n,) [rad/s] in place by one step h [s], in O(n) operations. The
    chain must have at least 4 links: for fewer, the scratch arrays are too small.

    This is `step_articulated` without the check of the number of links.
    """
    n = len(phi)
    half = 0.5 * h
    quarter = half * half
    c = work.c
    s = work.s
    r = work.r
    a = work.a
    t = work.t
    length = work.S[0]
    diagonal = work.S[1]
    armature = work.S[2]
    square = work.S[3]
    scale = 1.0 / body.h[n - 1]
    for k in range(n):
        c[k] = np.cos(phi[k] + half * w[k])
        s[k] = np.sin(phi[k] + half * w[k])
        length[k] = scale * body.B[n - 1, k]  # the value of the last link has no effect
    joint_torques(phi, w, joints, torque, half, t)
    joint_tangents(phi, w, joints, half, a)
    for k in range(n):
        r[k] = h * (t[k] - t[k + 1] - body.h[k] * (body.gx * c[k] + body.gy * s[k]))
        diagonal[k] = body.B[k, k] + body.I[k] + quarter * body.h[k] * (body.gy * c[k] - body.gx * s[k])
        armature[k] = half * joints.D[k] + quarter * a[k]
    fold(c, s, body.h, length, diagonal, armature, work.A)
    for k in range(n):
        square[k] = h * w[k] * w[k]
    centrifugal_sums(c, s, body.h, length, square, r, a)
    unfold(c, s, length, armature, work.A, t, a)
    for k in range(n):
        middle = w[k] + 0.5 * a[k]
        square[k] = h * middle * middle
    centrifugal_sums(c, s, body.h, length, square, r, a)
    unfold(c, s, length, armature, work.A, t, a)
    for k in range(n):
        phi[k] = phi[k] + h * (w[k] + 0.5 * a[k])
        w[k] = w[k] + a[k]


def fold(c, s, first_moment, length, diagonal, armature, F):
    """First sweep of the O(n) step: eliminate the n links from tip to base. Write three coefficients of each link, R_x,
    R_y and 1/d, which describe how it responds to the links before it, to rows 0, 1 and 2 of F.

    `unfold` uses these three rows.

    Beyond joint k the minimum is 1/2 v^T P v + y p . v + 1/2 z y^2 in v = v_{k-1} and y = x_{k-1}.
    """
    n = len(c)
    pxx = 0.0 * c[0]
    pxy = pxx
    pyy = pxx
    px = pxx
    py = pxx
    z = pxx
    for i in range(n):
        k = n - 1 - i
        lx = length[k] * c[k]
        ly = length[k] * s[k]
        ux = pxx * lx + pxy * ly
        uy = pxy * lx + pyy * ly
        rx = px + ux + first_moment[k] * c[k]
        ry = py + uy + first_moment[k] * s[k]
        d = z + 2.0 * (px * lx + py * ly) + lx * ux + ly * uy + diagonal[k] + armature[k]
        inverse = 1.0 / d
        F[0, k] = rx
        F[1, k] = ry
        F[2, k] = inverse
        gx = rx * inverse
        gy = ry * inverse
        pxx = pxx - gx * rx
        pxy = pxy - gx * ry
        pyy = pyy - gy * ry
        px = armature[k] * gx
        py = armature[k] * gy
        z = armature[k] - armature[k] * armature[k] * inverse


def unfold(c, s, length, armature, F, G, a):
    """Second sweep of the O(n) step: solve for the changes of the n link rates [rad/s]. They overwrite the right-hand
    side of the equations in a (n,), the impulses [N m s] of the step.

    F holds the coefficients written by `fold`.

    G (n + 1,) is scratch.
    """
    n = len(c)
    fx = 0.0 * a[0]
    fy = fx
    g = fx
    for i in range(n):
        k = n - 1 - i
        total = g + length[k] * (fx * c[k] + fy * s[k]) - a[k]
        G[k] = total
        share = total * F[2, k]
        fx = fx - F[0, k] * share
        fy = fy - F[1, k] * share
        g = armature[k] * share
    vx = 0.0 * a[0]
    vy = vx
    before = vx
    for k in range(n):
        before = (armature[k] * before - G[k] - F[0, k] * vx - F[1, k] * vy) * F[2, k]
        a[k] = before
        vx = vx + length[k] * c[k] * before
        vy = vy + length[k] * s[k] * before


def centrifugal_sums(c, s, first_moment, length, square, r, a):
    """Subtract the centrifugal terms of a planar chain from the impulses r (n,) [N m s] of a time step, and write the
    difference to a (n,), in O(n) operations.

    a_k = r_k - sum_j B_kj sin(phi_k - phi_j) square_j, with c = cos(phi), s = sin(phi) and `square` h times the squared
    rates.

    The result is that of `motion.centrifugal`, which uses two nested loops.
    """
    n = len(c)
    x = 0.0 * r[0]
    y = x
    for k in range(n):
        a[k] = r[k] - first_moment[k] * (s[k] * x - c[k] * y)
        x = x + length[k] * c[k] * square[k]
        y = y + length[k] * s[k] * square[k]
    x = 0.0 * r[0]
    y = x
    for i in range(n):
        k = n - 1 - i
        a[k] = a[k] - length[k] * (s[k] * x - c[k] * y)
        x = x + first_moment[k] * c[k] * square[k]
        y = y + first_moment[k] * s[k] * square[k]
