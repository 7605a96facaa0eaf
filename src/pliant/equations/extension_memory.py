"""Hysteresis of a planar chain whose segments lengthen: creep and dry friction of each segment's strain, in addition to
the hysteresis of the joints.

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
    joint_turns,
    relax,
    remember,
    update_turn,
)
from pliant.equations.symbols import MemoryLaw


def relax_all(x, joints, past):
    """Set the creep states of all joints and segments to their equilibrium at the coordinates x (n + S,): n link angles
    [rad], then S strains.
    """
    n = len(joints.theta0)
    relax(x, joints, past)
    for i in range(n, len(x)):
        for j in range(len(past.memory.axial_creep_share)):
            past.state[i, j] = x[i]


def move_states(h, joints, axial, past):
    """Update the hysteresis states of joints and segments after their coordinates change by held.dq (N,) in h [s], and
    return the dissipated energy [J]. `axial` is the hysteresis law of the segments.
    """
    n = len(joints.theta0)
    held = past.held
    state = past.state
    lost = remember(held.q[:n], held.dq[:n], h, joints.K[:n], state[:n], past.memory)
    return lost + remember(held.q[n:], held.dq[n:], h, joints.K[n:], state[n:], axial)


def follow_all(x, change, joints, past):
    """Update slip elements of joints and segments, and Bouc-Wen states of the joints, for an instantaneous change of
    the coordinates from x by `change` (n + S,): n link angles [rad], then S strains.

    Creep states do not change. `memory.follow_change` is the function for the joints alone.
    """
    joint_turns(x, change, 1.0, joints, past.held)
    strain_changes(x, change, 1.0, joints, past.held)
    law = past.memory
    axial = MemoryLaw(
        law.axial_creep_share, law.axial_creep_time, law.axial_slip_share, law.axial_slip_strain,
        0.0 * law.boucwen_share, law.boucwen_beta, law.boucwen_gamma, law.boucwen_exponent,
    )
    move_states(0.0 * change[0], joints, axial, past)


def step_with_axial_memory(x, v, h, torque, body, joints, past, work):
    """Advance coordinates x (N,), rates v (N,) and the hysteresis states of joints and segments in place by one step h
    [s], and return the energy [J] lost to hysteresis.

    `past` (`symbols.Past`) holds an `AxialMemoryLaw`, the states (N, branches) and an `ExtensibleHeld`. The step is
    `extension.step`, iterated as in `memory.step_with_memory`.

    The returned energy is never negative. It is -1 where this iteration does not converge.

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
    strain_changes(x, v, h, joints, held)
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


def strain_changes(x, v, h, joints, held):
    """Write the S strains to the last entries of held.q (n + S,), and their changes over h [s] at the rates v (n + S,)
    to those of held.dq.
    """
    for i in range(len(joints.theta0), len(x)):
        held.q[i] = x[i]
        held.dq[i] = h * v[i]


def axial_agreement(v, h, axial, past, work, calm):
    """Return the largest error, over all segments, of the hysteresis force that a time step assumed, divided by EA (a
    strain): its difference from the force at the segments' actual strain changes. Correct the assumed changes for the
    next iteration.

    `memory.agreement` is the function for the joints.
    """
    worst = 0.0
    for i in range(len(past.held.theta0), len(past.held.q)):
        apart = update_turn(i, h * (v[i] - 0.5 * work.a[i]), axial, past, calm)
        if not apart <= worst:
            worst = apart
    return worst
