"""Hysteresis of the joints of a chain in space: creep, slip elements and Bouc-Wen, for swings and twists.

Every coordinate of a joint has its own states. Creep is linear, so that each coordinate follows the planar law. Slip is
one law for both coordinates of a swing: the stretch e = (e_a, e_b) of an element has the size of `swing_size`,
sqrt(e_a^2 + (K_b / K_a) e_b^2), and the element slips where this size exceeds its limit, in the direction of the pull.
With K_a = K_b the loss of a bend therefore does not depend on its direction, and with b = 0 the law is the planar one.
(Separate limits for a and b would allow sqrt(2) times the torque in a diagonal bend.) A twist follows the planar law.

A slip element of stretch e whose joint moves by dq ends at e + dq, scaled back to its limit along the same line. The
work of its torque is then its gain of energy plus a loss that is never negative. Bouc-Wen's z obeys

    dz = dq - |z|^{n-2} z (beta |z . dq| + gamma z . dq)

which is the planar law where z and dq have the same direction. |z| stays below (beta + gamma)^{-1/n}.

Source: Park, Wen and Ang (1986), Earthquake Eng. Struct. Dyn. 14, 543 (Bouc-Wen in two directions, n = 2); the slip
element as radial return, Simo and Hughes, Computational Inelasticity (1998), Sec. 3.3
"""

from __future__ import annotations

import numpy as np

from pliant.equations.memory import AGREE, CALM, TRIALS, decay_along
from pliant.equations.spatial import step
from pliant.equations.spatial_springs import NO_STIFFNESS

DIRECTION = 1e-3  # rad: weight, beside r, of a difference in the direction of slip, which is second order in r


def yielded(a, b, ratio, limit):
    """Return the factor that scales the stretch (a, b) [rad] of a slip element back to its limit, and the slip
    direction (two components).

    A sticking element has the factor 1 and the direction (0, 0).

    `ratio` is K_b / K_a.
    """
    square = a * a + ratio * b * b
    if square.real > (limit * limit).real:
        size = np.sqrt(square)
        return limit / size, a / size, b / size
    return 1.0 + 0.0 * square, 0.0 * square, 0.0 * square


def flow(a, b, da, db, ratio, memory):
    """Return the relative decay of the Bouc-Wen state (a, b) [rad] of a joint's swing over a motion (da, db) [rad].

    The planar function is `memory.boucwen_decay`.
    """
    a = a + 0.5 * da
    b = b + 0.5 * db
    square = a * a + ratio * b * b
    if square.real > 0.0:
        size = np.sqrt(square)
        return decay_along(size, (a * da + ratio * b * db) / size, memory)
    return 0.0 * square


def relax(x, joints, past):
    """Set the creep states of all joint angles to their equilibrium at the coordinates x (N,) of a chain in space."""
    for i in range(past.state.shape[0]):
        for j in range(len(past.memory.creep_share)):
            past.state[i, j] = x[i]


def follow_change(x, change, joints, past):
    """Update slip elements and Bouc-Wen states for an instantaneous change of the coordinates from
    x by `change` (N,).

    The planar function is `memory.follow_change`.
    """
    held = past.held
    for i in range(len(x)):
        held.x[i] = x[i]
    for i in range(past.state.shape[0]):
        held.dq[i] = change[i]
    remember(0.0 * x[0], joints, past)


def ratio_of(i, joints):
    """Return the stiffness ratio K_b / K_a of the two swing angles of a joint, which are the
    coordinates i and i + 1.
    """
    return joints.K[i + 1] / (joints.K[i] + NO_STIFFNESS)


def write_lines(h, joints, past):
    """Write the hysteresis torque of each of m joint coordinates, divided by its stiffness K, as a linear function of
    the mid-step coordinates to held.line (m, 3): an offset [rad] and two slopes.

    held.dq (m,) [rad] is the assumed motion over the step of h [s].

    Row i of held.line (m, 3) is: offset [rad], slope by coordinate i, slope by the other coordinate of the same swing.
    """
    m = past.state.shape[0]
    n = len(joints.unloaded)
    for i in range(m):
        write_creep_line(i, h, past)
    for i in range(0, 2 * n, 2):
        add_friction(i, i + 1, ratio_of(i, joints), past)
    for i in range(2 * n, m):
        add_friction(i, i, 0.0 * joints.K[i], past)


def write_creep_line(i, h, past):
    """Write the creep part of row i of held.line in a step of h [s]."""
    held = past.held
    memory = past.memory
    held.line[i, 0] = 0.0 * held.x[i]
    held.line[i, 1] = 0.0 * held.x[i]
    held.line[i, 2] = 0.0 * held.x[i]
    for j in range(len(memory.creep_share)):
        part = memory.creep_share[j] / (1.0 + 0.5 * h / memory.creep_time[j])
        held.line[i, 0] = held.line[i, 0] - part * past.state[i, j]
        held.line[i, 1] = held.line[i, 1] + part


