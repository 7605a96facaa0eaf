"""The arithmetic of one frame of the observer, compiled: model ahead, factor on the torque, correction, rest shifts.

Paper: Eq. (5) [eq:eom] for the model; the rest is estimation and not of the paper.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.memory import memory_angle
from pliant.equations.section import torque
from pliant.equations.symbols import Held, Joints, Workspace
from pliant.simulation.memory_loops import held_step_with_memory


def follow(state, learnt, pressure, model, gains, chords, pace, points, scratch):
    """Move an observer to the time of a frame and correct it by the frame; 0, or the sum of 1, 2 and 4.

    1: the model failed; 2: the frame is lost (`points` (S, 2) not all finite); 4: an innovation exceeds pace[3].
    `state` is ((5, n), states of the memory), its rows angle, rate, own, innovation and shift: own is the rest shift
    that the model lacks, shift that of the model without memory. `learnt` (4 + 3n,) is the slow pressure [Pa], the
    factor on the torque, its variance, the variance's growth in a period, and the sensitivity of the state. `model` is
    (base_angle, rest_angle, joints, body, law of the torque, share and time [s] of the swelling, law of the memory,
    share that is left of it), `gains` (gain (3n, n), sure (n, n), F (3n, 3n), G (3n,)), `pace` (periods, parts of one,
    step [s], largest innovation [rad]). `scratch` holds 1 + 16n + 2 n^2 + len(law) numbers: one array costs a caller
    less than thirty.
    """
    x, memory_state = state
    angle, own, innovation = x[0], x[2], x[3]
    periods, parts, h, lost = pace
    n = len(angle)
    one = scratch[: 3 * n]
    two = scratch[3 * n : 6 * n]
    told = 0
    if periods > 0:
        learn_ahead(learnt, gains, periods, torque(pressure, model[4]), one)
        told = ahead(state, learnt, pressure, model, periods * parts, h, scratch)
    if link_angles(points, chords, two) < 0:
        told = told + 2
    else:
        for i in range(n):
            innovation[i] = two[i] - angle[i]
        correct_all(x, learnt, gains, one, two)
        for i in range(n):
            if not abs(innovation[i]) < lost:
                told = told + 4
                break
    rest_shift(angle, own, memory_state, model, x[4])
    return told


def ahead(state, learnt, pressure, model, count, h, scratch):
    """The model's own steps under a constant pressure [Pa]; 1 where one failed, else 0."""
    x, memory_state = state
    angle, rate, own = x[0], x[1], x[2]
    base_angle, rest_angle, joints, body, law, share, time, memory, _left = model
    n = len(angle)
    held = room_to_hold(scratch, joints, n)
    work = room_to_work(scratch[10 * n :], n)
    theta0 = scratch[15 * n + 2 * n * n + 1 :][:n]
    now = scratch[16 * n + 2 * n * n + 1 :][: len(law)]
    for i in range(n):
        theta0[i] = rest_angle[i] + own[i]
    joints = Joints(theta0, joints.K, joints.D, joints.gain, joints.K2, joints.unbent)
    for k in range(len(law)):
        now[k] = law[k] * learnt[1]
    told = 0
    for _ in range(count):
        end, learnt[0] = held_step_with_memory(
            angle, rate, memory_state, base_angle, h, pressure, pressure, learnt[0], 0.0, 0.0, share, time, now, body,
            joints, memory, held, work,
        )
        if not np.isfinite(end):
            told = 1
    return told


def room_to_hold(x, joints, n):
    """Scratch arrays of a step with memory in the first 10 n of x."""
    K = x[8 * n : 9 * n]
    theta0 = x[9 * n : 10 * n]
    return Held(
        x[:n], x[n : 2 * n], x[2 * n : 3 * n], x[3 * n : 4 * n], x[4 * n : 5 * n], x[5 * n : 6 * n], x[6 * n : 7 * n],
        x[7 * n : 8 * n], K, theta0, Joints(theta0, K, joints.D, joints.gain, joints.K2, joints.unbent),
    )


