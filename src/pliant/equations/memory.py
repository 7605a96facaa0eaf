"""Hysteresis torques of the joints, in addition to Eq. (5): creep (Prony), rate-independent friction (Maxwell-slip) and
Bouc-Wen.

Every joint i carries the torque K_i r_i in addition to its spring. r_i [rad] is a sum over branches, whose states are
angles. The law is the same for all joints, relative to their K_i:

    r = sum_j creep_share_j (q - xi_j) + sum_j slip_share_j e_j + boucwen_share z

Within one step, r is a linear function of the joint's mid-step angle, r = slope q_m + offset. `motion.step` can
therefore be used unchanged, with a stiffer spring K_i (1 + slope_i) and another rest angle. In every step, whatever its
length, the energy that a branch takes up equals the energy that it stores, returns and dissipates.

Comparisons use real parts, so that derivatives by complex step are preserved.
"""

from __future__ import annotations

from pliant.equations.motion import step

TRIALS = 60  # solves of one step, at most; one or two are usual
CALM = 12  # from this trial on, moves are halved, which ends a cycle between two sets of sticking branches
AGREE = 1e-12  # rad, tolerance between the r that the step used and the r of the branches after it


def creep_lines(q, h, state, memory, slope, offset):
    """Write the slope (n,) and the offset (n,) [rad] of each joint's creep torque, divided by the joint's stiffness K,
    as a linear function of the joint's mid-step angle, for a step of h [s].

    r = slope q_m + offset in the mid-step angle q_m. The implicit midpoint rule gives

    q_m - xi_m = (q_m - xi) / (1 + a),  a = h / (2 creep_time)
    """
    for i in range(len(q)):
        slope[i] = 0.0 * q[i]
        offset[i] = 0.0 * q[i]
    for j in range(len(memory.creep_share)):
        part = memory.creep_share[j] / (1.0 + 0.5 * h / memory.creep_time[j])
        for i in range(len(q)):
            slope[i] = slope[i] + part
            offset[i] = offset[i] - part * state[i, j]


def friction_line(e, q, dq, share, limit):
    """Return slope and offset [rad] of a slip element's torque, divided by the joint's stiffness K, as a linear
    function of the mid-step joint angle. The joint turns from q by dq [rad] in the step.

    `e` is the stretch of the element at the start, `limit` [rad] the stretch at which it slips. The pair describes r =
    slope q_m + offset, with q_m the joint angle in mid-step.

    The element sticks, r = share (e + q_m - q), where |e + dq| <= limit. Otherwise it ends at the limit, and
    r = share (e +- limit) / 2.
    """
    end = e + dq
    if end.real > limit.real:
        return 0.0 * share, share * 0.5 * (e + limit)
    if end.real < -limit.real:
        return 0.0 * share, share * 0.5 * (e - limit)
    return share, share * (e - q)


def friction_lines(q, dq, state, memory, slope, offset):
    """Add the contributions of slip elements and Bouc-Wen to the slope (n,) and the offset (n,) [rad] of each joint's
    hysteresis torque, divided by the joint's stiffness K, as a linear function of its mid-step angle.

    `creep_lines` writes slope and offset before.

    For Bouc-Wen, z_m = (z + q_m - q) / (1 + x).

    dq (n,) [rad] are the assumed turns of the joints over the step. The result is exact for slip elements if the actual
    turns end in the same state (sticking or slipping), and for Bouc-Wen if the actual turns equal dq.
    """
    P = len(memory.creep_share)
    S = len(memory.slip_share)
    for i in range(len(q)):
        steep = slope[i]
        level = offset[i]
        for j in range(S):
            share = memory.slip_share[j]
            limit = memory.slip_angle[j]
            more, extra = friction_line(state[i, P + j], q[i], dq[i], share, limit)
            steep = steep + more
            level = level + extra
        if memory.boucwen_share.real > 0.0:
            z = state[i, P + S]
            part = memory.boucwen_share / (1.0 + boucwen_decay(z, dq[i], memory))
            steep = steep + part
            level = level + part * (z - q[i])
        slope[i] = steep
        offset[i] = level


def boucwen_decay(z, dq, memory):
    """Return the relative decay x >= 0 of the Bouc-Wen state z of one joint over a step, in which the joint turns by dq
    [rad].

    The mid-step state z_m satisfies z_m (1 + x) = z + dq/2.

    x = |dq|/2 (beta + gamma sgn(dq z_m)) |z_m|^{n-1}, for the turn dq [rad] of the joint over the step.

    This is dz = dq - |dq| (beta + gamma sgn(dq z)) |z|^{n-1} z with the right-hand side at the middle of the step. The
    equation is monotone in z_m, so that Newton's method from above finds its only root.

    Source: Bouc (1967), Wen (1976); passive where beta >= |gamma| (Erlicher and Point 2004; Ikhouane and Rodellar 2007)
    """
    goal = z + 0.5 * dq
    if goal.real < 0.0:
        return decay_along(-goal, -dq, memory)
    return decay_along(goal, dq, memory)