def add_friction(i, k, ratio, past):
    """Add slip elements and Bouc-Wen for the two swing coordinates i and k of a joint to rows i and k of held.line. A
    row is a linear function of the mid-step coordinates: a hysteresis torque, divided by the stiffness K.

    A twist has k = i.

    These are tangents at the motion held.dq of r(dq) = share (e + end(dq)) / 2. Their slope is that of the projection
    of e + dq to the limit.
    """
    held = past.held
    memory = past.memory
    state = past.state
    P = len(memory.creep_share)
    S = len(memory.slip_share)
    other = 1.0 if k > i else 0.0
    da = held.dq[i]
    db = other * held.dq[k]
    for j in range(P, P + S):
        share = memory.slip_share[j - P]
        ea = state[i, j]
        eb = other * state[k, j]
        keeps, na, nb = yielded(ea + da, eb + db, ratio, memory.slip_angle[j - P])
        stick = keeps * (1.0 - na * na)
        across = -keeps * na * nb
        beside = keeps * (1.0 - ratio * nb * nb)
        moved = held.x[i] + 0.5 * da
        aside = other * held.x[k] + 0.5 * db
        level = 0.5 * (ea + keeps * (ea + da)) - stick * moved - ratio * across * aside
        add_line(i, share * level, share * stick, share * ratio * across, held)
        if k > i:
            level = 0.5 * (eb + keeps * (eb + db)) - across * moved - beside * aside
            add_line(k, share * level, share * beside, share * across, held)
    if memory.boucwen_share.real > 0.0:
        za = state[i, P + S]
        zb = other * state[k, P + S]
        part = memory.boucwen_share / (1.0 + flow(za, zb, da, db, ratio, memory))
        add_line(i, part * (za - held.x[i]), part, 0.0 * part, held)
        if k > i:
            add_line(k, part * (zb - held.x[k]), part, 0.0 * part, held)


def add_line(i, level, own, across, held):
    """Add an offset `level` [rad] and two slopes to row i of held.line, a linear function of the mid-step coordinates.
    `own` is the slope by coordinate i, `across` that by the other swing coordinate of the joint.
    """
    held.line[i, 0] = held.line[i, 0] + level
    held.line[i, 1] = held.line[i, 1] + own
    held.line[i, 2] = held.line[i, 2] + across


def step_with_memory(x, v, h, torque, body, joints, past, work):
    """Advance coordinates x (N,), rates v (N,) and hysteresis states in place by one step h [s], and return the energy
    [J] lost to hysteresis.

    The planar function is `memory.step_with_memory`. Which elements slip, and in which direction, depends on the
    unknown motion of the step. It is guessed, the step is made with tangents (Newton's method), and both are repeated
    until the r used by the step equals the r of the branches after it.

    The returned energy is never negative. It is -1 where this iteration does not converge.

    Paper: Eq. (5) [eq:eom], in space, with the hysteresis that the paper leaves to later work
    """
    held = past.held
    for i in range(len(x)):
        held.x[i] = x[i]
        held.v[i] = v[i]
        held.springs.theta0[i] = joints.theta0[i]
    for i in range(past.state.shape[0]):
        held.dq[i] = h * v[i]
    for trial in range(TRIALS):
        write_lines(h, joints, past)
        step(x, v, h, torque, body, held.springs, work)
        if disagreement(v, h, joints, past, work, trial >= CALM) <= AGREE:
            return remember(h, joints, past)
        for i in range(len(x)):
            x[i] = held.x[i]
            v[i] = held.v[i]
    return -1.0 + 0.0 * v[0]


def disagreement(v, h, joints, past, work, calm):
    """Return the largest error, over all joints, of the hysteresis torque that a time step assumed, divided by K [rad]:
    its difference from the torque at the joints' actual motion. Correct the assumed motion for the next iteration.

    Where an element slips, the change of its direction from the guess counts too. Writes the motion of the step to
    held.dq, or its mean with the previous one if `calm` and not yet converged. The result is NaN where the step failed.
    """
    held = past.held
    n = len(joints.unloaded)
    m = past.state.shape[0]
    worst = 0.0
    for i in range(0, 2 * n, 2):
        da = h * (v[i] - 0.5 * work.a[i])
        db = h * (v[i + 1] - 0.5 * work.a[i + 1])
        apart = gap(i, i + 1, da, db, ratio_of(i, joints), h, past)
        if not apart <= worst:
            worst = apart
    for i in range(2 * n, m):
        da = h * (v[i] - 0.5 * work.a[i])
        apart = gap(i, i, da, 0.0 * da, 0.0 * joints.K[i], h, past)
        if not apart <= worst:
            worst = apart
    half = calm and not worst <= AGREE
    for i in range(m):
        turn = h * (v[i] - 0.5 * work.a[i])
        held.dq[i] = 0.5 * (turn + held.dq[i]) if half else turn
    return worst


