"""Tendons of a chain in space: length of a path, tension, slack, friction at its guides, and a step with them.

A tendon begins at the base, runs straight from guide to guide, each a point of a link, and ends at the last. Its length
l turns as the links do; with the tension T the coordinates x feel -T dl/dx. T follows from the length and from what
pulls, and is never negative: a cord cannot push. At a guide the tension falls by friction (capstan). Whatever leaves a
coordinate or an input goes into stored energy or into friction, and friction gives nothing back.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.spatial import acceleration, build_step, inertial_forces, pose_links
from pliant.equations.spatial_points import point_position, static_forces
from pliant.numerics.ldl import ldl_factor, ldl_solve

TINY = 1e-24  # under a root, so that it has a derivative at 0
ROUNDS = 25  # of Newton's method in a step, at most
AGREED = 1e-10  # of the largest torque of a step: what may be left of them


def measure_tendons(x, law, work, cords):
    """Write lengths l (C,) [m] and their slopes (C, N) [m/rad] of all tendons at coordinates x (N,) into `cords`.

    `work` holds the pose at x. From tip to base each piece adds to the slope of what lies beyond its first guide.
    """
    for c in range(len(cords.l)):
        first = law.first[c]
        last = law.first[c + 1] - 1
        length = (0.0 if last > first else law.rest_length[c]) + 0.0 * x[0]
        for i in range(len(x)):
            length = length + law.gain[c, i] * x[i]
            cords.gradient[c, i] = law.gain[c, i]
        for g in range(last, first - 1, -1):
            point_position(law.link[g], law.point[g, 0], law.point[g, 1], law.point[g, 2], work, cords.p[g])
            for i in range(len(x)):
                cords.beyond[g, i] = 0.0
            if g < last:
                length = length + add_piece(g, law, work, cords)
        cords.l[c] = length
        if last > first:
            for i in range(len(x)):
                cords.gradient[c, i] = cords.gradient[c, i] + cords.beyond[first, i]


def add_piece(g, law, work, cords):
    """Return the distance of guide g to the next [m]; write its direction u and the slope of the length beyond g.

    Only joints between the two guides change their distance: by u . (s x (p - r)), p the farther guide, r the joint.
    """
    n = work.P.shape[0]
    square = TINY + 0.0 * cords.p[g, 0]
    for i in range(3):
        cords.u[g, i] = cords.p[g + 1, i] - cords.p[g, i]
        square = square + cords.u[g, i] * cords.u[g, i]
    distance = np.sqrt(square)
    for i in range(3):
        cords.u[g, i] = cords.u[g, i] / distance
    for i in range(cords.beyond.shape[1]):
        cords.beyond[g, i] = cords.beyond[g + 1, i]
        k = i // 2 if i < 2 * n else i - 2 * n
        if law.link[g] < k <= law.link[g + 1]:
            for j in range(3):
                m = (j + 1) % 3
                o = (j + 2) % 3
                arm = work.S[i, m] * (cords.p[g + 1, o] - work.r[k + 1, o])
                arm = arm - work.S[i, o] * (cords.p[g + 1, m] - work.r[k + 1, m])
                cords.beyond[g, i] = cords.beyond[g, i] + cords.u[g, j] * arm
    return distance


def pull(c, l, drive, law):
    """Return the tension that tendon c of length l [m] would have if it could push: T_0 + k (l - l_0) + drive; N.

    The drive is a motor's tension, or k u where it pulls the tendon in by u; negative where it lets it out.
    """
    return law.pretension[c] + law.stiffness[c] * (l - law.rest_length[c]) + drive[c]


def tension(s):
    """Return the tension T [N] of a tendon from its `pull` s [N], and dT/ds: a cord cannot push."""
    if s.real > 0.0:
        return s, 1.0 + 0.0 * s
    return 0.0 * s, 0.0 * s


def mean_tension(s0, s1):
    """Return the mean of the tension [N] while the pull goes from s0 to s1 [N], and its slope by s1.

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


def tendon_energy(c, l, drive, law):
    """Return the energy that the elasticity of tendon c of length l [m] stores, J: T^2 / (2 k).

    0 for a tendon whose drive is its tension: what that takes or gives is the drive's work.
    """
    T, _ = tension(pull(c, l, drive, law))
    return 0.5 * T * T / law.stiffness[c] if law.stiffness[c] > 0.0 else 0.0 * T


