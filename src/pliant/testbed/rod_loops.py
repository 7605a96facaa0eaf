"""Forces on the nodes of the virtual actuator, a planar discrete elastic rod. Its coordinates are x and y of the nodes,
and its time steps are implicit.

The nodes ``x_0 .. x_{V-1}`` lie in the plane; ``x_0`` is clamped with the tangent +y. Edge ``e`` joins ``x_e`` and
``x_{e+1}`` and has the direction ``theta_e``. Vertex ``k`` bends by ``psi_k = theta_k - theta_{k-1}``, which is the
curvature ``psi_k / weight_k``. The vertices at the clamp and at the cap carry half an element.

``load`` holds the pressure of every chamber (C), a force (2) on the pushed node and a couple on the last edge.
``clock`` is a `stepping.StepClock`: with the second-order backward difference ``h = 2/3 dt``, ``v = (x - x_s)
/ h`` and ``a = (v - v_s) / h``, where ``y_s = (4 y_n - y_{n-1}) / 3``. All dissipation (Kelvin-Voigt, Prony, slip,
friction) is the derivative of a convex term of one incremental potential, so that its Hessian is symmetric.
"""

from __future__ import annotations

import numpy as np

SOFT = 2e-4  # m, depth over which an obstacle's resistance sets in


def section_law(bend, stiffness, height, share, locking):
    """Return moment [N m], tangent stiffness [N m2] and energy per length [J/m] of a cross-section whose curvature has
    changed by `bend` [1/m].

    The fibres at `height` above the inextensible base stretch by lam = 1 + bend height at fixed width: W = (lam^2 +
    lam^-2 - 2) / 2, or Gent's form with locking when `locking` > 0. With an empty `height` the law is linear.
    """
    if height.size == 0:
        return stiffness * bend, stiffness, 0.5 * stiffness * bend * bend
    moment = slope = energy = 0.0
    for j in range(height.size):
        lam = 1.0 + bend * height[j]
        if lam <= 0.0:
            return np.nan, np.nan, np.nan
        square = 1.0 / (lam * lam)
        invariant = lam * lam + square - 2.0
        first = lam - square / lam
        second = 1.0 + 3.0 * square * square
        work = 0.5 * invariant
        if locking > 0.0:
            left = 1.0 - locking * invariant
            if left <= 0.0:
                return np.nan, np.nan, np.nan
            second = second / left + 2.0 * locking * (first / left) ** 2
            first = first / left
            work = -0.5 * np.log(left) / locking
        moment += share[j] * height[j] * first
        slope += share[j] * height[j] * height[j] * second
        energy += share[j] * work
    return stiffness * moment, stiffness * slope, stiffness * energy


def memory_moment(k, bend, body, state, clock):
    """Return moment [N m] and tangent stiffness [N m2] of the viscoelastic and the friction elements of vertex `k` at
    the end of the time step.
    """
    moment = slope = 0.0
    before = state.curvature[k] - body.rest_curvature[k]
    for j in range(body.prony_share.size):
        spring = body.prony_share[j] * body.stiffness[k]
        inner = clock.decay[j, 0] * state.prony[k, j] + clock.decay[j, 1] * before + clock.decay[j, 2] * bend
        moment += spring * (bend - inner)
        slope += spring * (1.0 - clock.decay[j, 2])
    change = bend - before
    for j in range(body.slip_limit.shape[1]):
        spring, limit = body.slip_stiffness[k, j], body.slip_limit[k, j]
        trial = state.slip[k, j] + spring * change
        if trial > limit:
            moment += limit
        elif trial < -limit:
            moment -= limit
        else:
            moment += trial
            slope += spring
    return moment, slope


def turning(x, k):
    """Return the bending angle [rad] at vertex `k`, and derivatives [rad/m] of the directions of the edges before and
    after the vertex, each with respect to the x and y components of the edge itself.
    """
    bx, by = x[k + 1, 0] - x[k, 0], x[k + 1, 1] - x[k, 1]
    ax, ay = 0.0, 1.0
    if k > 0:
        ax, ay = x[k, 0] - x[k - 1, 0], x[k, 1] - x[k - 1, 1]
    a2, b2 = ax * ax + ay * ay, bx * bx + by * by
    return np.arctan2(ax * by - ay * bx, ax * bx + ay * by), -ay / a2, ax / a2, -by / b2, bx / b2


def curvatures(x, body, out):
    """Write the curvature [1/m] of every bending vertex to `out`."""
    for k in range(out.size):
        out[k] = turning(x, k)[0] / body.weight[k]


def volume(c, kappa, length, body):
    """Return by how much the volume [m3] of chamber `c` exceeds its volume in the straight, unstretched shape.

    The gain contributes through the curvature `kappa`, the thrust through the edge lengths `length`.
    """
    total = 0.0
    for k in range(kappa.size):
        total += body.gain[c, k] * body.weight[k] * (kappa[k] + 0.5 * body.gain_slope[c] * kappa[k] * kappa[k])
    for e in range(length.size):
        total += body.thrust[c, e] * (length[e] - body.rest_length[e])
    return total


