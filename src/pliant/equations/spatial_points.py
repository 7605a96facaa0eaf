"""Points of a chain in space: their positions and derivatives, forces at them, and the energies of the chain.

`work` is a scratch record which holds the pose written by `spatial.pose_links`.
"""

from __future__ import annotations

from pliant.equations.spatial import inertial_forces, pose_links, turn_on
from pliant.equations.spatial_extension import stretch_rates
from pliant.equations.spatial_springs import joint_torques


def point_position(link, aside, across, along, work, p):
    """Write the position p (3,) [m] of a point fixed to link `link` (-1: the part before the first joint). `aside`,
    `across` and `along` [m] are the point's coordinates on the link.

    `aside` is along x of the link, `across` along -y, as in the plane, and `along` along z of the unstretched link.
    """
    k = link + 1
    reach = work.stretch[k] * along
    for i in range(3):
        p[i] = work.r[k, i] + work.R[k, i, 0] * aside - work.R[k, i, 1] * across + work.R[k, i, 2] * reach


def point_slope(link, along, p, body, work, J):
    """Write the derivatives of a point's position with respect to the N coordinates to J (3, N). The point's position
    is p (3,) [m], and its distance along its link is `along` [m].

    The column of an angle is s x (p - r), that of a strain the sum of a_ks l_k z_k over all links before the point.
    """
    n = work.P.shape[0]
    turns = len(work.S)
    for axis in range(3):
        j = (axis + 1) % 3
        m = (axis + 2) % 3
        for i in range(turns):
            k = i // 2 if i < 2 * n else i - 2 * n
            moves = 1.0 if k <= link else 0.0
            arm = work.S[i, j] * (p[m] - work.r[k + 1, m]) - work.S[i, m] * (p[j] - work.r[k + 1, j])
            J[axis, i] = moves * arm
        for s in range(body.share.shape[1]):
            value = body.share[link + 1, s] * along * work.R[link + 1, axis, 2]
            for k in range(link + 1):
                value = value + body.share[k, s] * body.length[k] * work.R[k, axis, 2]
            J[axis, turns + s] = value


def place_points(x, link, offset, body, work, place, slope):
    """Write the positions (S, 3) [m] and Jacobians (S, 3, N) of S points at the coordinates x (N,). `link` (S,) gives
    the index of each point's link.

    `offset` (S, 3) holds aside, across and along of each point, m.
    """
    pose_links(x, body, work)
    for s in range(len(link)):
        point_position(link[s], offset[s, 0], offset[s, 1], offset[s, 2], work, place[s])
        point_slope(link[s], offset[s, 2], place[s], body, work, slope[s])


def add_pose_loads(load, body, work, t):
    """Add the generalized forces of external forces and moments on the links to t (N,) [N m], for the pose stored in
    `work`.

    `load` (n + 1, 3, 5), in fixed axes, holds for each link (first the part before the first joint) the sums over its
    points of: force times aside, force times -across, force times along [N m], force [N], and free moment [N m].

    Source: virtual work; a force at R o has the moment sum_m R_m x (f o_m) about the joint
    """
    n = len(body.mass)
    for k in range(n - 1, -1, -1):
        for i in range(3):
            j = (i + 1) % 3
            m = (i + 2) % 3
            moment = load[k + 1, i, 4]
            for c in range(3):
                turned = work.R[k + 1, j, c] * load[k + 1, m, c] - work.R[k + 1, m, c] * load[k + 1, j, c]
                moment = moment + (work.stretch[k + 1] * turned if c == 2 else turned)
            if k < n - 1:
                reach = work.length[k + 1]
                arm = work.R[k + 1, j, 2] * work.L[k + 1, m] - work.R[k + 1, m, 2] * work.L[k + 1, j]
                moment = moment + work.M[k + 1, i] + reach * arm
            work.M[k, i] = moment
        for i in range(3):
            work.L[k, i] = load[k + 1, i, 3]
            if k < n - 1:
                work.L[k, i] = work.L[k, i] + work.L[k + 1, i]
    for i in range(len(work.S)):
        k = i // 2 if i < 2 * n else i - 2 * n
        t[i] = t[i] + (work.S[i, 0] * work.M[k, 0] + work.S[i, 1] * work.M[k, 1] + work.S[i, 2] * work.M[k, 2])
    for s in range(body.share.shape[1]):
        for k in range(n + 1):
            for i in range(3):
                pull = load[k, i, 2]
                if k < n:
                    pull = pull + body.length[k] * work.L[k, i]
                t[len(work.S) + s] = t[len(work.S) + s] + body.share[k, s] * work.R[k, i, 2] * pull