def room_to_work(x, n):
    """Scratch arrays of a step in the first 6 n + 2 n^2 + 1 of x."""
    m = 2 * n * n
    return Workspace(
        x[: n * n].reshape(n, n), x[n * n : m].reshape(n, n), x[m : m + n], x[m + n : m + 2 * n],
        x[m + 2 * n : m + 3 * n + 1], x[m + 3 * n + 1 : m + 4 * n + 1], x[m + 4 * n + 1 : m + 5 * n + 1],
    )


def learn_ahead(learnt, gains, periods, push, new):
    """Sensitivity of the observer's state to the factor after whole periods under a torque [N m] of factor 1.

    Source: Zhang, IEEE Trans. Autom. Control 47(3), 2002
    """
    _gain, _sure, F, G = gains
    if learnt[2] <= 0.0:
        return
    for _ in range(periods):
        for a in range(len(G)):
            new[a] = G[a] * push
            for b in range(len(G)):
                new[a] = new[a] + F[a, b] * learnt[4 + b]
        for a in range(len(G)):
            learnt[4 + a] = new[a]
        learnt[2] = learnt[2] + learnt[3]


def correct_all(x, learnt, gains, weight, move):
    """Correct state and factor by an innovation: the constant gain, and recursive least squares along the sensitivity.

    `weight` and `move` (3n,) are scratch.
    """
    angle, rate, own, innovation = x[0], x[1], x[2], x[3]
    gain, sure, _F, _G = gains
    n = len(angle)
    along = 0.0
    seen = 0.0
    for i in range(n):
        weight[i] = 0.0
        for j in range(n):
            weight[i] = weight[i] + sure[i, j] * learnt[4 + j]
        along = along + learnt[4 + i] * weight[i]
        seen = seen + weight[i] * innovation[i]
    part = learnt[2] / (1.0 + learnt[2] * along)
    change = part * seen
    learnt[1] = learnt[1] + change
    learnt[2] = learnt[2] - learnt[2] * part * along
    for a in range(3 * n):
        move[a] = 0.0
        weight[a] = learnt[4 + a]
        for i in range(n):
            move[a] = move[a] + gain[a, i] * innovation[i]
            weight[a] = weight[a] - gain[a, i] * learnt[4 + i]
    for a in range(3 * n):
        learnt[4 + a] = weight[a]
        move[a] = move[a] + weight[a] * change
    for i in range(n):
        angle[i] = angle[i] + move[i]
        rate[i] = rate[i] + move[n + i]
        own[i] = own[i] + move[2 * n + i]


def rest_shift(angle, own, memory_state, model, shift):
    """Rest shifts of the model without memory: K (q - own) + K r = tau, with r = r_now + c (q - q_now)."""
    base_angle, rest_angle, _joints, _body, _law, _share, _time, memory, left = model
    before = base_angle
    for i in range(len(angle)):
        q = angle[i] - before - rest_angle[i]
        before = angle[i]
        r = memory_angle(i, q, memory_state, memory)
        shift[i] = (own[i] + left * q - r) / (1.0 + left)


def link_angles(points, chords, out):
    """Absolute angles of the links from points (S, 2) along the body: `LinkAngles`, unwrapped; -1 where one is lost."""
    left, share, mirror = chords
    for k in range(len(points)):
        if not (np.isfinite(points[k, 0]) and np.isfinite(points[k, 1])):
            return -1
    for i in range(len(left) - 1):
        j = left[i]
        k = left[i + 1]
        x = (1.0 - share[i + 1]) * points[k, 0] + share[i + 1] * points[k + 1, 0]
        y = (1.0 - share[i + 1]) * points[k, 1] + share[i + 1] * points[k + 1, 1]
        x = x - ((1.0 - share[i]) * points[j, 0] + share[i] * points[j + 1, 0])
        y = y - ((1.0 - share[i]) * points[j, 1] + share[i] * points[j + 1, 1])
        turn = np.arctan2(-mirror * x, y)
        if i > 0:
            turn = turn - 2.0 * np.pi * np.round((turn - out[i - 1]) / (2.0 * np.pi))
        out[i] = turn
    return 0
