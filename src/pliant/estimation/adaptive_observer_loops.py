"""Compiled loop of the adaptive observer for one frame: prediction, torque factor, correction and rest-angle shifts.

Paper: Eq. (5) [eq:eom] for the model; the rest is estimation and not of the paper.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.chamber import held_torques
from pliant.equations.elastic import tangent
from pliant.equations.laws import law_torque
from pliant.equations.memory import memory_angle, step_with_memory
from pliant.equations.symbols import ActuationConstants, Body, Held, Joints, MemoryLaw, Past, Workspace
from pliant.estimation.symbols import (
    FOLLOWED,
    FRAME_LOST,
    PARTED,
    STEP_FAILED,
    ObserverGains,
    ObserverModel,
    ObserverState,
    ObserverWorkspace,
    Pace,
)


def follow(periods, pressure, values, state, model, gains, pace, workspace):
    """Advance the observer by `periods` frame periods under the pressures (C,) [Pa] of C chambers, and correct it by n
    measured link angles [rad].

    `values` are the angles of the links, each relative to the link before [rad], NaN if the frame is lost. Returns
    FOLLOWED, FRAME_LOST, PARTED (an innovation exceeds `pace.largest`) or STEP_FAILED (an integration step failed).
    """
    failed = False
    if periods > 0:
        learn_ahead(state, gains, periods, pressure, model.chambers, workspace.weight)
        failed = ahead(state, pressure, model, periods * pace.parts, pace.h, workspace)
    outcome = FOLLOWED
    if lost(values):
        outcome = FRAME_LOST
    else:
        total = 0.0
        for i in range(len(values)):
            total = total + values[i]
            state.innovation[i] = total - state.angle[i]
        correct_all(state, gains, workspace.weight, workspace.move)
        for i in range(len(values)):
            if not abs(state.innovation[i]) < pace.largest:
                outcome = PARTED
    rest_shift(
        state.angle, state.own_shift, state.memory, model.joints.base_angle, model.joints.theta0, model.memory,
        model.instantaneous, state.rest_shift,
    )
    return STEP_FAILED if failed else outcome


def follow_of_tuples(periods, pressure, values, records):
    """Advance and correct the observer for one frame, like `follow`, but with plain tuples as arguments. Python passes
    these to compiled code three times as fast as named tuples.
    """
    state, model, gains, pace, workspace = records
    joints, body, chambers, memory, instantaneous = model
    chain = ObserverModel(
        Joints(*joints), Body(*body), ActuationConstants(*chambers), MemoryLaw(*memory), instantaneous
    )
    held_work, work, springs, gain, weight, move = workspace
    scratch = Held(*held_work[:10], Joints(*held_work[10]))
    storage = ObserverWorkspace(scratch, Workspace(*work), Joints(*springs), gain, weight, move)
    return follow(periods, pressure, values, ObserverState(*state), chain, ObserverGains(*gains), Pace(*pace), storage)


def lost(values):
    """Return whether any of the measured angles is NaN, that is, whether the frame is lost."""
    for i in range(len(values)):
        if not np.isfinite(values[i]):
            return True
    return False


def ahead(state, pressure, model, count, h, workspace):
    """Integrate the observer's model over `count` steps h [s] at constant pressures (C,) [Pa] of C chambers. Return
    whether a step failed.
    """
    springs = workspace.springs
    for i in range(len(state.angle)):
        springs.theta0[i] = model.joints.theta0[i] + state.own_shift[i]
    constants, work, failed = model.chambers, workspace.work, False
    for c in range(len(pressure)):
        for i in range(constants.gain.shape[1]):
            workspace.gain[c, i] = constants.gain[c, i] * state.factor[0]
    chambers = ActuationConstants(constants.law, workspace.gain, constants.rubber)
    past = Past(model.memory, state.memory, workspace.held)
    for _ in range(count):
        held_torques(h, pressure, chambers, state.slow, work.tau)
        taken = step_with_memory(state.angle, state.rate, h, work.tau, model.body, springs, past, work)
        for i in range(len(state.angle)):
            if not (abs(state.rate[i]) * h <= 1.0 and taken >= 0.0 and tangent(i, state.angle, springs) > 0.0):
                failed = True
    return failed


def learn_ahead(state, gains, periods, pressure, chambers, new):
    """Advance, in place, the derivative of the observer's state with respect to its torque factor by `periods` frame
    periods.

    `pressure` (C,) [Pa] is constant. `chambers` are the model's own, with factor 1; `new` (3n,) is workspace.

    Source: Zhang, IEEE Trans. Autom. Control 47(3), 2002
    """
    F, G, by = gains.F, gains.G, state.sensitivity
    if state.factor[1] <= 0.0:
        return
    for _ in range(periods):
        for a in range(len(G)):
            new[a] = 0.0
        for c in range(len(pressure)):
            push = law_torque(pressure[c], chambers.law[c], chambers.rubber[c, 5])
            for a in range(len(G)):
                new[a] = new[a] + G[a, c] * push
        for a in range(len(G)):
            for b in range(len(G)):
                new[a] = new[a] + F[a, b] * by[b]
        for a in range(len(G)):
            by[a] = new[a]
        state.factor[1] = state.factor[1] + gains.growth


def correct_all(state, gains, weight, move):
    """Correct the observer's state by a constant gain times the innovation, and its torque factor by recursive least
    squares.

    `weight` and `move` (3n,) are workspace.
    """
    innovation, by, factor = state.innovation, state.sensitivity, state.factor
    gain, precision = gains.gain, gains.precision
    n = len(innovation)
    along = 0.0
    total = 0.0
    for i in range(n):
        weight[i] = 0.0
        for j in range(n):
            weight[i] = weight[i] + precision[i, j] * by[j]
        along = along + by[i] * weight[i]
        total = total + weight[i] * innovation[i]
    part = factor[1] / (1.0 + factor[1] * along)
    change = part * total
    factor[0] = factor[0] + change
    factor[1] = factor[1] - factor[1] * part * along
    for a in range(3 * n):
        move[a] = 0.0
        weight[a] = by[a]
        for i in range(n):
            move[a] = move[a] + gain[a, i] * innovation[i]
            weight[a] = weight[a] - gain[a, i] * by[i]
    for a in range(3 * n):
        by[a] = weight[a]
        move[a] = move[a] + weight[a] * change
    for i in range(n):
        state.angle[i] = state.angle[i] + move[i]
        state.rate[i] = state.rate[i] + move[n + i]
        state.own_shift[i] = state.own_shift[i] + move[2 * n + i]


def rest_shift(angle, own_shift, memory_state, base_angle, rest_angle, memory, left, shift):
    """Write to `shift` (n,) [rad] the shift of the rest angles of n joints that has the same effect as model error,
    hysteresis and creep.

    K (q - own) + K r = tau, with r = r_now + c (q - q_now), where c is `left`.
    """
    before = base_angle
    for i in range(len(angle)):
        q = angle[i] - before - rest_angle[i]
        before = angle[i]
        r = memory_angle(i, q, memory_state, memory)
        shift[i] = (own_shift[i] + left * q - r) / (1.0 + left)
