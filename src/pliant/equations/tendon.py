"""Tendons of a chain in space: tension, slack, friction along the path, and a step with them.

A tendon r at constant levers g_r (N,) [m/rad] has the length l_0 - g_r . x, exact for a body that bends in arcs. Drawn
in by u it would pull with s = k (u - g_r . x) + T_0 if it could push; it pulls with T = max(0, s). Over a joint that
swings by theta the tension falls to exp(-mu theta run) of itself (capstan), and the joint feels the mean of the
tensions before and behind it. `run` is 1 where the tendon slips towards the base, -1 towards the tip, with a smooth
change between. Whatever leaves a coordinate or an input goes into stored energy or into friction, and friction gives
nothing back.

Source: Euler and Eytelwein's formula of the capstan
"""

from __future__ import annotations

import numpy as np

from pliant.equations.spatial import acceleration, build_step, inertial_forces
from pliant.equations.spatial_points import static_forces
from pliant.numerics.ldl import ldl_factor, ldl_solve

TINY = 1e-24  # under a root, so that it has a derivative at 0
ROUNDS = 50  # of Newton's method in a step, at most
AGREED = 1e-10  # of the largest torque of a step: what may be left of them
NEAR = 1e-6  # the same after all rounds: very stiff tendons round off earlier
FAR = 1e100  # rate after a step that found no agreement


def signed_tension(r, x, torque, body):
    """Return the force s [N] of tendon r at coordinates x (N,), of either sign: its tension where it is taut.

    What draws it in, k u or a tension [N], is behind torque (N,).
    """
    bent = 0.0 * x[0]
    for i in range(len(x)):
        bent = bent + body.lever[r, i] * x[i]
    return body.pretension[r] + torque[len(x) + r] - body.tendon_stiffness[r] * bent


def tension(s):
    """Return the tension T [N] from the force s [N] of `signed_tension`, and dT/ds: a tendon cannot push."""
    if s.real >= 0.0:
        return s, 1.0 + 0.0 * s
    return 0.0 * s, 0.0 * s