def tense(drive, law, cords):
    """Write the tensions T (C,) [N] of all tendons at their lengths, and the slopes of these by the lengths."""
    for c in range(len(cords.l)):
        T, slope = tension(pull(c, cords.l[c], drive, law))
        cords.T[c] = T
        cords.slope[c] = slope * law.stiffness[c]


def tense_over(v, a, half, drive, law, cords):
    """Write the mean tensions T (C,) [N] over a step of 2 `half` [s] whose rates change from v by a (N,).

    `cords` holds the lengths in the middle of the step at rates v. `slope` is twice that of T by the length at the end.
    """
    for c in range(len(cords.l)):
        before = 0.0 * v[0]
        change = 0.0 * v[0]
        for i in range(len(v)):
            before = before + cords.gradient[c, i] * v[i]
            change = change + cords.gradient[c, i] * a[i]
        s0 = pull(c, cords.l[c] - half * before, drive, law)
        s1 = pull(c, cords.l[c] + half * (before + change), drive, law)
        T, slope = mean_tension(s0, s1)
        cords.T[c] = T
        cords.slope[c] = 2.0 * slope * law.stiffness[c]


def slip(v, law, cords):
    """Write towards where tendons slip over their guides at rates v (N,): run = w / sqrt(w^2 + w_0^2), and its slope.

    w [m/s] is the rate at which the length beyond a guide shortens, w_0 the slip rate. `cords` holds the lengths.
    """
    for c in range(len(cords.l)):
        edge = law.slip_rate[c] * law.slip_rate[c]
        for g in range(law.first[c], law.first[c + 1]):
            w = 0.0 * v[0]
            for i in range(len(v)):
                w = w - cords.beyond[g, i] * v[i]
            root = np.sqrt(w * w + edge)
            cords.run[g] = w / root
            cords.ease[g] = edge / (root * root * root)


def drop_tension(c, T, law, cords):
    """Write what the tension T [N] at the base of tendon c loses at each of its guides, and return that at its end; N.

    Over a guide it falls to exp(-mu beta run) of itself, beta the length |u' - u| of the change of direction: the angle
    turned, 1 % less at 30 degrees. `run` is 1 where the tendon slips towards the base, or last did; see `slip`.

    Source: Euler and Eytelwein's formula of the capstan
    """
    for g in range(law.first[c] + 1, law.first[c + 1] - 1):
        square = TINY + 0.0 * T
        for i in range(3):
            change = cords.u[g, i] - cords.u[g - 1, i]
            square = square + change * change
        grip = law.friction[c] * np.sqrt(square)
        kept = T * np.exp(-grip * cords.run[g])
        cords.drop[g] = T - kept
        cords.drop_slope[g] = kept * grip * cords.ease[g]
        T = kept
    return T


def tendon_torques(law, cords):
    """Write the torques t (N,) of all tendons, -sum_g T_g dl_g/dx over their pieces; N m.

    `cords` holds slopes of lengths, tensions T at the base and `run`. The drops at guides are written too.
    """
    for i in range(len(cords.t)):
        cords.t[i] = 0.0 * cords.t[i]
    for c in range(len(cords.l)):
        for i in range(len(cords.t)):
            cords.t[i] = cords.t[i] - cords.T[c] * cords.gradient[c, i]
        drop_tension(c, cords.T[c], law, cords)
        for g in range(law.first[c] + 1, law.first[c + 1] - 1):
            for i in range(len(cords.t)):
                cords.t[i] = cords.t[i] + cords.drop[g] * cords.beyond[g, i]


def add_tendon_slopes(half, law, cords, A):
    """Add to the lower triangle of A (N, N) what a step of 2 `half` [s] has implicit: h^2/4 dT/dl and h/2 of friction.

    After `tendon_torques`. Rank one for each tendon and guide, never negative; what friction leaves of dT/dl counts
    as all of it.
    """
    for c in range(len(cords.l)):
        for i in range(A.shape[0]):
            weight = half * half * cords.slope[c] * cords.gradient[c, i]
            for j in range(i + 1):
                A[i, j] = A[i, j] + weight * cords.gradient[c, j]
        for g in range(law.first[c] + 1, law.first[c + 1] - 1):
            for i in range(A.shape[0]):
                weight = half * cords.drop_slope[g] * cords.beyond[g, i]
                for j in range(i + 1):
                    A[i, j] = A[i, j] + weight * cords.beyond[g, j]


