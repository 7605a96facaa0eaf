"""Tendons of a chain in space: tension, slack, friction along the path, and a time step of the chain with tendons.

A tendon r with lever arms g_r (N,) [m/rad] has the length l_0 - g_r . x, which is exact for a body that bends in arcs
and guides the tendon along them. Between guides at a distance d it runs along chords, which are shorter: its length is
l_0 - p, p = g_r . x + sum_i c_i x_i^2 with c = d^2 / (24 l) at a joint that bends the length l, and its lever arms are
g_i + 2 c_i x_i. Drawn in by u, its force is s = k (u - p) + T_0. It cannot push: its tension is T = max(0, s). Where it
enters the body the tension falls by F run, at most by T run. Over a joint that swings by theta it changes by the factor
exp(-mu theta run) (capstan), and the joint feels the mean of the tensions before and behind it. `run` is 1 where the
tendon slips towards the base and -1 where it slips towards the tip, with a smooth transition. The energy taken from a
coordinate or an input is stored or dissipated by friction, and friction never supplies energy.

Source: Euler and Eytelwein's formula of the capstan
"""

from __future__ import annotations

import numpy as np

from pliant.equations.spatial import acceleration, build_step, inertial_forces
from pliant.equations.spatial_points import static_forces
from pliant.numerics.ldl import ldl_factor, ldl_solve_by_columns

TINY = 1e-24  # under a root, so that it has a derivative at 0
ROUNDS = 50  # iterations of Newton's method in a step, at most
AGREED = 1e-10  # residual at convergence, over the largest torque of the step
NEAR = 1e-6  # the same after all iterations: very stiff tendons reach rounding earlier
FAR = 1e100  # rate after a step that did not converge


def signed_tension(r, x, torque, body):
    """Return the signed force [N] of tendon r at coordinates x (N,). It is the tension where positive; the tendon is
    slack where negative.

    `torque` (N + R,) holds behind the N torques the input of each tendon [N]: k u or a tension.
    """
    bent = 0.0 * x[0]
    for i in range(len(x)):
        bent = bent + (body.lever[r, i] + body.chord[r, i] * x[i]) * x[i]
    return body.pretension[r] + torque[len(x) + r] - body.tendon_stiffness[r] * bent


def write_arms(x, body, work):
    """Write the lever arms of all tendons at coordinates x (N,) to work.arm (R, N) [m]."""
    for r in range(len(body.friction)):
        for i in range(len(x)):
            work.arm[r, i] = body.lever[r, i] + 2.0 * body.chord[r, i] * x[i]


def tension(s):
    """Return the tension T = max(0, s) [N] of a tendon from its signed force s [N], and the derivative dT/ds."""
    if s.real >= 0.0:
        return s, 1.0 + 0.0 * s
    return 0.0 * s, 0.0 * s


def mean_tension(s0, s1):
    """Return the mean tension [N] of a tendon while its signed force goes from s0 to s1 [N] at a constant rate, and its
    derivative by s1.

    The mean is (W(s1) - W(s0)) / (s1 - s0) with W = max(0, s)^2 / 2, so that over a step the tendon stores exactly the
    work done on it, slack or taut.
    """
    if s0.real >= 0.0 and s1.real >= 0.0:
        return 0.5 * (s0 + s1), 0.5 + 0.0 * s1
    if s1.real > 0.0:
        part = s1 / (s1 - s0)
        return 0.5 * s1 * part, part - 0.5 * part * part
    if s0.real > 0.0:
        part = s0 / (s0 - s1)
        return 0.5 * s0 * part, 0.5 * part * part
    return 0.0 * s1, 0.0 * s1


def swing_angle(k, x):
    """Return the size [rad] of the swing of joint k, sqrt(a^2 + b^2) of its two angles in the coordinates x (N,)."""
    return np.sqrt(x[2 * k] * x[2 * k] + x[2 * k + 1] * x[2 * k + 1] + TINY)