def mean_tension(s0, s1):
    """Return the mean of the tension [N] while s goes from s0 to s1 [N] at a constant rate, and its slope by s1.

    (W(s1) - W(s0)) / (s1 - s0) with W = max(0, s)^2 / 2: over a step the tendon stores what it takes, slack or taut.
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
    """Return the size of the swing of joint k at coordinates x (N,), rad."""
    return np.sqrt(x[2 * k] * x[2 * k] + x[2 * k + 1] * x[2 * k + 1] + TINY)


def slip(r, x, v, body, work):
    """Write `run` (R, n) of tendon r at rates v (N,): w / sqrt(w^2 + w_0^2), and mu theta times its slope to `ease`.

    w [m/s] is the rate at which the length from the middle of a joint's arc to the end of the tendon shortens, w_0 the
    slip rate. Without friction nothing is written.
    """
    if not body.friction[r].real > 0.0:
        return
    edge = body.slip_rate[r] * body.slip_rate[r]
    for k in range(len(body.mass)):
        w = 0.0 * v[0]
        for i in range(len(v)):
            w = w + body.beyond[i, k] * (body.lever[r, i] * v[i])
        root = np.sqrt(w * w + edge)
        work.run[r, k] = w / root
        work.ease[r, k] = body.friction[r] * swing_angle(k, x) * edge / (root * root * root)


def pass_on(r, x, body, work):
    """Write fractions of the tension of tendon r: behind each joint `kept` (R, n), for each coordinate `felt` (R, N).

    A coordinate feels the mean over where it draws the tendon in, by `body.beyond`.
    """
    if not body.friction[r].real > 0.0:
        for i in range(len(x)):
            work.felt[r, i] = 1.0 + 0.0 * x[0]
        return
    before = 1.0 + 0.0 * x[0]
    for i in range(len(x)):
        work.felt[r, i] = before
    for k in range(len(body.mass)):
        behind = before * np.exp(-body.friction[r] * swing_angle(k, x) * work.run[r, k])
        for i in range(len(x)):
            work.felt[r, i] = work.felt[r, i] - body.beyond[i, k] * (before - behind)
        work.kept[r, k] = behind
        before = behind


def clear_pull(work):
    """Set the torques of tendons to 0: `pull` without friction and `rub` of friction, (N,)."""
    for i in range(len(work.pull)):
        work.pull[i] = 0.0 * work.t[i]
        work.rub[i] = 0.0 * work.t[i]


def add_pull(r, T, body, work):
    """Add the torques of tendon r at the tension T [N] to `pull` and `rub` (N,), N m. After `pass_on`."""
    for i in range(len(work.pull)):
        torque = body.lever[r, i] * T
        work.pull[i] = work.pull[i] + torque
        work.rub[i] = work.rub[i] + torque * (work.felt[r, i] - 1.0)


def tendon_torques(x, torque, body, work):
    """Write the torques of all tendons at coordinates x (N,) to `pull` and `rub` (N,), N m; `run` is as `work` has it.

    torque (N + R,): what draws the tendons in [N] is behind that of the coordinates.
    """
    clear_pull(work)
    for r in range(len(body.friction)):
        T, _ = tension(signed_tension(r, x, torque, body))
        pass_on(r, x, body, work)
        add_pull(r, T, body, work)


def accelerate(x, v, torque, body, joints, work, a):
    """Write the accelerations a (N,) of a chain with tendons, rad/s^2: `spatial.acceleration` with their torques.

    torque (N + R,): what draws the tendons in [N] is behind that of the coordinates [N m].
    """
    for r in range(len(body.friction)):
        slip(r, x, v, body, work)
    tendon_torques(x, torque, body, work)
    for i in range(len(x)):
        work.move[i] = torque[i] + work.pull[i] + work.rub[i]
    acceleration(x, v, work.move, body, joints, work, a)


def forces_at_rest(x, torque, body, joints, work, forces):
    """Write what inputs (N + R,), tendons, springs and weight do to x at rest, forces (N,): zero in equilibrium, N m.

    Friction holds as `work.run` says: 1 where a tendon was last pulled in, -1 let out, 0 for none.
    """
    tendon_torques(x, torque, body, work)
    for i in range(len(x)):
        work.move[i] = torque[i] + work.pull[i] + work.rub[i]
    static_forces(x, work.move, body, joints, work, forces)


def pull_over_step(x, v, h, torque, body, work):
    """Write the mean torques of all tendons over a step from x at rates v (N,) that change by work.a; N m.

    `slope` (R,) keeps the slopes of mean tensions by the force at the end. Returns whether these are what they were
    and nothing rubs: work.a is then the end of Newton's method.
    """
    clear_pull(work)
    same = 1.0
    for i in range(len(x)):
        work.v[i] = v[i] + 0.5 * work.a[i]
    for r in range(len(body.friction)):
        change = 0.0 * v[0]
        for i in range(len(x)):
            change = change + body.lever[r, i] * work.v[i]
        s0 = signed_tension(r, x, torque, body)
        T, slope = mean_tension(s0, s0 - h * body.tendon_stiffness[r] * change)
        if slope.real != work.slope[r].real or body.friction[r].real > 0.0:
            same = 0.0
        work.slope[r] = slope
        work.tension[r] = T
        slip(r, work.q, work.v, body, work)
        pass_on(r, work.q, body, work)
        add_pull(r, T, body, work)
    return same


def add_slopes(r, h, body, work):
    """Add to B (N, N) what tendon r has implicit in a step of h [s]: -h times the slope of its torques by work.a.

    Coordinate i feels g_i T felt_i. A change of the slip at joint k changes what is left behind k and all joints
    beyond: of felt_i the part `left`.
    """
    size = len(work.a)
    n = len(body.mass)
    stiff = 0.5 * h * body.tendon_stiffness[r] * work.slope[r]
    for i in range(size):
        own = h * body.lever[r, i]
        for j in range(size):
            work.B[i, j] = work.B[i, j] + own * (stiff * work.felt[r, i]) * body.lever[r, j]
        if body.friction[r].real > 0.0:
            left = 0.0 * own
            for k in range(n - 1, -1, -1):
                left = left + body.beyond[i, k] * work.kept[r, k]
                if k + 1 < n:
                    left = left - body.beyond[i, k + 1] * work.kept[r, k]
                weight = 0.5 * own * work.tension[r] * work.ease[r, k] * left
                for j in range(size):
                    work.B[i, j] = work.B[i, j] + weight * body.beyond[j, k] * body.lever[r, j]


def eliminate(B, b):
    """Solve B x = b in place: b (N,) becomes x, B (N, N) is lost. Without a change of rows: B is an inertia at core."""
    size = len(b)
    for k in range(size):
        one = 1.0 / B[k, k]
        for i in range(k + 1, size):
            part = B[i, k] * one
            for j in range(k + 1, size):
                B[i, j] = B[i, j] - part * B[k, j]
            b[i] = b[i] - part * b[k]
    for k in range(size - 1, -1, -1):
        for j in range(k + 1, size):
            b[k] = b[k] - B[k, j] * b[j]
        b[k] = b[k] / B[k, k]


def next_move(h, body, work):
    """Make a move of Newton's method for what is left of the torques, work.v (N,); add it to work.a.

    Returns the size of the product of both, real.
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


def solve_step(x, v, h, torque, body, work):
    """Improve work.a (N,), the change of v over a step of h [s], until forces in work.f and tendons agree with it.

    Newton's method. Without friction what is left of the torques is the slope of a convex energy: a move is halved
    while that rises at its end by more than half of what it fell by at its start. Derivatives that numbers carry need
    one more move after their values agree, unless tensions have gone on along the line that the last move took.
    Returns whether all agrees in the end.
    """
    fall = 0.0
    agreed = 0.0
    largest = 0.0
    size = 0.0
    for turn in range(ROUNDS):
        same = pull_over_step(x, v, h, torque, body, work)
        largest = 0.0
        size = 0.0
        end = 0.0
        for i in range(len(x)):
            push = h * (work.t[i] - work.f[i] + work.pull[i] + work.rub[i])
            taken = 0.0 * push
            for j in range(len(x)):
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
            for i in range(len(x)):
                work.move[i] = 0.5 * work.move[i]
                work.a[i] = work.a[i] - work.move[i]
        else:
            agreed = near
            fall = next_move(h, body, work)
    if largest <= NEAR * size:
        return 1.0
    return 0.0


