"""Segments of a chain in space that lengthen, each with one uniform axial strain as an additional coordinate.

The strains follow the angles in the coordinates x.

The length of link k is st_k times its unstretched length, st_k = 1 + sum_s a_ks e_s. Here a_ks is the fraction of link
k that lies in segment s, and k = 0 is the part before the first joint. The mass of a link lies along its axis in
u_k = st_k z_k, and a strain moves it by a_ks z_k. The second moment of each cross-section, half of the moment about the
axis, does not change. Without such segments these functions add no operation to a step.
"""

from __future__ import annotations


def stretch_links(x, body, work):
    """Write stretch, length, centre of mass and lateral inertia of all stretched links to `work`, at the coordinates x
    (N,).
    """
    n = len(body.mass)
    turns = len(work.S)
    for k in range(n + 1):
        work.stretch[k] = 1.0
        work.length[k] = body.length[k]
    for k in range(n):
        work.centre[k] = body.centre[k]
        work.lateral[k] = body.lateral[k]
    if body.share.shape[1] > 0:
        for k in range(n + 1):
            stretch = 1.0 + 0.0 * x[0]
            for s in range(body.share.shape[1]):
                stretch = stretch + body.share[k, s] * x[turns + s]
            work.stretch[k] = stretch
            work.length[k] = stretch * body.length[k]
        for k in range(n):
            stretch = work.stretch[k + 1]
            work.centre[k] = stretch * body.centre[k]
            work.lateral[k] = 0.5 * body.axial[k] + stretch * stretch * (body.lateral[k] - 0.5 * body.axial[k])


def stretch_rates(v, body, work):
    """Write the rate of each link's stretch to work.growth (n + 1,) [1/s], from the rates v (N,) of the coordinates."""
    turns = len(work.S)
    if body.share.shape[1] > 0:
        for k in range(len(body.mass) + 1):
            growth = 0.0 * v[0]
            for s in range(body.share.shape[1]):
                growth = growth + body.share[k, s] * v[turns + s]
            work.growth[k] = growth


def along_axis(k, body):
    """Return the second moment of mass [kg m^2] of unstretched link k along its axis, about its joint."""
    return body.lateral[k] - 0.5 * body.axial[k] + body.mass[k] * body.centre[k] * body.centre[k]


def add_strain_inertia(quarter, body, work, A):
    """Write the rows of the segment strains to the matrix A (N, N) of an implicit step, below the rows of the angles.

    A is the matrix of `spatial.inertia`.

    A unit acceleration of st_k accelerates the joint beyond link k by l_k z_k. It needs the force h_k z_k, where h_k is
    the first moment m c of the link and of all mass beyond it at its end, and the moment l_k C_{k+1} x z_k about the
    joint of k.
    """
    if body.share.shape[1] > 0:
        n = len(body.mass)
        mass = 0.0 * body.mass[0]  # beyond the link
        for k in range(n, -1, -1):
            work.h[k] = mass * body.length[k]
            work.second[k] = work.h[k] * body.length[k]
            if k > 0:
                work.h[k] = work.h[k] + body.mass[k - 1] * body.centre[k - 1]
                work.second[k] = work.second[k] + along_axis(k - 1, body)
                mass = mass + body.mass[k - 1]
        for s in range(body.share.shape[1]):
            row = len(work.S) + s
            inner_turns(s, quarter, body, work, A[row])
            outer_turns(s, body, work, A[row])
            for t in range(s + 1):
                value = 0.0 * work.along[0]
                for k in range(n + 1):
                    value = value + body.share[k, t] * work.along[k]
                A[row, len(work.S) + t] = value