def decay_along(goal, turn, memory):
    """Return the relative decay of a Bouc-Wen state in a time step. `goal` [rad] >= 0 is the absolute value that the
    state would have in mid-step without decay. `turn` [rad] is the joint's turn in the direction of the state.

    `goal` = |z_m| (1 + x) and `turn` is the part of dq along z_m, with z_m and x as in `boucwen_decay`.
    """
    rate = memory.boucwen_beta
    if turn.real > 0.0 and goal.real > 0.0:
        rate = rate + memory.boucwen_gamma
    elif turn.real < 0.0 and goal.real > 0.0:
        rate = rate - memory.boucwen_gamma
    rate = 0.5 * size(turn) * rate
    n = memory.boucwen_exponent
    if n.real == 1.0:
        return rate
    if goal.real == 0.0:  # a complex zero has no power
        return 0.0 * rate
    y = goal
    for _ in range(30):
        power = rate * y ** (n - 1.0)
        solution = (goal + (n - 1.0) * power * y) / (1.0 + n * power)
        done = (y - solution).real <= 1e-15 * goal.real
        y = solution
        if done:
            break
    return rate * y ** (n - 1.0)


def size(x):
    """Return the absolute value of x, as x or -x, so that the derivative in its imaginary part
    (complex step) is kept.
    """
    if x.real < 0.0:
        return -x
    return x


def stretched(e, dq, limit):
    """Return the stretch [rad] of a slip element after its joint turned by dq [rad], limited to +-`limit` [rad]."""
    end = e + dq
    if end.real > limit.real:
        return limit
    if end.real < -limit.real:
        return -limit
    return end


def remember(q, dq, h, K, state, memory):
    """Update the hysteresis states (n, branches) [rad] of the n joints after they turn from q by dq (n,) [rad] in h
    [s], and return the dissipated energy [J].

    The rules are those of `creep_lines` and `friction_lines`. Each term of the energy is a square or a product of equal
    signs, and therefore not negative.
    """
    lost = 0.0 * q[0]
    P = len(memory.creep_share)
    S = len(memory.slip_share)
    for j in range(P):
        ratio = 0.5 * h / memory.creep_time[j]
        part = 1.0 / (1.0 + ratio)
        for i in range(len(q)):
            gap = (q[i] + 0.5 * dq[i] - state[i, j]) * part
            flow = 2.0 * ratio * gap
            lost = lost + K[i] * memory.creep_share[j] * gap * flow
            state[i, j] = state[i, j] + flow
    for j in range(S):
        limit = memory.slip_angle[j]
        for i in range(len(q)):
            e = state[i, P + j]
            end = stretched(e, dq[i], limit)
            lost = lost + K[i] * memory.slip_share[j] * 0.5 * (e + end) * (e + dq[i] - end)
            state[i, P + j] = end
    if memory.boucwen_share.real > 0.0:
        for i in range(len(q)):
            z = state[i, P + S]
            x = boucwen_decay(z, dq[i], memory)
            middle = (z + 0.5 * dq[i]) / (1.0 + x)
            lost = lost + K[i] * memory.boucwen_share * 2.0 * x * middle * middle
            state[i, P + S] = 2.0 * middle - z
    return lost


def follow_change(phi, change, joints, past):
    """Update slip elements and Bouc-Wen states of the joints for an instantaneous change of the link angles from phi by
    `change` (n,) [rad].

    Creep states do not change. `past.held` receives the joints' angles and turns. The dissipated energy is not counted.
    """
    held = past.held
    joint_turns(phi, change, 1.0, joints, held)
    remember(held.q, held.dq, 0.0, joints.K, past.state, past.memory)


def joint_turns(phi, w, h, joints, held):
    """Write the angles of the n joints [rad] to held.q, and their turns [rad] over h [s] at the rates w of the links to
    held.dq.
    """
    angle = joints.base_angle
    rate = joints.spin[0]
    for i in range(len(joints.theta0)):
        held.q[i] = phi[i] - angle - joints.theta0[i]
        held.dq[i] = h * (w[i] - rate)
        angle = phi[i]
        rate = w[i]


def memory_angle(i, q, state, memory):
    """Return the hysteresis torque of joint i divided by its stiffness K_i [rad], at the joint angle q [rad]."""
    value = 0.0 * q
    P = len(memory.creep_share)
    S = len(memory.slip_share)
    for j in range(P):
        value = value + memory.creep_share[j] * (q - state[i, j])
    for j in range(S):
        value = value + memory.slip_share[j] * state[i, P + j]
    if memory.boucwen_share.real > 0.0:
        value = value + memory.boucwen_share * state[i, P + S]
    return value


