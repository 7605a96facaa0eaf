"""Hysteresis of segments that lengthen, beside that of the joints: the branches of `memory` on each axial strain.

Segment s carries EA r_s beside its spring, r_s being the sum of `memory` over creep branches and slip elements whose
states are strains. The branches are those of `memory`, called on the rows of the strains with their own shares: within
a step each is a straight line in the middle strain, so that the step of `extension` sees a stiffer axial spring with
another rest strain. What the branches dissipate is never negative, whatever the step's length.
"""

from __future__ import annotations

from pliant.equations.extension import step
from pliant.equations.memory import (
    AGREE,
    CALM,
    TRIALS,
    agreement,
    creep_lines,
    friction_lines,
    hold_start,
    relax,
    remember,
    update_turn,
)
from pliant.equations.symbols import MemoryLaw


def relax_all(x, joints, past):
    """Set the creep of all joints and segments to rest at x (n + S,)."""
    n = len(joints.theta0)
    relax(x, joints, past)
    for i in range(n, len(x)):
        for j in range(len(past.memory.axial_creep_share)):
            past.state[i, j] = x[i]


def move_states(h, joints, axial, past):
    """Move the states of joints and segments, whose law is `axial`, by held.dq (N,) over h [s].

    Returns the energy that is dissipated, J.
    """
    n = len(joints.theta0)
    held = past.held
    state = past.state
    lost = remember(held.q[:n], held.dq[:n], h, joints.K[:n], state[:n], past.memory)
    return lost + remember(held.q[n:], held.dq[n:], h, joints.K[n:], state[n:], axial)


def follow_all(x, change, joints, past):
    """As `memory.follow_change`, of joints and segments: creep stays, slip elements follow a sudden change (n + S,)."""
    held = past.held
    angle = joints.base_angle
    before = 0.0 * change[0]
    for i in range(len(x)):
        held.q[i] = x[i]
        held.dq[i] = change[i]
        if i < len(joints.theta0):
            held.q[i] = x[i] - angle - joints.theta0[i]
            held.dq[i] = change[i] - before
            angle = x[i]
            before = change[i]
    law = past.memory
    axial = MemoryLaw(
        law.axial_creep_share, law.axial_creep_time, law.axial_slip_share, law.axial_slip_strain,
        0.0 * law.boucwen_share, law.boucwen_beta, law.boucwen_gamma, law.boucwen_exponent,
    )
    move_states(0.0 * change[0], joints, axial, past)


def step_with_axial_memory(x, v, h, torque, body, joints, past, work):
    """`extension.step` with hysteresis of joints and segments: x, v (N,) and state (N, branches) advance by h [s].

    As `memory.step_with_memory`, whose `past` has an `AxialMemoryLaw`, N rows of states and an `ExtensibleHeld`.

    Returns the energy [J] that the branches dissipate, never negative; -1 where no agreement is found.

    Paper: Eq. (5) [eq:eom], of a body that lengthens, with the hysteresis that the paper leaves to later work
    """
    n = len(joints.theta0)
    law = past.memory
    axial = MemoryLaw(
        law.axial_creep_share, law.axial_creep_time, law.axial_slip_share, law.axial_slip_strain,
        0.0 * law.boucwen_share, law.boucwen_beta, law.boucwen_gamma, law.boucwen_exponent,
    )
    state = past.state
    held = past.held
    hold_start(x, v, h, joints, held)
    for i in range(n, len(x)):
        held.q[i] = x[i]
        held.dq[i] = h * v[i]
    creep_lines(held.q[:n], h, state[:n], law, held.creep_slope[:n], held.creep_offset[:n])
    creep_lines(held.q[n:], h, state[n:], axial, held.creep_slope[n:], held.creep_offset[n:])
    for trial in range(TRIALS):
        for i in range(len(x)):
            held.slope[i] = held.creep_slope[i]
            held.offset[i] = held.creep_offset[i]
        friction_lines(held.q[:n], held.dq[:n], state[:n], law, held.slope[:n], held.offset[:n])
        friction_lines(held.q[n:], held.dq[n:], state[n:], axial, held.slope[n:], held.offset[n:])
        for i in range(len(x)):
            held.K[i] = joints.K[i] * (1.0 + held.slope[i])
            shift = held.offset[i] / (1.0 + held.slope[i])
            if i < n:
                held.theta0[i] = joints.theta0[i] - shift
            else:
                held.rest[i - n] = -shift
        step(x, v, h, torque, body, held.springs, work)
        turns = agreement(v, h, past, work, trial >= CALM)
        strains = axial_agreement(v, h, axial, past, work, trial >= CALM)
        if turns <= AGREE and strains <= AGREE:
            return move_states(h, joints, axial, past)
        for i in range(len(x)):
            x[i] = held.phi[i]
            v[i] = held.w[i]
    return -1.0 + 0.0 * v[0]


def axial_agreement(v, h, axial, past, work, calm):
    """As `memory.agreement`, of the segments with their law `axial`: the largest difference in any strain."""
    worst = 0.0
    for i in range(len(past.held.theta0), len(past.held.q)):
        apart = update_turn(i, h * (v[i] - 0.5 * work.a[i]), axial, past, calm)
        if not apart <= worst:
            worst = apart
    return worst
