"""Compiled loops that simulate `WIDTH` chains in space at once, one in each element of a SIMD vector.

This module is plain Python; `pliant.compiler.choose.lane_twin` compiles it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pliant.batch.simd_loops import FAR, note_failures, torques_of_lanes
from pliant.compiler import WIDTH
from pliant.compiler.simd import as_lanes, lanes_of, within
from pliant.equations.chamber import share_out
from pliant.equations.elastic import LEAST_STRETCH
from pliant.equations.motion import step
from pliant.equations.spatial import pose_links
from pliant.equations.spatial_springs import MOST_SWING, first_strain, nonlinear_springs, slope_at
from pliant.simulation.pressure_loops import law_torques

LONG = 1e3  # strains above `LEAST_STRETCH` - 1 that count as valid


class LaneSteps(NamedTuple):
    """Time steps of a group of W samples, which have equally many steps."""

    h: np.ndarray  # (steps, W) s; a step of length 0 changes nothing
    torque: np.ndarray  # (steps, C, W) N m, mean of each input over each step
    gain: np.ndarray  # (C, N, W) fraction of the input's torque at each coordinate
    keep: np.ndarray  # (steps,) output row of the state after the step; negative: no output


class LaneRows(NamedTuple):
    """Output of a group of W samples, one row per output time."""

    x: np.ndarray  # (rows, N, W)
    v: np.ndarray  # (rows, N, W)
    failed: np.ndarray  # (W,) first step that fails, -1 where none does


def march_in_space(state, steps, body, joints, work, out):
    """Integrate a group of W = `WIDTH` chains in space over all steps (`LaneSteps`).

    Every array has the samples last: state (2, N, W) the coordinates and rates, changed in place; `body`, `joints` and
    `work` are a `SpatialBody`, a `SpatialJoints` and a `SpatialWorkspace` of such arrays. The states of the output rows
    are written to `out` (`LaneRows`), of which row 0 is the start. For a sample that fails, the step is written to
    out.failed; its later rows are meaningless, and the other samples are not affected.
    """
    both = as_lanes(state)
    x, v = both[0], both[1]
    mass, springs, scratch = lanes_of(body), lanes_of(joints), lanes_of(work)
    lengths, torques, gain = as_lanes(steps.h), as_lanes(steps.torque), as_lanes(steps.gain)
    row_x, row_v = as_lanes(out.x), as_lanes(out.v)
    keep_lane_row(0, x, v, row_x, row_v)
    good = (1 << WIDTH) - 1
    for k in range(len(lengths)):
        for c in range(len(gain)):
            share_out(c, torques[k, c], gain, scratch.tau)
        step(x, v, lengths[k], scratch.tau, mass, springs, scratch)
        good = note_failures(good, sound_in_space(x, v, lengths[k], springs, good), k, out.failed)
        if steps.keep[k] >= 0:
            keep_lane_row(steps.keep[k], x, v, row_x, row_v)


def hold_in_space(h, steps, group, chambers, state, chain, work, failed):
    """Advance one group of chains in space by a number of `steps` of h (1, W) [s] each under constant pressure
    commands. `state` (2, N, W) and the pressures in `chambers` (`simd_loops.Commanded`) change in place.

    `group` is the number of the group in `chambers`; `chain` is (body, joints), and these and work are those of
    `march_in_space`. failed (W,) is set to 1 for a chain that fails, and to 0 for the others.
    """
    body, joints = chain
    both = as_lanes(state)
    x, v = both[0], both[1]
    mass, springs, scratch = lanes_of(body), lanes_of(joints), lanes_of(work)
    length = as_lanes(h)[0]
    good = (1 << WIDTH) - 1
    still = False
    for _ in range(steps):
        if not still:
            still = torques_of_lanes(group, h[0, 0], chambers, work.tau)
        step(x, v, length, scratch.tau, mass, springs, scratch)
        good = sound_in_space(x, v, length, springs, good)
    for lane in range(WIDTH):
        failed[lane] = 1 - (good >> lane & 1)


def mean_torques_in_space(h, lengths, first, behind, law, torque):
    """Write to torque (steps, W) [N m] the mean torque of one chamber of W samples in each step, by `law_torques`."""
    law_torques(as_lanes(h), as_lanes(lengths), first, as_lanes(behind), as_lanes(law), as_lanes(torque))


def keep_lane_row(row, x, v, row_x, row_v):
    """Write coordinates x and rates v of a group to a row of the output arrays."""
    for i in range(len(x)):
        row_x[row, i] = x[i]
        row_v[row, i] = v[i]


def tips_in_space(rows, body, work, tips):
    """Write the tips (rows, n, 3, W) [m] of the n links of W chains at their coordinates `rows` (rows, N, W).

    `body` and `work` are those of `march_in_space`.
    """
    x, tip = as_lanes(rows), as_lanes(tips)
    mass, scratch = lanes_of(body), lanes_of(work)
    n = len(mass.mass)
    for row in range(len(x)):
        pose_links(x[row], mass, scratch)
        for j in range(3):
            for k in range(1, n):
                tip[row, k - 1, j] = scratch.r[k + 1, j]
            tip[row, n - 1, j] = scratch.r[n, j] + scratch.length[n] * scratch.R[n, j, 2]


def sound_in_space(x, v, h, joints, good):
    """Return the bit mask `good` without the samples for which `spatial_springs.follows` is false after a step of h
    [s].
    """
    swings = 2 * len(joints.unloaded)
    for i in range(len(x)):
        good &= within(v[i] * h, 1.0)
    for i in range(0, swings, 2):
        good &= within(x[i] * x[i] + x[i + 1] * x[i + 1], MOST_SWING)
        far = FAR * joints.K[i]  # positive is what lies no further from a far point than zero does
        good &= within(slope_at(i, joints, x) - far, far)
    for i in range(swings, nonlinear_springs(joints)):
        far = FAR * joints.K[i]
        good &= within(slope_at(i, joints, x) - far, far)
    for i in range(first_strain(joints), len(x)):
        good &= within(x[i] - (LEAST_STRETCH - 1.0) - LONG, LONG)
    return good