def drawn_in(r, k, v, body, work):
    """Return the rate [m/s] at which the path of tendon r shortens beyond its entry (k = 0) or beyond the middle of the
    arc of joint k - 1, at rates v (N,) [rad/s] and lever arms work.arm. With changes of the coordinates for v, and the
    arms in the middle of the change, it is the length drawn in [m].
    """
    w = 0.0 * v[0]
    for i in range(len(v)):
        w = w + body.beyond[i, k] * (work.arm[r, i] * v[i])
    return w


def grip(r, k, T, x, body):
    """Return the size of the relative loss of tension by friction for tendon r with the tension T [N]: at its entry
    (k = 0) the fraction of T, min(1, F / T), else the exponent mu theta of joint k - 1.
    """
    if k > 0:
        return body.friction[r] * swing_angle(k - 1, x)
    if T.real > body.entry_friction[r].real:
        return body.entry_friction[r] / T
    if body.entry_friction[r].real > 0.0:
        return 1.0 + 0.0 * T
    return 0.0 * T


def slip(r, v, body, work):
    """Write the slip direction of tendon r at its entry and at each of n joints to work.run[r], from -1 (towards the
    tip) to 1 (towards the base), and its derivative with respect to the rate of slip [s/m] to work.ease[r].

    run = w / sqrt(w^2 + w_0^2), with the rate of slip w of `drawn_in` at rates v (N,) and the slip rate w_0, after
    `write_arms`. Without friction nothing is written.
    """
    if not (body.friction[r] + body.entry_friction[r]).real > 0.0:
        return
    edge = body.slip_rate[r] * body.slip_rate[r]
    for k in range(body.beyond.shape[1]):
        w = drawn_in(r, k, v, body, work)
        root = np.sqrt(w * w + edge)
        work.run[r, k] = w / root
        work.ease[r, k] = edge / (root * root * root)


def pass_on(r, T, x, body, work):
    """Write the fraction of the tension T [N] of tendon r that friction leaves: behind its entry and each of n joints
    to work.kept[r] (n + 1,), and on average at each of N coordinates to work.felt[r] (N,).

    A coordinate feels the mean over the joints at which it draws the tendon in, weighted by `body.beyond`.
    """
    before = 1.0 + 0.0 * x[0]
    for i in range(len(x)):
        work.felt[r, i] = before
    for k in range(body.beyond.shape[1]):
        loss = grip(r, k, T, x, body) * work.run[r, k]
        behind = before * np.exp(-loss) if k > 0 else 1.0 - loss
        for i in range(len(x)):
            work.felt[r, i] = work.felt[r, i] - body.beyond[i, k] * (before - behind)
        work.kept[r, k] = behind
        before = behind


def clear_pull(work):
    """Set the torques (N,) of all tendons to 0: work.pull without friction, and work.rub due to friction."""
    for i in range(len(work.pull)):
        work.pull[i] = 0.0 * work.t[i]
        work.rub[i] = 0.0 * work.t[i]


def add_pull(r, T, work):
    """Add the torques of tendon r at the tension T [N] to work.pull (N,), and their change by friction to work.rub (N,)
    [N m].

    `pass_on` must have written work.felt, and `write_arms` work.arm before.
    """
    for i in range(len(work.pull)):
        torque = work.arm[r, i] * T
        work.pull[i] = work.pull[i] + torque
        work.rub[i] = work.rub[i] + torque * (work.felt[r, i] - 1.0)


def tendon_torques(x, torque, body, work):
    """Write the torques of all tendons at coordinates x (N,) to work.pull, and their change by friction to work.rub
    (N,) [N m].

    `torque` (N + R,) holds behind the N torques the input [N] of each tendon. The slip direction is that of `work.run`.
    """
    clear_pull(work)
    write_arms(x, body, work)
    for r in range(len(body.friction)):
        T, _ = tension(signed_tension(r, x, torque, body))
        pass_on(r, T, x, body, work)
        add_pull(r, T, work)