def pressed(k, kappa, load, body):
    """Return the bending moment [N m] that the pressures of all chambers cause at vertex `k`, and its derivative [N m2]
    with respect to the curvature.
    """
    moment = slope = 0.0
    for c in range(body.gain.shape[0]):
        push = load[c] * body.gain[c, k]
        moment += push * (1.0 + body.gain_slope[c] * kappa)
        slope += push * body.gain_slope[c]
    return moment, slope


def add_bending(x, load, body, state, clock, band, torque, g):
    """Add the bending stiffness of all vertices to the banded Hessian `band`, and write the net couple [N m] on each
    edge to `torque`.
    """
    for e in range(torque.size):
        torque[e] = 0.0
    for k in range(body.weight.size):
        psi, ax, ay, bx, by = turning(x, k)
        kappa = psi / body.weight[k]
        bend = kappa - body.rest_curvature[k]
        moment, slope, _ = section_law(bend, body.stiffness[k], body.fibre_height, body.fibre_share, body.locking)
        more, more_slope = memory_moment(k, bend, body, state, clock)
        viscous = body.loss_time * body.stiffness[k] / clock.h
        back = (4.0 * state.curvature[k] - state.curvature_before[k]) / 3.0
        moment += more + viscous * (kappa - back)
        push, push_slope = pressed(k, kappa, load, body)
        moment -= push
        slope += more_slope + viscous - push_slope
        torque[k] += moment
        if k > 0:
            torque[k - 1] -= moment
        g[0], g[1], g[2], g[3], g[4], g[5] = ax, ay, -ax - bx, -ay - by, bx, by
        first = 2 * (k - 2)
        for i in range(max(0, -first), 6):
            for j in range(max(0, -first), i + 1):
                band[first + i, i - j] += slope / body.weight[k] * g[i] * g[j]
    torque[torque.size - 1] -= load[load.size - 1]


def scatter_edge(e, fx, fy, kxx, kxy, kyy, gradient, band):
    """Add the contribution of edge `e` to the first and second derivatives of the potential: (fx, fy) [N] at its far
    node and the opposite at its near node to `gradient`, and its stiffness kxx, kxy, kyy [N/m] to `band`.
    """
    i = 2 * e
    gradient[i] += fx
    gradient[i + 1] += fy
    band[i, 0] += kxx
    band[i + 1, 0] += kyy
    band[i + 1, 1] += kxy
    if e > 0:
        gradient[i - 2] -= fx
        gradient[i - 1] -= fy
        band[i - 2, 0] += kxx
        band[i - 1, 0] += kyy
        band[i - 1, 1] += kxy
        band[i, 2] -= kxx
        band[i, 1] -= kxy
        band[i + 1, 3] -= kxy
        band[i + 1, 2] -= kyy


def add_edges(x, body, state, clock, torque, geometric, gradient, band):
    """Add the effect of each edge's tension and of the couple `torque` [N m] on it to the first and second derivatives
    of the potential, `gradient` and `band`. With `geometric` = 0, terms of `band` that may be indefinite are omitted.
    """
    for e in range(body.rest_length.size):
        dx, dy = x[e + 1, 0] - x[e, 0], x[e + 1, 1] - x[e, 1]
        l2 = dx * dx + dy * dy
        length = np.sqrt(l2)
        tx, ty = dx / length, dy / length
        stiff = body.axial[e] / body.rest_length[e]
        back = (4.0 * state.length[e] - state.length_before[e]) / 3.0
        viscous = body.loss_time * stiff / clock.h
        tension = stiff * (length - body.rest_length[e]) + viscous * (length - back)
        c = torque[e]
        fx, fy = tension * tx - c * dy / l2, tension * ty + c * dx / l2
        stiff += viscous
        side = geometric * tension / length
        c *= geometric / (l2 * l2)
        kxx = stiff * tx * tx + side * ty * ty + 2.0 * c * dx * dy
        kyy = stiff * ty * ty + side * tx * tx - 2.0 * c * dx * dy
        kxy = (stiff - side) * tx * ty + c * (dy * dy - dx * dx)
        scatter_edge(e, fx, fy, kxx, kxy, kyy, gradient, band)


def add_thrust(x, load, body, geometric, gradient, band):
    """Add the effect of the chambers' axial thrust on all edges to the first and second derivatives of the potential,
    `gradient` and `band`. With `geometric` = 0, terms of `band` that may be indefinite are omitted.
    """
    for e in range(body.rest_length.size):
        push = 0.0
        for c in range(body.thrust.shape[0]):
            push += load[c] * body.thrust[c, e]
        if push == 0.0:
            continue
        dx, dy = x[e + 1, 0] - x[e, 0], x[e + 1, 1] - x[e, 1]
        length = np.sqrt(dx * dx + dy * dy)
        tx, ty = dx / length, dy / length
        side = -geometric * push / length
        scatter_edge(e, -push * tx, -push * ty, side * ty * ty, -side * tx * ty, side * tx * tx, gradient, band)