def friction_power(v, law, cords):
    """Return what friction at all guides takes at rates v (N,), W; never negative. After `tendon_torques`.

    The sum of drop times the rate at which the tendon slips towards the base.
    """
    power = 0.0 * v[0]
    for c in range(len(cords.l)):
        for g in range(law.first[c] + 1, law.first[c + 1] - 1):
            for i in range(len(v)):
                power = power - cords.drop[g] * cords.beyond[g, i] * v[i]
    return power


def acceleration_with_tendons(x, v, torque, tendons, body, joints, work, a):
    """Write the accelerations a (N,) of a chain with tendons, rad/s^2: `spatial.acceleration` with their torques.

    tendons: `symbols.Tendons`; torque (N,) is that of all other inputs, N m.
    """
    pose_links(x, body, work)
    drive, law, cords = tendons
    measure_tendons(x, law, work, cords)
    tense(drive, law, cords)
    slip(v, law, cords)
    tendon_torques(law, cords)
    for i in range(len(x)):
        cords.t[i] = cords.t[i] + torque[i]
    acceleration(x, v, cords.t, body, joints, work, a)


def static_forces_with_tendons(x, torque, tendons, body, joints, work, forces):
    """Write what inputs (N,), tendons, springs and weight do to x at rest, forces (N,): zero in equilibrium, N m.

    Friction holds as `tendons.work.run` says: 1 at guides over which a tendon was last pulled in, -1 let out, 0 none.
    """
    drive, law, cords = tendons
    static_forces(x, torque, body, joints, work, forces)
    measure_tendons(x, law, work, cords)
    tense(drive, law, cords)
    tendon_torques(law, cords)
    for i in range(len(x)):
        forces[i] = forces[i] + cords.t[i]


def step_with_tendons(x, v, h, torque, tendons, body, joints, work):
    """Advance x and v (N,) in place by h [s] under mean torques (N,) and tendons: `spatial.step` with tendons.

    tendons: `symbols.Tendons`. The change a of v solves A a = h (t - f + t_tendons(a)) by Newton's method, tensions as
    means over the step and friction at its middle rates: one factorisation for each of the two solves where all tendons
    stay taut or slack and none rubs. `work.a` keeps a.
    """
    law, cords = tendons.law, tendons.work
    build_step(x, v, h, torque, body, joints, work)
    measure_tendons(work.q, law, work, cords)
    for i in range(len(x)):
        work.a[i] = 0.0 * v[i]
        for j in range(i + 1):
            cords.A[i, j] = work.A[i, j]
    inertial_forces(work.q, v, body, work, work.f)
    solve_step(v, h, tendons, work)
    for i in range(len(x)):
        work.v[i] = v[i] + 0.5 * work.a[i]
    inertial_forces(work.q, work.v, body, work, work.f)
    solve_step(v, h, tendons, work)
    for i in range(len(x)):
        x[i] = x[i] + h * (v[i] + 0.5 * work.a[i])
        v[i] = v[i] + work.a[i]


def solve_step(v, h, tendons, work):
    """Improve work.a (N,), the change of v over a step of h [s], until forces in work.f and tendons agree with it."""
    drive, law, cords = tendons
    half = 0.5 * h
    for _ in range(ROUNDS):
        tense_over(v, work.a, half, drive, law, cords)
        for i in range(len(v)):
            work.v[i] = v[i] + 0.5 * work.a[i]
        slip(work.v, law, cords)
        tendon_torques(law, cords)
        largest = 0.0
        size = 0.0
        for i in range(len(v)):
            push = h * (work.t[i] - work.f[i] + cords.t[i])
            taken = 0.0 * push
            for j in range(len(v)):
                taken = taken + cords.A[max(i, j), min(i, j)] * work.a[j]
            work.v[i] = push - taken
            largest = max(largest, abs(work.v[i].real))
            size = max(size, abs(push.real), abs(taken.real))
        if largest <= AGREED * size:
            break
        for i in range(len(v)):
            for j in range(i + 1):
                work.A[i, j] = cords.A[i, j]
        add_tendon_slopes(half, law, cords, work.A)
        ldl_factor(work.A)
        ldl_solve(work.A, work.v)
        for i in range(len(v)):
            work.a[i] = work.a[i] + work.v[i]