def gap(i, k, da, db, ratio, h, past):
    """Return the error of the hysteresis torque that a time step assumed for one joint, divided by K [rad]: its
    difference from the torque when the joint's coordinates i and k move by da and db [rad].

    `disagreement` takes the largest of these.

    A twist has k = i.
    """
    held = past.held
    memory = past.memory
    state = past.state
    P = len(memory.creep_share)
    S = len(memory.slip_share)
    other = 1.0 if k > i else 0.0
    a = held.x[i] + 0.5 * da
    b = held.x[k] + 0.5 * db
    off = held.line[i, 0] + held.line[i, 1] * a + held.line[i, 2] * b
    beside = held.line[k, 0] + held.line[k, 1] * b + held.line[k, 2] * a
    turned = 0.0
    for j in range(P):
        part = memory.creep_share[j] / (1.0 + 0.5 * h / memory.creep_time[j])
        off = off - part * (a - state[i, j])
        beside = beside - part * (b - state[k, j])
    for j in range(P, P + S):
        half = 0.5 * memory.slip_share[j - P]
        ea = state[i, j]
        eb = other * state[k, j]
        keeps, na, nb = yielded(ea + da, eb + db, ratio, memory.slip_angle[j - P])
        off = off - half * (ea + keeps * (ea + da))
        beside = beside - half * (eb + keeps * (eb + db))
        guess, ga, gb = yielded(ea + held.dq[i], eb + other * held.dq[k], ratio, memory.slip_angle[j - P])
        if keeps.real < 1.0 and guess.real < 1.0:
            turned = max(turned, abs(na.real - ga.real), abs(nb.real - gb.real))
    if memory.boucwen_share.real > 0.0:
        za = state[i, P + S]
        zb = other * state[k, P + S]
        part = memory.boucwen_share / (1.0 + flow(za, zb, da, db, ratio, memory))
        off = off - part * (za + 0.5 * da)
        beside = beside - part * (zb + 0.5 * db)
    return abs(off.real) + other * abs(beside.real) + DIRECTION * turned


def remember(h, joints, past):
    """Update the hysteresis states of m joint coordinates after a step of h [s], and return the dissipated energy [J].

    held.dq (m,) is the motion of the coordinates.

    Each term of the energy is a square or a product of equal signs, and therefore not negative.
    """
    m = past.state.shape[0]
    n = len(joints.unloaded)
    lost = 0.0 * past.held.x[0]
    for j in range(len(past.memory.creep_share)):
        for i in range(m):
            lost = lost + joints.K[i] * move_creep(i, j, h, past)
    for i in range(0, 2 * n, 2):
        lost = lost + joints.K[i] * move_friction(i, i + 1, ratio_of(i, joints), past)
    for i in range(2 * n, m):
        lost = lost + joints.K[i] * move_friction(i, i, 0.0 * joints.K[i], past)
    return lost


def move_creep(i, j, h, past):
    """Update creep branch j of coordinate i after a step of h [s], and return the dissipated energy divided by K_i."""
    held = past.held
    memory = past.memory
    ratio = 0.5 * h / memory.creep_time[j]
    left = (held.x[i] + 0.5 * held.dq[i] - past.state[i, j]) * (1.0 / (1.0 + ratio))
    moved = 2.0 * ratio * left
    past.state[i, j] = past.state[i, j] + moved
    return memory.creep_share[j] * left * moved


def move_friction(i, k, ratio, past):
    """Update slip elements and Bouc-Wen states of the joint coordinates i and k, and return the dissipated energy
    divided by K_i.
    """
    held = past.held
    memory = past.memory
    state = past.state
    P = len(memory.creep_share)
    S = len(memory.slip_share)
    other = 1.0 if k > i else 0.0
    da = held.dq[i]
    db = other * held.dq[k]
    lost = 0.0 * da
    for j in range(P, P + S):
        ea = state[i, j]
        eb = other * state[k, j]
        ua = ea + da
        ub = eb + db
        keeps, _, _ = yielded(ua, ub, ratio, memory.slip_angle[j - P])
        along = (ea + keeps * ua) * ua + ratio * (eb + keeps * ub) * ub
        lost = lost + memory.slip_share[j - P] * 0.5 * along * (1.0 - keeps)
        if k > i:
            state[k, j] = keeps * ub
        state[i, j] = keeps * ua
    if memory.boucwen_share.real > 0.0:
        za = state[i, P + S]
        zb = other * state[k, P + S]
        decay = flow(za, zb, da, db, ratio, memory)
        middle = (za + 0.5 * da) / (1.0 + decay)
        beside = (zb + 0.5 * db) / (1.0 + decay)
        lost = lost + memory.boucwen_share * 2.0 * decay * (middle * middle + ratio * beside * beside)
        if k > i:
            state[k, P + S] = 2.0 * beside - zb
        state[i, P + S] = 2.0 * middle - za
    return lost