def add_inertia(x, load, body, guess, clock, gradient, band):
    """Add the inertia of the nodes, due to their distance from the predicted positions `guess`, to the first and second
    derivatives of the potential, `gradient` and `band`. Add gravity and the load's force on the pushed node to
    `gradient`.
    """
    last = x.shape[0] - 1
    for v in range(1, last + 1):
        i = 2 * (v - 1)
        for a in range(2):
            pull = clock.per_h2 * body.mass[v] * (x[v, a] - guess[v, a]) - body.mass[v] * body.gravity[a]
            gradient[i + a] += pull
            band[i + a, 0] += clock.per_h2 * body.mass[v]
    first = 2 * (last - 2)
    for i in range(4):
        for j in range(4):
            drift = x[last - 1 + j // 2, j % 2] - guess[last - 1 + j // 2, j % 2]
            gradient[first + i] += clock.per_h2 * body.cap_mass[i, j] * drift
            if j <= i:
                band[first + i, i - j] += clock.per_h2 * body.cap_mass[i, j]
        gradient[first + i] -= body.cap_weight[i]
    gradient[2 * body.pushed - 2] -= load[load.size - 3]
    gradient[2 * body.pushed - 1] -= load[load.size - 2]


def gap_to(row, px, py):
    """Return the distance [m] of a point from an obstacle's surface, the outward normal (x, y), and the curvature [1/m]
    of the parallel surface through the point.
    """
    if row[0] == 0.0:
        dx, dy = px - row[1], py - row[2]
        far = np.sqrt(dx * dx + dy * dy)
        return far - row[3], dx / far, dy / far, 1.0 / far
    return row[1] * px + row[2] * py - row[3], row[1], row[2], 0.0


def penalty(depth):
    """Return the contact force, its derivative with respect to the penetration, and the stored energy at a penetration
    `depth` [m], all for a contact stiffness of 1.

    The force is quadratic up to the depth `SOFT` and linear beyond.
    """
    if depth <= 0.0:
        return 0.0, 0.0, 0.0
    if depth < SOFT:
        return depth * depth / (2.0 * SOFT), depth / SOFT, depth**3 / (6.0 * SOFT)
    return depth - 0.5 * SOFT, 1.0, 0.5 * depth * depth - 0.5 * SOFT * depth + SOFT * SOFT / 6.0


def friction(row, grip, nx, ny, x, v, state, clock):
    """Return the tangential friction force [N] on node `v`, and the tangential stiffness [N/m] that it adds. It is
    regularised Coulomb friction with the normal force of the last step.
    """
    tx, ty = -ny, nx
    vt = (x[v, 0] - (4.0 * state.x[v, 0] - state.x_before[v, 0]) / 3.0) * tx
    vt = (vt + (x[v, 1] - (4.0 * state.x[v, 1] - state.x_before[v, 1]) / 3.0) * ty) / clock.h
    speed = np.sqrt(vt * vt + row[6] * row[6])
    return -grip * vt / speed, grip * row[6] * row[6] / (speed**3 * clock.h)


def add_contact(x, obstacles, body, state, clock, gradient, band, force):
    """Add contact and friction between all nodes and obstacles to `gradient` and `band`, and write the forces [N] on
    the nodes to `force`.
    """
    for v in range(force.shape[0]):
        force[v, 0] = force[v, 1] = 0.0
    for o in range(obstacles.shape[0]):
        row = obstacles[o]
        for v in range(1, x.shape[0]):
            gap, nx, ny, bent = gap_to(row, x[v, 0], x[v, 1])
            push, k, _ = penalty(body.half_width - gap)
            share = row[4] * body.contact_share[v]
            if push == 0.0 or share == 0.0:
                continue
            push, k = share * push, share * k
            was, mx, my, _ = gap_to(row, state.x[v, 0], state.x[v, 1])
            grip = row[5] * share * penalty(body.half_width - was)[0]
            rub, drag = friction(row, grip, mx, my, x, v, state, clock)
            side = -push * bent
            fx, fy = push * nx - rub * my, push * ny + rub * mx
            i = 2 * (v - 1)
            band[i, 0] += k * nx * nx + side * ny * ny + drag * my * my
            band[i + 1, 0] += k * ny * ny + side * nx * nx + drag * mx * mx
            band[i + 1, 1] += (k - side) * nx * ny - drag * mx * my
            force[v, 0] += fx
            force[v, 1] += fy
            gradient[i] -= fx
            gradient[i + 1] -= fy
