"""Compiled loops that simulate `WIDTH` chains at once, one in each element of a SIMD vector.

This module is plain Python; `pliant.compiler.choose.lane_twin` compiles it. The equations are those of
`pliant.equations`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pliant.compiler import WIDTH
from pliant.compiler.simd import as_lanes, within
from pliant.equations.chain import tips
from pliant.equations.chamber import mean_of_law, share_out
from pliant.equations.elastic import tangent
from pliant.equations.motion import step
from pliant.equations.symbols import ActuationConstants, Body, Interval, Joints, Workspace
from pliant.simulation.march_loops import Drives, take_torques

FAR = 1e4  # in K: largest tangent stiffness that counts as valid


class Output(NamedTuple):
    """Output arrays of a SIMD group of simulated chains; the samples are along the last axis."""

    phi: np.ndarray  # (rows, n, W) rad
    w: np.ndarray  # (rows, n, W) rad/s
    tips: np.ndarray  # (rows, n, 2, W) m
    failed: np.ndarray  # (W,) first step that fails, -1 where none does


class Commanded(NamedTuple):
    """Chambers of a batch under constant pressure commands, as arrays over group, sample and chamber."""

    command: np.ndarray  # (G, W, C) Pa
    law: np.ndarray  # (G, W, C, k); law, gain and rubber as in `symbols.ActuationConstants`
    gain: np.ndarray  # (G, W, C, n)
    rubber: np.ndarray  # (G, W, C, 6)
    valve: np.ndarray  # (G, W, C, 4) a `Lag` for each
    pressure: np.ndarray  # (G, W, C) Pa behind the valves, advanced in place
    slow: np.ndarray  # (G, W, C, 2) slow states, advanced in place
    torque: np.ndarray  # (W, n) N m, scratch


class Lane(NamedTuple):
    """Model constants of a SIMD group of samples, as arrays with the samples along the last axis."""

    body: tuple[np.ndarray, ...]  # B (n, n, W), I (n, W), h (n, W), gravity (2, W)
    joints: np.ndarray  # (4 + rows of hardening, n, W) theta0, K, D, gain, hardening
    place: np.ndarray  # (n + 3, W) lengths of the links, first joint, base angle


def mean_torques(h, parts, behind, law, torque):
    """Write to `torque` (steps, W) [N m] the mean torque of W samples in every step, from the pressures behind the
    valves.

    h (m, W) holds the lengths of the intervals [s] and parts (steps + 1,) the first interval of each step. behind
    (m, 4, W) holds the pressure at the start, middle and end of each interval and its mean [Pa], law (k, W) the torque
    law.
    """
    lengths = as_lanes(h)
    pressure = as_lanes(behind)
    a = as_lanes(law)
    out = as_lanes(torque)
    for k in range(len(out)):
        first = parts[k]
        if parts[k + 1] == first + 1:
            p = pressure[first]
            out[k] = mean_of_law(Interval(p[0], p[1], p[2], p[3]), a)
            continue
        total = 0.0 * a[0]
        time = 0.0 * a[0]
        for j in range(first, parts[k + 1]):
            p = pressure[j]
            total = total + lengths[j] * mean_of_law(Interval(p[0], p[1], p[2], p[3]), a)
            time = time + lengths[j]
        out[k] = total / time


def march_lanes(state, h, torque, keep, samples, scratch, out):
    """Integrate a group of W = `WIDTH` chains over steps of the lengths h (steps, W) [s]. `state` changes in place, and
    output rows are written to `out`.

    Every array has the samples last: state (2, n, W) the angles and rates, changed in place; h and torque (steps, W);
    keep (steps,) the output row after each step (negative: none; row 0 is the start); `samples` (`Lane`); scratch
    (n, n, W) twice and (7, n + 1, W); `out` (`Output`). For a sample that fails, the step is written to out.failed; its
    later rows are meaningless, and the other samples are not affected. Returns a bit mask of the good samples.
    """
    n = state.shape[1]
    chain = as_lanes(samples.joints)
    B, I, first_moment, g = samples.body
    gravity = as_lanes(g)
    body = Body(as_lanes(B), as_lanes(I), as_lanes(first_moment), gravity[0], gravity[1])
    where = as_lanes(samples.place)
    gain = chain[3:4]
    A, S, vectors = scratch
    rows = as_lanes(vectors)
    rest_base(rows[6, :2])
    joint = Joints(where[n + 2], chain[0], chain[1], chain[2], chain[4:], chain[0], rows[6, :2])
    work = Workspace(
        as_lanes(A), as_lanes(S), rows[0, :n], rows[1, :n], rows[2], rows[3, :n], rows[4, :n], rows[5, :n]
    )
    both = as_lanes(state)
    phi, w = both[0], both[1]
    lengths, torques = as_lanes(h), as_lanes(torque)
    output = Output(as_lanes(out.phi), as_lanes(out.w), as_lanes(out.tips), out.failed)
    keep_lanes(0, phi, w, where, output)
    good = (1 << WIDTH) - 1
    for k in range(len(lengths)):
        share_out(0, torques[k], gain, work.tau)
        step(phi, w, lengths[k], work.tau, body, joint, work)
        good = note_failures(good, sound(phi, w, lengths[k], joint, good), k, out.failed)
        row = keep[k]
        if row >= 0:
            keep_lanes(row, phi, w, where, output)
    return good


def note_failures(good, now, k, failed):
    """Write the step k to `failed` (W,) for each sample of the bit mask `good` that is not in the mask `now`. Return
    the mask of the samples in both.
    """
    if good & ~now:
        for lane in range(WIDTH):
            if (good & ~now) >> lane & 1:
                failed[lane] = k
    return good & now


def rest_base(spin):
    """Set the spin of the base to zero: the base of a chain in a batch rests."""
    for i in range(2):
        spin[i] = 0.0


def sound(phi, w, h, joint, good):
    """Return the bit mask `good` without the samples in which a link turns by more than 1 rad in a step of h [s], or a
    spring is unstable.
    """
    for i in range(len(phi)):
        good &= within(w[i] * h, 1.0)
        far = FAR * joint.K[i]  # positive is what lies no further from a far point than zero does
        good &= within(tangent(i, phi, joint) - far, far)
    return good


def hold_lanes(h, steps, chambers, samples, state, scratch, failed):
    """Advance all groups of chains by a number of `steps` of h [s] each under constant pressure commands. `state` and
    the pressures in `chambers` change in place.

    Groups come first, samples last: state (G, 2, n, W) the angles and rates, changed in place; `samples` (`Lane`) with
    a body of (G, ...), joints (G, 4 + rows, n, W) and place (G, n + 3, W); chambers (`Commanded`); h (1, W); scratch
    as in `march_lanes`; failed (G, W) is set to 1 for a chain that fails, and to 0 for the others.
    """
    n = state.shape[2]
    B, I, first_moment, g = samples.body
    A, S, vectors = scratch
    rows = as_lanes(vectors)
    work = Workspace(
        as_lanes(A), as_lanes(S), rows[0, :n], rows[1, :n], rows[2], rows[3, :n], rows[4, :n], rows[5, :n]
    )
    length = as_lanes(h)[0]
    rest_base(rows[6, :2])
    for group in range(len(state)):
        gravity = as_lanes(g[group])
        body = Body(as_lanes(B[group]), as_lanes(I[group]), as_lanes(first_moment[group]), gravity[0], gravity[1])
        chain, where = as_lanes(samples.joints[group]), as_lanes(samples.place[group])
        joint = Joints(where[n + 2], chain[0], chain[1], chain[2], chain[4:], chain[0], rows[6, :2])
        both = as_lanes(state[group])
        phi, w = both[0], both[1]
        good = (1 << WIDTH) - 1
        still = False
        for _ in range(steps):
            if not still:
                still = torques_of_lanes(group, h[0, 0], chambers, vectors[5])
            step(phi, w, length, work.tau, body, joint, work)
            good = sound(phi, w, length, joint, good)
        for lane in range(WIDTH):
            failed[group, lane] = 1 - (good >> lane & 1)


def torques_of_lanes(group, h, chambers, tau):
    """Write the mean torques of a group of chains in the next h [s] to the first rows of tau (rows, W). Return whether
    they stay the same in later steps under the same commands.
    """
    still = True
    torque = chambers.torque
    for lane in range(WIDTH):
        command, pressure = chambers.command[group, lane], chambers.pressure[group, lane]
        rubber = chambers.rubber[group, lane]
        for c in range(len(command)):
            slow = rubber[c, 0] > 0.0 or rubber[c, 2] > 0.0
            still = still and pressure[c] == command[c] and not slow
        laws = ActuationConstants(chambers.law[group, lane], chambers.gain[group, lane], rubber)
        drives = Drives(laws, chambers.valve[group, lane], pressure, chambers.slow[group, lane])
        take_torques(h, command, drives, torque[lane])
        for i in range(torque.shape[1]):
            tau[i, lane] = torque[lane, i]
    return still


def keep_lanes(row, phi, w, where, out):
    """Write the angles phi, rates w and link tips of a group of chains to one row of the output arrays."""
    n = len(phi)
    for i in range(n):
        out.phi[row, i] = phi[i]
        out.w[row, i] = w[i]
    tips(phi, where[:n], where[n], where[n + 1], out.tips[row])


def unpack_lanes(kept, rest, base_angle, angle_out, rate_out, tip_out):
    """Convert a group's absolute angles to joint angles, joint rates and tips, with the samples along the first axis.

    The outputs are (samples, rows, n) and, for tips, (samples, rows, n, 2). `rest` (n, W) and `base_angle` (W,) are
    subtracted from the absolute angles. An output with no samples is not filled.
    """
    phi_rows, w_rows, tip_rows = kept.phi, kept.w, kept.tips
    rows, n = phi_rows.shape[:2]
    for row in range(rows):
        for lane in range(len(angle_out)):
            before = base_angle[lane]
            for i in range(n):
                angle_out[lane, row, i] = phi_rows[row, i, lane] - before - rest[i, lane]
                before = phi_rows[row, i, lane]
        for lane in range(len(rate_out)):
            before = 0.0
            for i in range(n):
                rate_out[lane, row, i] = w_rows[row, i, lane] - before
                before = w_rows[row, i, lane]
        for lane in range(len(tip_out)):
            for i in range(n):
                tip_out[lane, row, i, 0] = tip_rows[row, i, 0, lane]
                tip_out[lane, row, i, 1] = tip_rows[row, i, 1, lane]