def accelerate(x, v, torque, body, joints, work, a):
    """Write the accelerations a (N,) [rad/s^2] of a chain in space with tendons, at coordinates x and rates v (N,).

    `spatial.acceleration` is the function for a chain without tendons.

    `torque` (N + R,) holds the torques [N m] of the coordinates, then the input [N] of each tendon.
    """
    write_arms(x, body, work)
    for r in range(len(body.friction)):
        slip(r, v, body, work)
    tendon_torques(x, torque, body, work)
    for i in range(len(x)):
        work.move[i] = torque[i] + work.pull[i] + work.rub[i]
    acceleration(x, v, work.move, body, joints, work, a)


def forces_at_rest(x, torque, body, joints, work, forces):
    """Write the net generalized force of inputs, tendons, springs and gravity on a chain at rest at x (N,) to forces
    (N,) [N m].

    It is zero in equilibrium. Friction acts as `work.run` says: 1 where a tendon was last pulled in, -1 where it was
    let out, 0 for none.
    """
    tendon_torques(x, torque, body, work)
    for i in range(len(x)):
        work.move[i] = torque[i] + work.pull[i] + work.rub[i]
    static_forces(x, work.move, body, joints, work, forces)


def start_tensions(x, torque, body, work):
    """Write the signed forces [N] of all R tendons at the start of a step to work.start (R,). Set work.slope (R,), the
    tension slopes of the last iteration, to -1 to mark that no iteration was made.

    No tendon has the slope -1: the first comparison of slopes finds a change.
    """
    for r in range(len(body.friction)):
        work.start[r] = signed_tension(r, x, torque, body)
        work.slope[r] = -1.0 + 0.0 * x[0]


def mean_tensions(v, h, body, work):
    """Write the mean tensions [N] of all R tendons over a step of h [s] to work.tension (R,), for the rate changes
    work.a (N,).

    work.slope (R,) receives their slopes. Returns 1 if no slope has changed, else 0.
    """
    same = 1.0
    for i in range(len(v)):
        work.v[i] = v[i] + 0.5 * work.a[i]
    for r in range(len(body.friction)):
        change = 0.0 * v[0]
        for i in range(len(v)):
            change = change + work.arm[r, i] * work.v[i]
        T, slope = mean_tension(work.start[r], work.start[r] - h * body.tendon_stiffness[r] * change)
        if slope.real != work.slope[r].real:
            same = 0.0
        work.tension[r] = T
        work.slope[r] = slope
    return same


def pull_over_step(v, h, body, work):
    """Write the mean torques (N,) [N m] of all tendons over a time step to work.pull and work.rub, for the rate changes
    work.a (N,).

    After `start_tensions`. `slope` (R,) keeps the derivatives of the mean tensions by the force at the end of the step.
    Returns 1 if these are unchanged and there is no friction, in which case Newton's method has converged at work.a,
    else 0.
    """
    same = mean_tensions(v, h, body, work) * (1.0 - rubs(body))
    clear_pull(work)
    for r in range(len(body.friction)):
        slip(r, work.v, body, work)
        pass_on(r, work.tension[r], work.q, body, work)
        add_pull(r, work.tension[r], work)
    return same


def add_slopes(r, h, body, work):
    """Add the stiffness and friction terms of tendon r to the Newton matrix work.B (N, N) of an implicit time step.

    The torque of coordinate i is g_i T felt_i. A change of the slip at the entry or a joint changes the tension behind
    it and behind all joints beyond it, which is the part `left` of felt_i.
    """
    size = len(work.a)
    last = body.beyond.shape[1] - 1
    stiff = 0.5 * h * body.tendon_stiffness[r] * work.slope[r]
    entered = work.kept[r, 0]
    if work.tension[r].real > body.entry_friction[r].real and body.entry_friction[r].real > 0.0:
        stiff = stiff / entered  # T felt_i is (T - F run) times a constant
    for i in range(size):
        moved = h * work.arm[r, i]
        for j in range(size):
            work.B[i, j] = work.B[i, j] + moved * (stiff * work.felt[r, i]) * work.arm[r, j]
        if (body.friction[r] + body.entry_friction[r]).real > 0.0:
            left = 0.0 * moved
            for k in range(last, -1, -1):
                left = left + body.beyond[i, k] * work.kept[r, k]
                if k < last:
                    left = left - body.beyond[i, k + 1] * work.kept[r, k]
                part = left if k > 0 else left / max(entered.real, TINY)
                loss = grip(r, k, work.tension[r], work.q, body) * work.ease[r, k]
                weight = 0.5 * moved * work.tension[r] * loss * part
                for j in range(size):
                    work.B[i, j] = work.B[i, j] + weight * body.beyond[j, k] * work.arm[r, j]


