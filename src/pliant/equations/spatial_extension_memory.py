"""Hysteresis of a chain in space whose segments lengthen: creep and dry friction of each segment's strain, in addition
to the hysteresis of the joints.

The coordinates x (N,) are T joint angles, then S strains, and each has hysteresis states. A strain follows the law of
`spatial_memory` for a twist, with shares, times and limits of its own: within a step its force, divided by EA, is a
linear function of the mid-step strain, a further row of `joints.line`. The force adds to that of the axial spring,
which may soften or stiffen. What the branches dissipate is never negative, whatever the step's length.

In the plane the module is `extension_memory`.
"""

from __future__ import annotations

from pliant.equations.memory import AGREE, CALM, TRIALS
from pliant.equations.spatial import step
from pliant.equations.spatial_memory import (
    add_friction,
    disagreement,
    gap,
    move_creep,
    move_friction,
    relax,
    remember,
    write_creep_line,
    write_lines,
)
from pliant.equations.symbols import MemoryLaw, Past


def angles_before(joints):
    """Return the number of joint angles, which is the index of the first strain."""
    return joints.hardening.shape[1] - joints.tied.shape[1]


def relax_all(x, joints, past):
    """Set the creep states of all joint angles and strains to their equilibrium at the coordinates x (N,)."""
    turns = angles_before(joints)
    relax(x, joints, Past(past.memory, past.state[:turns], past.held))
    for i in range(turns, len(x)):
        for j in range(len(past.memory.axial_creep_share)):
            past.state[i, j] = x[i]


def follow_all(x, change, joints, past):
    """Update slip elements of joints and segments, and Bouc-Wen states of the joints, for an instantaneous change of
    the coordinates from x by `change` (N,).

    Creep states do not change. `spatial_memory.follow_change` is the function for the joints alone.
    """
    held = past.held
    law = past.memory
    axial = MemoryLaw(
        law.axial_creep_share, law.axial_creep_time, law.axial_slip_share, law.axial_slip_strain,
        0.0 * law.boucwen_share, law.boucwen_beta, law.boucwen_gamma, law.boucwen_exponent,
    )
    for i in range(len(x)):
        held.x[i] = x[i]
        held.dq[i] = change[i]
    remember(0.0 * x[0], joints, Past(law, past.state[: angles_before(joints)], held))
    remember_strains(0.0 * x[0], joints, Past(axial, past.state, held))


def step_with_axial_memory(x, v, h, torque, body, joints, past, work):
    """Advance coordinates x (N,), rates v (N,) and the hysteresis states of joints and segments in place by one step h
    [s], and return the energy [J] lost to hysteresis.

    `past` (`symbols.Past`) holds an `AxialMemoryLaw`, the states (N, branches) and a `SpatialHeld`. The step is
    `spatial.step`, iterated as in `spatial_memory.step_with_memory`.

    The returned energy is never negative. It is -1 where this iteration does not converge.

    Paper: Eq. (5) [eq:eom], in space, of a body that lengthens, with the hysteresis that the paper leaves to later work
    """
    held = past.held
    law = past.memory
    axial = MemoryLaw(
        law.axial_creep_share, law.axial_creep_time, law.axial_slip_share, law.axial_slip_strain,
        0.0 * law.boucwen_share, law.boucwen_beta, law.boucwen_gamma, law.boucwen_exponent,
    )
    turned = Past(law, past.state[: angles_before(joints)], held)
    stretched = Past(axial, past.state, held)
    for i in range(len(x)):
        held.x[i] = x[i]
        held.v[i] = v[i]
        held.dq[i] = h * v[i]
        held.springs.theta0[i] = joints.theta0[i]
    for trial in range(TRIALS):
        write_lines(h, joints, turned)
        write_strain_lines(h, joints, stretched)
        step(x, v, h, torque, body, held.springs, work)
        turns = disagreement(v, h, joints, turned, work, trial >= CALM)
        strains = strain_disagreement(v, h, joints, stretched, work, trial >= CALM)
        if turns <= AGREE and strains <= AGREE:
            return remember(h, joints, turned) + remember_strains(h, joints, stretched)
        for i in range(len(x)):
            x[i] = held.x[i]
            v[i] = held.v[i]
    return -1.0 + 0.0 * v[0]


def write_strain_lines(h, joints, past):
    """Write the hysteresis force of each strain over a step of h [s], divided by EA, as a linear function of the
    mid-step strain to the last S rows of held.line (N, 3).

    The law in `past` is that of the segments. `spatial_memory.write_lines` is the function for the joints.
    """
    for i in range(angles_before(joints), past.state.shape[0]):
        write_creep_line(i, h, past)
        add_friction(i, i, 0.0 * joints.K[i], past)


def strain_disagreement(v, h, joints, past, work, calm):
    """Return the largest error, over all segments, of the hysteresis force that a time step assumed, divided by EA (a
    strain). Correct the assumed changes of the strains in held.dq for the next iteration.

    The law in `past` is that of the segments. `spatial_memory.disagreement` is the function for the joints.
    """
    held = past.held
    first = angles_before(joints)
    worst = 0.0
    for i in range(first, past.state.shape[0]):
        change = h * (v[i] - 0.5 * work.a[i])
        apart = gap(i, i, change, 0.0 * change, 0.0 * joints.K[i], h, past)
        if not apart <= worst:
            worst = apart
    half = calm and not worst <= AGREE
    for i in range(first, past.state.shape[0]):
        change = h * (v[i] - 0.5 * work.a[i])
        held.dq[i] = 0.5 * (change + held.dq[i]) if half else change
    return worst


def remember_strains(h, joints, past):
    """Update the hysteresis states of the S strains after a step of h [s], in which they change by held.dq, and return
    the dissipated energy [J].

    The law in `past` is that of the segments. `spatial_memory.remember` is the function for the joints.
    """
    lost = 0.0 * past.held.x[0]
    for i in range(angles_before(joints), past.state.shape[0]):
        for j in range(len(past.memory.creep_share)):
            lost = lost + joints.K[i] * move_creep(i, j, h, past)
        lost = lost + joints.K[i] * move_friction(i, i, 0.0 * joints.K[i], past)
    return lost