def memory_stored(i, q, state, memory):
    """Return the energy stored in the hysteresis branches of joint i, divided by its stiffness K_i [rad^2].

    It is half the sum of share times squared stretch.
    """
    value = 0.0 * q
    P = len(memory.creep_share)
    S = len(memory.slip_share)
    for j in range(P):
        value = value + 0.5 * memory.creep_share[j] * (q - state[i, j]) ** 2
    for j in range(S):
        value = value + 0.5 * memory.slip_share[j] * state[i, P + j] ** 2
    if memory.boucwen_share.real > 0.0:
        value = value + 0.5 * memory.boucwen_share * state[i, P + S] ** 2
    return value


def relax(phi, joints, past):
    """Set the creep states of all joints to their equilibrium at the absolute link angles phi (n,) [rad]."""
    last = joints.base_angle
    for i in range(len(joints.theta0)):
        for j in range(len(past.memory.creep_share)):
            past.state[i, j] = phi[i] - last - joints.theta0[i]
        last = phi[i]


def step_with_memory(phi, w, h, torque, body, joints, past, work):
    """Advance link angles phi (n,), rates w (n,) and hysteresis states in place by one step h [s], and return the
    energy [J] lost to hysteresis.

    `past` (`symbols.Past`) holds the hysteresis law, its states (n, branches), and scratch arrays. `torque` (n,) [N m]
    is the mean actuation torque of each joint.

    Which elements slip, and the decay of Bouc-Wen, depend on the unknown turn of the step. They are guessed,
    `motion.step` is made, and both are repeated until the r used by the step equals the r of the branches after it.

    The returned energy is never negative. It is -1 where this iteration does not converge.

    Paper: Eq. (5) [eq:eom], with the hysteresis that the paper leaves to later work
    """
    n = len(joints.theta0)
    memory = past.memory
    state = past.state
    held = past.held
    hold_start(phi, w, h, joints, held)
    creep_lines(held.q, h, state, memory, held.creep_slope, held.creep_offset)
    for trial in range(TRIALS):
        for i in range(n):
            held.slope[i] = held.creep_slope[i]
            held.offset[i] = held.creep_offset[i]
        friction_lines(held.q, held.dq, state, memory, held.slope, held.offset)
        for i in range(n):
            held.K[i] = joints.K[i] * (1.0 + held.slope[i])
            held.theta0[i] = joints.theta0[i] - held.offset[i] / (1.0 + held.slope[i])
        step(phi, w, h, torque, body, held.springs, work)
        if agreement(w, h, past, work, trial >= CALM) <= AGREE:
            return remember(held.q, held.dq, h, joints.K, state, memory)
        for i in range(len(phi)):
            phi[i] = held.phi[i]
            w[i] = held.w[i]
    return -1.0 + 0.0 * w[0]


def hold_start(phi, w, h, joints, held):
    """Copy the state at the start of a time step to `held`, and estimate each joint's turn over the step from its
    present rate.
    """
    for i in range(len(phi)):
        held.phi[i] = phi[i]
        held.w[i] = w[i]
    joint_turns(phi, w, h, joints, held)


def agreement(w, h, past, work, calm):
    """Return the largest error, over all joints, of the hysteresis torque that a time step assumed, divided by K [rad]:
    its difference from the torque at the joints' actual turns. Correct the assumed turns for the next iteration.

    `update_turn` replaces the turns. The result is NaN where the step failed.
    """
    worst = 0.0
    rate = past.held.springs.spin[0]
    for i in range(len(past.held.theta0)):
        mean = w[i] - 0.5 * work.a[i]
        apart = update_turn(i, h * (mean - rate), past.memory, past, calm)
        rate = mean
        if not apart <= worst:
            worst = apart
    return worst


def update_turn(i, turn, law, past, calm):
    """Write the turn of joint i in a time step to held.dq[i]. Return the difference between the joint's hysteresis
    torque at this turn and the torque that the step assumed, divided by K [rad]. If they differ and `calm` is true,
    write the mean of the given and the assumed turn instead.

    The difference is that between the step's assumption and the `law` at this turn. For a segment, the turn is the
    change of its strain.
    """
    held = past.held
    apart = size(apart_by(i, turn, law, past.state, held)).real
    if calm and apart > AGREE:
        turn = 0.5 * (turn + held.dq[i])
    held.dq[i] = turn
    return apart


def apart_by(i, turn, memory, state, held):
    """Return the difference between two hysteresis torques of joint i, divided by the stiffness K [rad]: the torque
    that a time step assumed minus that at the joint's actual `turn` [rad] in the step.
    """
    P = len(memory.creep_share)
    S = len(memory.slip_share)
    middle = held.q[i] + 0.5 * turn
    apart = (held.slope[i] - held.creep_slope[i]) * middle + (held.offset[i] - held.creep_offset[i])
    for j in range(S):
        e = state[i, P + j]
        limit = memory.slip_angle[j]
        apart = apart - 0.5 * memory.slip_share[j] * (e + stretched(e, turn, limit))
    if memory.boucwen_share.real > 0.0:
        z = state[i, P + S]
        apart = apart - memory.boucwen_share * (z + 0.5 * turn) / (1.0 + boucwen_decay(z, turn, memory))
    return apart
