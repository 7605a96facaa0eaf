"""Memory of the joints: creep (Prony), rate-independent friction (Maxwell-slip) and Bouc-Wen, beside Eq. (5).

Every joint i carries K_i r_i beside its spring, r_i [rad] being a sum over branches whose states are angles, the same
normalised law for all joints:

    r = sum_j creep_share_j (q - xi_j) + sum_j slip_share_j e_j + boucwen_share z

Within one step each branch is a straight line in the joint's middle angle, r = slope q_m + offset. So the step of
`motion.step` stays as it is: it sees a stiffer spring K_i (1 + slope_i) with another rest angle. What a branch gives
back and what it dissipates add up to what it takes at every step, whatever the step's length.

Comparisons look at real parts: derivatives by complex step pass through.
"""

from __future__ import annotations

from pliant.equations.motion import step

TRIALS = 60  # solves of one step before it is given up; one or two are the rule
CALM = 12  # from this trial on, half-way moves: they end a cycle between two sets of sticking branches
AGREE = 1e-12  # rad, between what the step took for r and what the branches deliver


def creep_lines(q, h, state, memory, slope, offset):
    """Slope and offset (n,) of the creep part of r over a step of h [s], whatever the turn.

    The implicit midpoint rule:  q_m - xi_m = (q_m - xi) / (1 + a),  a = h / (2 creep_time)
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
    """Slope and offset of one slip element of stretch e over a step in which its joint is thought to turn by dq.

    It sticks, r = share (e + q_m - q), where |e + dq| <= limit; else it ends there, r = share (e +- limit) / 2.
    """
    end = e + dq
    if end.real > limit.real:
        return 0.0 * share, share * 0.5 * (e + limit)
    if end.real < -limit.real:
        return 0.0 * share, share * 0.5 * (e - limit)
    return share, share * (e - q)


def friction_lines(q, dq, state, memory, slope, offset):
    """Add the slip elements and Bouc-Wen, z_m = (z + q_m - q) / (1 + x), to slope and offset (n,); see `creep_lines`.

    Exact where the turns dq (n,) lead slip elements to the same ends, and Bouc-Wen where they are the turns made.
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
    """Decay x = |dq|/2 (beta + gamma sgn(dq z_m)) |z_m|^{n-1} of z_m (1 + x) = z + dq/2; not negative.

    dz = dq - |dq| (beta + gamma sgn(dq z)) |z|^{n-1} z at the middle of the step. The right-hand side of z_m = ... is
    monotone in z_m, so that Newton's method from above finds its one root.

    Source: Bouc (1967), Wen (1976); passive where beta >= |gamma| (Erlicher and Point 2004; Ikhouane and Rodellar 2007)
    """
    goal = z + 0.5 * dq
    if goal.real < 0.0:
        return decay_along(-goal, -dq, memory)
    return decay_along(goal, dq, memory)


def decay_along(goal, turn, memory):
    """`boucwen_decay` of a size z_m (1 + x) = `goal`, not negative, and a `turn` along it."""
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
        found = (goal + (n - 1.0) * power * y) / (1.0 + n * power)
        done = (y - found).real <= 1e-15 * goal.real
        y = found
        if done:
            break
    return rate * y ** (n - 1.0)


def size(x):
    """|x|, on complex numbers that of the real part: what carries a derivative by complex step."""
    if x.real < 0.0:
        return -x
    return x


def stretched(e, dq, limit):
    """Stretch of a slip element at the end of a step that turns its joint by dq."""
    end = e + dq
    if end.real > limit.real:
        return limit
    if end.real < -limit.real:
        return -limit
    return end


def remember(q, dq, h, K, state, memory):
    """Move the states (n, branches) over a step from q by dq (n,); returns the energy that they dissipate, J.

    The rules of `creep_lines` and `friction_lines`; each term of the loss is a square or a product of equal signs, so
    never negative.
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
    """Move slip elements and Bouc-Wen as if the links turned from phi by `change` (n,) at once; creep stays.

    It leaves the joints' angles and turns in `past.held`; what that dissipates is not counted.
    """
    held = past.held
    angle = joints.base_angle
    before = 0.0 * change[0]
    for i in range(len(joints.theta0)):
        held.q[i] = phi[i] - angle - joints.theta0[i]
        held.dq[i] = change[i] - before
        angle = phi[i]
        before = change[i]
    remember(held.q, held.dq, 0.0, joints.K, past.state, past.memory)


def memory_angle(i, q, state, memory):
    """r_i [rad]: the torque of the memory of joint i at this moment, over K_i."""
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
    """Energy that the branches of joint i hold, over K_i: half the sum of share times stretch squared."""
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
    """Set the creep of all joints to rest at phi (n,)."""
    last = joints.base_angle
    for i in range(len(joints.theta0)):
        for j in range(len(past.memory.creep_share)):
            past.state[i, j] = phi[i] - last - joints.theta0[i]
        last = phi[i]


def step_with_memory(phi, w, h, torque, body, joints, past, work):
    """`motion.step` with the memory of every joint: phi, w (n,) and state (n, branches) advance in place by h [s].

    `past` (`symbols.Past`) holds the law of the memory, its state, and scratch arrays.

    Which elements slip, and Bouc-Wen's decay, depend on the turn that the step is to find. They are guessed, the
    linear step is made, and made again until what it took for r agrees with what the branches deliver.

    Returns the energy [J] that the branches dissipate, never negative; -1 where no agreement is found.

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
    """Keep the start of a step in `held`, with a first guess of the turns: every joint goes on at its rate."""
    angle = joints.base_angle
    rate = 0.0 * w[0]
    for i in range(len(phi)):
        held.phi[i] = phi[i]
        held.w[i] = w[i]
    for i in range(len(joints.theta0)):
        held.q[i] = phi[i] - angle - joints.theta0[i]
        held.dq[i] = h * (w[i] - rate)
        angle = phi[i]
        rate = w[i]


def agreement(w, h, past, work, calm):
    """Largest difference [rad] in any joint between r as the step took it and as it comes out of the turns made.

    Leaves these turns in held.dq (half-way between them and those of before, when `calm`). Not a number where the step
    failed.
    """
    held = past.held
    worst = 0.0
    rate = 0.0 * w[0]
    for i in range(len(held.theta0)):
        mean = w[i] - 0.5 * work.a[i]
        turn = h * (mean - rate)
        rate = mean
        apart = size(apart_by(i, turn, past.memory, past.state, held)).real
        if not apart <= worst:
            worst = apart
        if calm and apart > AGREE:
            turn = 0.5 * (turn + held.dq[i])
        held.dq[i] = turn
    return worst


def apart_by(i, turn, memory, state, held):
    """Difference [rad] between r of row i as the step took it and as it comes out of the `turn` made."""
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