def inner_turns(s, quarter, body, work, row):
    """Write the torque at each joint due to the lengthening of the links beyond it, per unit acceleration of strain s,
    to the entries of the joint angles in `row` (N,).

    From tip to base, work.alpha holds the force and work.omega the moment about the origin of all links from k on, and
    work.along the inertial force along each link. The slope of gravity enters as in `spatial.moment_of_turn`.
    """
    n = len(body.mass)
    for j in range(3):
        work.omega[j] = 0.0
        work.alpha[j] = 0.0
    for k in range(n, -1, -1):
        part = body.share[k, s]
        force = part * work.h[k]
        work.turn[0] = work.r[k, 0] + quarter * body.gx
        work.turn[1] = work.r[k, 1] + quarter * body.gy
        work.turn[2] = work.r[k, 2] + quarter * body.gz
        work.along[k] = part * work.second[k]
        for j in range(3):
            work.along[k] = work.along[k] + body.length[k] * work.R[k, j, 2] * work.alpha[j]
        for j in range(3):
            m = (j + 1) % 3
            o = (j + 2) % 3
            x = force * work.turn[m]
            y = force * work.turn[o]
            if k < n:
                x = x + part * body.length[k] * work.C[k, m]
                y = y + part * body.length[k] * work.C[k, o]
            work.omega[j] = work.omega[j] + (x * work.R[k, o, 2] - y * work.R[k, m, 2])
        for j in range(3):
            work.alpha[j] = work.alpha[j] + force * work.R[k, j, 2]
        for i in range(len(work.S)):
            if (i // 2 if i < 2 * n else i - 2 * n) == k - 1:
                value = work.S[i, 0] * work.omega[0] + work.E[i, 0] * work.alpha[0]
                value = value + (work.S[i, 1] * work.omega[1] + work.E[i, 1] * work.alpha[1])
                row[i] = value + (work.S[i, 2] * work.omega[2] + work.E[i, 2] * work.alpha[2])


def outer_turns(s, body, work, row):
    """Add the torque at each joint due to the lengthening of the parts before it, per unit acceleration of strain s, to
    the entries of the joint angles in `row` (N,).

    From base to tip, work.lift holds the acceleration of joint k. The forces along the links, work.along, are updated
    too.
    """
    n = len(body.mass)
    for i in range(3):
        work.lift[i] = 0.0
    for k in range(n + 1):
        for i in range(len(work.S)):
            if (i // 2 if i < 2 * n else i - 2 * n) == k - 1:
                for j in range(3):
                    row[i] = row[i] + work.lift[j] * work.F[i, j]
        for j in range(3):
            z = work.R[k, j, 2]
            work.along[k] = work.along[k] + work.h[k] * work.lift[j] * z
            work.lift[j] = work.lift[j] + body.share[k, s] * body.length[k] * z


def lengthen_link(k, turned, body, work):
    """Add the inertial force and moment due to the lengthening of link k to work.L[k] and work.M[k].

    At constant rates u = st z, the vector along the link, has the additional acceleration 2 st' z' (u'' = st z'' + 2
    st' z').

    k counts from 0 and `turned` (3,) is z'. work.lift receives the acceleration due to growth, work.along the force of
    the link's own mass along its axis, with z . z'' = -z'^2.
    """
    if body.share.shape[1] > 0:
        dx, dy, dz = turned
        x = work.R[k + 1, 0, 2]
        y = work.R[k + 1, 1, 2]
        z = work.R[k + 1, 2, 2]
        lever = body.mass[k] * body.centre[k]
        second = along_axis(k, body)
        inward = work.stretch[k + 1] * (dx * dx + dy * dy + dz * dz)
        lifted = x * work.lift[0] + y * work.lift[1] + z * work.lift[2]
        work.along[k + 1] = lever * lifted - second * inward
        twice = 2.0 * work.growth[k + 1]
        across = work.stretch[k + 1] * second * twice
        work.M[k, 0] = work.M[k, 0] + across * (y * dz - z * dy)
        work.M[k, 1] = work.M[k, 1] + across * (z * dx - x * dz)
        work.M[k, 2] = work.M[k, 2] + across * (x * dy - y * dx)
        for j in range(3):
            rate = twice * turned[j]
            work.L[k, j] = work.L[k, j] + lever * rate
            work.lift[j] = work.lift[j] + body.length[k + 1] * rate


def strain_forces(body, work, f):
    """Write the centrifugal, Coriolis and gravity forces [N m] of the S segment strains to the last S entries of f
    (N,).

    work.L holds the force on each link with all links beyond it, and work.along [N m] the force along each link's own
    axis times its length.
    """
    if body.share.shape[1] > 0:
        n = len(body.mass)
        work.along[0] = 0.0 * body.length[0]
        for k in range(n):
            for j in range(3):
                work.along[k] = work.along[k] + body.length[k] * work.R[k, j, 2] * work.L[k, j]
        for s in range(body.share.shape[1]):
            value = 0.0 * work.along[0]
            for k in range(n + 1):
                value = value + body.share[k, s] * work.along[k]
            f[len(work.S) + s] = value
