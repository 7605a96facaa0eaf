"""The loop that a fit of a chain with memory runs compiled; see `pliant.identification.follow_loops`."""

from __future__ import annotations

from pliant.equations.elastic import tangent
from pliant.equations.memory import step_with_memory
from pliant.identification.follow_loops import observe, pulled


def follow_with_memory(
    phi, w, state, base_angle, h, torque, keep, still, hand, hand_base, pull, body, joints, memory, held, work, places,
    out,
):
    """As `follow_loops.follow`, with the memory of the joints: `state` (n, branches) is set to rest at phi.

    `hand` and `hand_base` are the angles of the first rows, which `follow` calls held. Returns the index of the first
    step in which a link turns by more than a radian or the branches find no agreement, or -1.
    """
    n = len(phi)
    for row in range(still):
        observe(hand, hand_base, places, work.c, work.s, out[row])
    before = base_angle
    for i in range(n):
        for j in range(len(memory.creep_share)):
            state[i, j] = phi[i] - before - joints.theta0[i]
        before = phi[i]
    for k in range(len(h)):
        push = pulled(k, phi, w, 0.5 * h[k], torque[k], pull, joints)
        lost = step_with_memory(phi, w, base_angle, h[k], push, body, joints, memory, state, held, work)
        if not lost.real > -0.5:  # the square of an imaginary part may stand a trifle below zero
            return k
        for i in range(n):
            if not (abs((w[i] * h[k]).real) <= 1.0 and tangent(i, phi, base_angle, joints).real > 0.0):
                return k
        if keep[k] >= 0:
            observe(phi, base_angle, places, work.c, work.s, out[keep[k] - 1 + still])
    return -1