def eliminate(B, b):
    """Solve B x = b in place by Gaussian elimination: b (N,) becomes x, and B (N, N) is overwritten.

    There is no pivoting, because B is close to a positive definite inertia.
    """
    size = len(b)
    for k in range(size):
        inverse = 1.0 / B[k, k]
        for i in range(k + 1, size):
            part = B[i, k] * inverse
            for j in range(k + 1, size):
                B[i, j] = B[i, j] - part * B[k, j]
            b[i] = b[i] - part * b[k]
    for k in range(size - 1, -1, -1):
        for j in range(k + 1, size):
            b[k] = b[k] - B[k, j] * b[j]
        b[k] = b[k] / B[k, k]


def next_move(h, body, work):
    """Add one Newton move for the force residual work.v (N,) to the rate changes work.a (N,), and return |residual .
    move|.

    Returns the absolute value of the product of residual and move (a real number).
    """
    for i in range(len(work.a)):
        work.move[i] = work.v[i]
        for j in range(len(work.a)):
            work.B[i, j] = work.A[max(i, j), min(i, j)]
    for r in range(len(body.friction)):
        add_slopes(r, h, body, work)
    eliminate(work.B, work.move)
    fall = 0.0
    for i in range(len(work.a)):
        work.a[i] = work.a[i] + work.move[i]
        fall = fall + (work.v[i] * work.move[i]).real
    return abs(fall)


def solve_step(v, h, body, work):
    """Iterate by Newton's method for the rate changes work.a (N,) of a step of h [s] that balance all forces. Return 1
    on convergence, else 0.

    Without friction the residual is the slope of a convex energy. A move is halved while the slope along it, at its
    end, has changed sign and is more than half as large as at its start. Numbers with complex-step derivatives need one
    more move after their values have converged, unless the mean tensions were linear over the last move.
    """
    fall = 0.0
    agreed = 0.0
    largest = 0.0
    size = 0.0
    for turn in range(ROUNDS):
        same = pull_over_step(v, h, body, work)
        largest = 0.0
        size = 0.0
        end = 0.0
        for i in range(len(v)):
            push = h * (work.t[i] - work.f[i] + work.pull[i] + work.rub[i])
            taken = 0.0 * push
            for j in range(len(v)):
                taken = taken + work.A[max(i, j), min(i, j)] * work.a[j]
            work.v[i] = push - taken
            end = end + (work.v[i] * work.move[i]).real
            largest = max(largest, abs(work.v[i].real))
            size = max(size, abs(taken.real), abs((h * work.t[i]).real), abs((h * work.f[i]).real))
            size = max(size, abs((h * work.pull[i]).real), abs((h * work.rub[i]).real))
        near = 0.0
        if largest <= AGREED * size:
            near = 1.0
        if turn > 0 and near * (same + agreed) > 0.0:
            break
        if turn > 0 and near + agreed == 0.0 and end < -0.5 * fall:
            fall = 0.5 * fall
            for i in range(len(v)):
                work.move[i] = 0.5 * work.move[i]
                work.a[i] = work.a[i] - work.move[i]
        else:
            agreed = near
            fall = next_move(h, body, work)
    if largest <= NEAR * size:
        return 1.0
    return 0.0


