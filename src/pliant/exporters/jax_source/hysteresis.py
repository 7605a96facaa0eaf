"""Hysteresis of joints and segments: creep, slip elements and Bouc-Wen, linear in the middle of a step.

A block of k joints has d coordinates each: one, or the two of a swing in space, which slip together. Arrays of a block
are (k, d) and its states (k, d, branches). The hysteresis torque over K is offset + slope q in the middle of a step.
Which elements slip depends on the motion of the step, which is the root of an equation. `forgetful` has functions of
the same names for joints without hysteresis.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax

from pliant.exporters.jax_source.numerics import rooted
from pliant.exporters.jax_source.plane import SIZE, joint_coordinates, line_matrix, metric, to_joints
from pliant.exporters.jax_source.structure import AXIAL_BRANCHES, BRANCHES, REMEMBERING
from pliant.exporters.jax_source.untied import changed

TRIALS, CALM = 60, 12  # trials of one step, at most; from the second number on, moves are halved
DIRECTION = 1e-3  # rad, weight of a difference in the direction of slip


class Line(NamedTuple):
    """Hysteresis of one block over a step: a linear function in the middle of it, and the mean torque over K."""

    offset: jnp.ndarray  # (k, d)
    slope: jnp.ndarray  # (k, d, d)
    mean: jnp.ndarray  # (k, d)
    way: jnp.ndarray  # (k, d, S) direction of slip, 0 where an element sticks


def branches(p, prefix):
    """Return creep shares and times, slip shares and limits, and the Bouc-Wen share of joints or ("axial_") segments.

    The share is None without Bouc-Wen.
    """
    none = jnp.zeros(0, p["stiffness"].dtype)
    creep, slip = AXIAL_BRANCHES if prefix else BRANCHES[:2]
    limit = "axial_slip_strain" if prefix else "slip_angle"
    creeping = [p[prefix + name] if creep else none for name in ("creep_share", "creep_time")]
    slipping = [p[name] if slip else none for name in (prefix + "slip_share", limit)]
    return (*creeping, *slipping, p["boucwen_share"] if BRANCHES[2] and not prefix else None)


def decay(p, size, turn):
    """Return the decay x of Bouc-Wen states of absolute value `size` without decay, for a motion `turn` along them.

    The state |z| (1 + x) = size is found by Newton's method, and differentiated through one more move.
    """
    zero, n = size <= 0.0, p["boucwen_exponent"]
    way = jnp.where(zero, 0.0, jnp.sign(lax.stop_gradient(turn)))
    rate = 0.5 * jnp.where(turn < 0.0, -turn, turn) * (p["boucwen_beta"] + way * p["boucwen_gamma"])
    goal = jnp.where(zero, 1.0, size)

    def moved(y, goal, rate, n):
        power = rate * y ** (n - 1.0)
        return (goal + (n - 1.0) * power * y) / (1.0 + n * power)

    held = lax.stop_gradient((goal, rate, n))
    y = lax.while_loop(
        lambda now: (now[1] < 30) & jnp.any(now[0] - moved(now[0], *held) > 1e-15 * held[0]),
        lambda now: (moved(now[0], *held), now[1] + 1), (held[0], 0),
    )[0]
    return jnp.where(zero, 0.0, rate * moved(lax.stop_gradient(y), goal, rate, n) ** (n - 1.0))


def stretched(e, dq, limit, weight):
    """Return the stretch (k, d, S) of slip elements after a motion dq, and their scale and direction of slip."""
    u = e + dq[:, :, None]
    square = jnp.sum(weight[:, :, None] * u * u, axis=1)
    slips = square > limit * limit
    size = jnp.sqrt(jnp.where(slips, square, 1.0))
    keeps = jnp.where(slips, limit / size, 1.0)
    return keeps[:, None] * u, keeps, jnp.where(slips[:, None], u / size[:, None], 0.0)


def line_of(p, law, state, h, q, dq, weight):
    """Return the `Line` of one block for motions dq (k, d) over a step of h [s] from the coordinates q (k, d)."""
    creep, time, share, limit, bouc = law
    P, S = creep.shape[0], share.shape[0]
    one = jnp.eye(q.shape[1], dtype=q.dtype)
    middle = q + 0.5 * dq
    part = creep / (1.0 + 0.5 * h / time)
    offset = -state[:, :, :P] @ part
    own = jnp.sum(part) * jnp.ones_like(q)
    e = state[:, :, P : P + S]
    end, keeps, way = stretched(e, dq, limit, weight)
    level = 0.5 * (e + end) @ share
    tangent = jnp.sum(share * keeps, axis=1)[:, None, None] * one
    tangent = tangent - jnp.einsum("ks,kis,kjs->kij", share * keeps, way, way * weight[:, :, None])
    mean = offset + own * middle + level
    offset = offset + level - jnp.einsum("kij,kj->ki", tangent, middle)
    if bouc is not None:
        z = state[:, :, -1]
        goal = z + 0.5 * dq
        size, along = size_along(goal, dq, weight)
        more = (bouc / (1.0 + decay(p, size, along)))[:, None]
        offset, own, mean = offset + more * (z - q), own + more, mean + more * goal
    return Line(offset, tangent + own[:, :, None] * one, mean, way)


def size_along(goal, dq, weight):
    """Return the size (k,) of Bouc-Wen states (k, d) in the middle of a step, and the motion along them."""
    square = jnp.sum(weight * goal * goal, axis=1)
    there = square > 0.0
    size = jnp.sqrt(jnp.where(there, square, 1.0))
    return jnp.where(there, size, 0.0), jnp.where(there, jnp.sum(weight * goal * dq, axis=1) / size, 0.0)


def moved_states(p, law, state, h, q, dq, weight):
    """Return the states (k, d, branches) of one block after the step."""
    creep, time, share, limit, bouc = law
    P, S = creep.shape[0], share.shape[0]
    ratio = 0.5 * h / time
    slow = state[:, :, :P]
    gap = ((q + 0.5 * dq)[:, :, None] - slow) / (1.0 + ratio)
    end, _, _ = stretched(state[:, :, P : P + S], dq, limit, weight)
    rows = [slow + 2.0 * ratio * gap, end]
    if bouc is not None:
        z = state[:, :, -1]
        goal = z + 0.5 * dq
        rows.append((2.0 * goal / (1.0 + decay(p, *size_along(goal, dq, weight)))[:, None] - z)[:, :, None])
    return jnp.concatenate(rows, axis=2)


def blocks(c):
    """Yield, for each block of coordinates that has hysteresis branches: the rows of the block, its shape (joints k,
    coordinates of a joint d), the law of its branches, their weights (k, d) and the number of states.
    """
    for start, stop, d, prefix, weight in metric(c):
        law = branches(c, prefix)
        count = law[0].shape[0] + law[2].shape[0] + (law[4] is not None)
        if count:
            size = (stop - start) // d
            own = jnp.ones((size, d), c["K"].dtype) if weight is None else weight
            yield slice(start, stop), (size, d), law, own, count


def lines(c, h, memory, q, dq):
    """Return the `Line` of every block, for the motions dq (m,) of all coordinates with hysteresis."""
    return [
        line_of(c, law, memory[rows, :count].reshape(*shape, count), h, q[rows].reshape(shape),
                dq[rows].reshape(shape), weight)
        for rows, shape, law, weight, count in blocks(c)
    ]


def flat(c, found, size):
    """Return offsets, slopes by the coordinate itself and by its partner, each (N,), of the lines of all blocks."""
    parts = [jnp.zeros(size, c["K"].dtype) for _ in range(3)]
    for (rows, shape, *_), line in zip(blocks(c), found, strict=True):
        own = jnp.einsum("kii->ki", line.slope)
        across = line.slope.sum(axis=2) - own if shape[1] == 2 else jnp.zeros_like(own)
        for k, value in enumerate((line.offset, own, across)):
            parts[k] = parts[k].at[rows].set(value.reshape(-1))
    return parts


def disagreement(c, guess, actual, q, dq):
    """Return the largest difference of the hysteresis torque of the lines `guess` from that at the motions dq (m,)."""
    worst = jnp.zeros((), q.dtype)
    for (rows, shape, *_), line, now in zip(blocks(c), guess, actual, strict=True):
        middle = (q[rows] + 0.5 * dq[rows]).reshape(shape)
        apart = jnp.sum(jnp.abs(line.offset + jnp.einsum("kij,kj->ki", line.slope, middle) - now.mean), axis=1)
        slips = jnp.any(line.way != 0.0, axis=1, keepdims=True) & jnp.any(now.way != 0.0, axis=1, keepdims=True)
        turned = jnp.where(slips & (shape[1] == 2), jnp.abs(line.way - now.way), 0.0)
        worst = jnp.maximum(worst, jnp.max(apart) + DIRECTION * jnp.max(turned, initial=0.0))
    return worst


def agreeing(dtype):
    """Return the tolerance [rad] between the torque that a step assumes and that after it, over K."""
    return 1e-12 if dtype == jnp.float64 else 2e-6


def solved_step(c, begun, memory):
    """Return the change of the rates (N,) over a step, the hysteresis states after it, and whether it was solved."""
    h, v = begun.h, begun.v
    q, middle = (joint_coordinates(c, x) for x in (begun.x, begun.middle))
    before = q[:REMEMBERING]

    def change_with(line):
        offset, own, across = flat(c, line, SIZE)
        slope = line_matrix(own, across)
        K = begun.K + 0.25 * h * h * c["K"][:, None] * slope
        return changed(c, begun, K, begun.net - c["K"] * (offset + slope @ middle))

    def motion_of(change):
        return (h * to_joints(c, v + 0.5 * change))[:REMEMBERING]

    def lines_at(dq):
        return lines(c, h, memory, before, dq)

    def gap(line, turn):
        return disagreement(c, line, lines_at(turn), before, turn)

    def residual(dq):
        return motion_of(change_with(lines_at(dq))[0]) - dq

    def search(_, guess):
        def trial(now):
            dq, count, _ = now
            line = lines_at(dq)
            turn = motion_of(change_with(line)[0])
            apart = gap(line, turn)
            half = (count >= CALM) & (apart > agreeing(dq.dtype))
            return jnp.where(half, 0.5 * (turn + dq), turn), count + 1, apart

        start = (guess, 0, jnp.full((), jnp.inf, guess.dtype))
        return lax.while_loop(lambda now: (now[1] < TRIALS) & (now[2] > agreeing(guess.dtype)), trial, start)[0]

    line = lines_at(rooted(residual, motion_of(0.0 * v), search))
    change, found = change_with(line)
    turn = motion_of(change)
    good = found & (gap(line, turn) <= 1e3 * agreeing(turn.dtype))
    return change, remembered(c, h, memory, before, turn), good


def remembered(c, h, memory, q, dq):
    """Return the hysteresis states (m, columns) after motions dq (m,) from the coordinates q (m,) in h [s]."""
    for rows, shape, law, weight, count in blocks(c):
        state = memory[rows, :count].reshape(*shape, count)
        after = moved_states(c, law, state, h, q[rows].reshape(shape), dq[rows].reshape(shape), weight)
        memory = memory.at[rows, :count].set(after.reshape(-1, count))
    return memory


def relaxed(c, q, memory):
    """Return the hysteresis states in equilibrium at the joint coordinates q (N,).

    Creep is relaxed, the other branches are unstretched.
    """
    memory = jnp.zeros_like(memory)
    for rows, _, law, _, _ in blocks(c):
        memory = memory.at[rows, : law[0].shape[0]].set(q[rows, None])
    return memory