def rubs(body):
    """Return 1 if any tendon has friction, else 0."""
    for r in range(len(body.friction)):
        if body.friction[r].real > 0.0:
            return 1.0
    return 0.0


def start_tensions(x, torque, body, work):
    """Write the signed tensions [N] at the start of a step to work.start (R,), and set work.slope (R,) to -1.

    No tendon has the slope -1, so that the first comparison of slopes finds a change.
    """
    for r in range(len(body.friction)):
        work.start[r] = signed_tension(r, x, torque, body)
        work.slope[r] = -1.0 + 0.0 * x[0]


def mean_tensions(v, h, body, work):
    """Write the mean tensions [N] over a step from rates v (N,) that change by work.a to work.tension (R,).

    work.slope (R,) receives their slopes. Returns 1 if no slope has changed, else 0.
    """
    same = 1.0
    for i in range(len(v)):
        work.v[i] = v[i] + 0.5 * work.a[i]
    for r in range(len(body.friction)):
        change = 0.0 * v[0]
        for i in range(len(v)):
            change = change + body.lever[r, i] * work.v[i]
        T, slope = mean_tension(work.start[r], work.start[r] - h * body.tendon_stiffness[r] * change)
        if slope.real != work.slope[r].real:
            same = 0.0
        work.tension[r] = T
        work.slope[r] = slope
    return same


def pull_without_friction(body, work):
    """Write the torques of tendons at their mean tensions to work.pull (N,), N m."""
    for i in range(len(work.a)):
        work.pull[i] = 0.0 * work.a[i]
    for r in range(len(body.friction)):
        for i in range(len(work.a)):
            work.pull[i] = work.pull[i] + body.lever[r, i] * work.tension[r]


def build_taut(h, body, work):
    """Write A plus the implicit stiffness of tendons over a step of h [s] to the lower triangle of work.B (N, N)."""
    for i in range(len(work.a)):
        for j in range(i + 1):
            work.B[i, j] = work.A[i, j]
    for r in range(len(body.friction)):
        stiff = (0.5 * h * h) * body.tendon_stiffness[r] * work.slope[r]
        if stiff.real > 0.0:
            for i in range(len(work.a)):
                row = stiff * body.lever[r, i]
                for j in range(i + 1):
                    work.B[i, j] = work.B[i, j] + row * body.lever[r, j]


def factor_taut(work):
    """Replace the matrix work.B (N, N) of `build_taut` by its factors."""
    ldl_factor(work.B)


def solve_taut(h, work):
    """Write the change of the rates over a step of h [s] to work.a (N,), with the factors in work.B (N, N).

    work.pull (N,) holds the torques of the tendons for unchanged rates. Exact while no tendon turns slack or taut.
    """
    for i in range(len(work.a)):
        work.a[i] = h * (work.t[i] - work.f[i] + work.pull[i])
    ldl_solve(work.B, work.a)


def step(x, v, h, torque, body, joints, work):
    """Advance x and v (N,) in place by h [s] under mean torques (N + R,) and tendons: `spatial.step` with tendons.

    Tensions are means over the step, friction acts by the middle rates. `work.a` keeps the change of v, `work.pull`
    and `work.rub` what tendons pull and what friction takes of it. Without friction, and while no tendon turns slack or
    taut, the step is linear and takes one factorisation.
    Where tensions and motion find no agreement, rates become `FAR`, which `follows` refuses.
    """
    build_step(x, v, h, torque, body, joints, work)
    for i in range(len(x)):
        work.a[i] = 0.0 * v[i]
        work.rub[i] = 0.0 * v[i]
    linear = 1.0 - rubs(body)
    if linear > 0.5:
        start_tensions(x, torque, body, work)
        mean_tensions(v, h, body, work)
        pull_without_friction(body, work)
        build_taut(h, body, work)
        factor_taut(work)
    for _ in range(2):  # the forces with the square of the rates: first at the initial rates, then at the middle ones
        for i in range(len(x)):
            work.v[i] = v[i] + 0.5 * work.a[i]
        inertial_forces(work.q, work.v, body, work, work.f)
        if linear > 0.5:
            solve_taut(h, work)
            linear = mean_tensions(v, h, body, work)
        if linear < 0.5 and solve_step(x, v, h, torque, body, work) < 0.5:
            for i in range(len(x)):
                work.a[i] = FAR + 0.0 * v[i]
            break
    if linear > 0.5:
        pull_without_friction(body, work)
    for i in range(len(x)):
        x[i] = x[i] + h * (v[i] + 0.5 * work.a[i])
        v[i] = v[i] + work.a[i]