def add_link_loads(x, v, ahead, load, body, joints, work):
    """Add the generalized forces [N m] of external loads on the links to work.tau (N,). The coordinates are x + ahead
    v, extrapolated by the time `ahead` [s] along the rates v.

    `add_pose_loads` describes `load`.
    """
    for i in range(len(x)):
        work.q[i] = x[i] + ahead * v[i]
    pose_links(work.q, body, work)
    add_pose_loads(load, body, work, work.tau)


def kinetic_energy(x, v, body, work):
    """Return the kinetic energy 1/2 v^T M v [J] of a chain in space, at coordinates x and rates v (N,).

    Each link contributes the motion of its centre of mass, the turn of its axis and the spin about it.
    """
    n = len(body.mass)
    pose_links(x, body, work)
    for k in range(n + 1):
        work.growth[k] = 0.0 * v[0]
    stretch_rates(v, body, work)
    value = 0.0 * x[0]
    for i in range(3):
        work.omega[i] = 0.0
        work.alpha[i] = 0.0
        work.lift[i] = body.length[0] * work.growth[0] * work.R[0, i, 2]  # the joint's velocity
    for k in range(n):
        turn_on(work.S[2 * k], v[2 * k], work)
        turn_on(work.S[2 * k + 1], v[2 * k + 1], work)
        if len(work.S) > 2 * n:
            turn_on(work.S[2 * n + k], v[2 * n + k], work)
        spin = 0.0 * v[0]
        for i in range(3):
            j = (i + 1) % 3
            m = (i + 2) % 3
            rate = work.omega[j] * work.R[k + 1, m, 2] - work.omega[m] * work.R[k + 1, j, 2]
            growth = work.growth[k + 1] * work.R[k + 1, i, 2]
            speed = work.lift[i] + work.centre[k] * rate + body.centre[k] * growth
            value = value + 0.5 * (body.mass[k] * speed * speed + work.lateral[k] * rate * rate)
            spin = spin + work.omega[i] * work.R[k + 1, i, 2]
            work.lift[i] = work.lift[i] + work.length[k + 1] * rate + body.length[k + 1] * growth
        rod = body.lateral[k] - 0.5 * body.axial[k]
        value = value + 0.5 * (body.axial[k] * spin * spin + rod * work.growth[k + 1] * work.growth[k + 1])
    return value


def gravity_energy(x, body, work):
    """Return the gravitational energy -sum m g . r [J] of a chain in space, 0 where every centre of mass is at the
    origin.
    """
    pose_links(x, body, work)
    value = 0.0 * x[0]
    for k in range(len(body.mass)):
        for i in range(3):
            p = work.r[k + 1, i] + work.centre[k] * work.R[k + 1, i, 2]
            if i == 0:
                value = value - body.mass[k] * body.gx * p
            elif i == 1:
                value = value - body.mass[k] * body.gy * p
            else:
                value = value - body.mass[k] * body.gz * p
    return value


def add_step_work(v, h, torque, joints, work, total):
    """Add the work of the inputs, and the loss in dampers and tendon friction, over one time step to total (2,) [J].

    The step is one of `spatial.step`.

    Both use the mid-step rates. `v` (N,) are the rates after the step, `work.a` still holds their change. For tendons,
    `work` is that of `tendon.step`.
    """
    for i in range(len(v)):
        rate = v[i] - 0.5 * work.a[i]
        total[0] = total[0] + h * (torque[i] + work.pull[i]) * rate
        total[1] = total[1] + h * (joints.D[i] * rate - work.rub[i]) * rate


def static_forces(x, torque, body, joints, work, forces):
    """Write the net generalized force of actuation `torque` (N,), springs and gravity on a chain at rest at x to forces
    (N,) [N m].

    It is zero in equilibrium.
    """
    for i in range(len(x)):
        work.v[i] = 0.0 * x[i]
    pose_links(x, body, work)
    joint_torques(x, work.v, joints, torque, 0.0, work.t)
    inertial_forces(x, work.v, body, work, work.f)
    for i in range(len(x)):
        forces[i] = work.t[i] - work.f[i]