def rubs(body):
    """Return 1 if any tendon of the body has friction, else 0."""
    for r in range(len(body.friction)):
        if (body.friction[r] + body.entry_friction[r]).real > 0.0:
            return 1.0
    return 0.0


def pull_without_friction(body, work):
    """Write the generalized torques (N,) [N m] of all tendons at their mean tensions to work.pull."""
    for i in range(len(work.a)):
        work.pull[i] = 0.0 * work.a[i]
    for r in range(len(body.friction)):
        for i in range(len(work.a)):
            work.pull[i] = work.pull[i] + work.arm[r, i] * work.tension[r]


def build_taut(h, body, work):
    """Write the matrix A of a time step h [s], plus the stiffness terms of all taut tendons, to the lower triangle of
    work.B (N, N).
    """
    for i in range(len(work.a)):
        for j in range(i + 1):
            work.B[i, j] = work.A[i, j]
    for r in range(len(body.friction)):
        stiff = (0.5 * h * h) * body.tendon_stiffness[r] * work.slope[r]
        if stiff.real > 0.0:
            for i in range(len(work.a)):
                row = stiff * work.arm[r, i]
                for j in range(i + 1):
                    work.B[i, j] = work.B[i, j] + row * work.arm[r, j]


def factor_taut(B):
    """Replace the symmetric matrix B (N, N) of a step with taut tendons, from `build_taut`, by its LDL^T factors."""
    ldl_factor(B)


def solve_taut(h, t, f, pull, B, a):
    """Write the changes of the N rates in a step of h [s] to a (N,). They solve B a = h (t - f + pull), with the
    torques t of springs and inputs, f of inertia and gravity, and `pull` of the tendons [N m].

    `pull` (N,) is that for unchanged rates. B (N, N) holds the factors of `factor_taut`. Exact while no tendon turns
    slack or taut.
    """
    for i in range(len(a)):
        a[i] = h * (t[i] - f[i] + pull[i])
    ldl_solve_by_columns(B, a)


def step(x, v, h, torque, body, joints, work):
    """Advance coordinates x (N,) and rates v (N,) of a chain with R tendons in place by one step h [s]. `torque` (N +
    R,) holds the mean torque [N m] of each coordinate over the step, then the mean input [N] of each tendon.

    `spatial.step` is the function for a chain without tendons.

    Tensions are means over the step; lever arms and friction are those in mid-step. `work.a` keeps the change of v,
    `work.pull` the torques of the tendons without friction, and `work.rub` the change of these by friction. Without
    friction, and while no tendon turns slack or taut, the step is linear and takes one factorisation; else Newton's
    method solves it. Where that does not converge, the rates become `FAR`, which `follows` rejects.
    """
    build_step(x, v, h, torque, body, joints, work)
    write_arms(work.q, body, work)
    for i in range(len(x)):
        work.a[i] = 0.0 * v[i]
        work.rub[i] = 0.0 * v[i]
    start_tensions(x, torque, body, work)
    linear = 1.0 - rubs(body)
    if linear > 0.5:
        mean_tensions(v, h, body, work)
        pull_without_friction(body, work)
        build_taut(h, body, work)
        factor_taut(work.B)
    for _ in range(2):  # terms quadratic in the rates: at the start, then in mid-step
        for i in range(len(x)):
            work.v[i] = v[i] + 0.5 * work.a[i]
        inertial_forces(work.q, work.v, body, work, work.f)
        if linear > 0.5:
            solve_taut(h, work.t, work.f, work.pull, work.B, work.a)
            linear = mean_tensions(v, h, body, work)
        if linear < 0.5 and solve_step(v, h, body, work) < 0.5:
            for i in range(len(x)):
                work.a[i] = FAR + 0.0 * v[i]
            break
    if linear > 0.5:
        pull_without_friction(body, work)
    for i in range(len(x)):
        x[i] = x[i] + h * (v[i] + 0.5 * work.a[i])
        v[i] = v[i] + work.a[i]
