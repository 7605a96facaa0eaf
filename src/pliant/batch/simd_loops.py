"""The loops of a batch that run compiled, on lanes: `WIDTH` chains side by side (`pliant.compiler.simd`).

Plain text here; `pliant.compiler.simd.lane_twin` makes what runs. The equations are those of `pliant.equations`.
"""

from __future__ import annotations

from pliant.compiler.simd import WIDTH, as_lanes, within
from pliant.equations.chain import tips
from pliant.equations.elastic import tangent
from pliant.equations.motion import step
from pliant.equations.section import mean_torque
from pliant.equations.symbols import Body, Joints, Workspace

FAR = 1e4  # in K: springs that stiffen more are none


def mean_torques(h, parts, behind, law, torque):
    """Mean torque [N m] of every step, lanes, from the pressure behind the valve in the intervals that it is made of.

    h (m, W) are the lengths of the intervals [s], parts (steps + 1,) says which of them make a step, behind (m, 4, W)
    holds the pressure at their start, middle and end and its mean, law (k, W) the torque law, torque (steps, W).
    """
    lengths = as_lanes(h)
    pressure = as_lanes(behind)
    a = as_lanes(law)
    out = as_lanes(torque)
    for k in range(len(out)):
        first = parts[k]
        if parts[k + 1] == first + 1:
            p = pressure[first]
            out[k] = mean_torque(p[0], p[1], p[2], p[3], a)
            continue
        total = 0.0 * a[0]
        time = 0.0 * a[0]
        for j in range(first, parts[k + 1]):
            p = pressure[j]
            total = total + lengths[j] * mean_torque(p[0], p[1], p[2], p[3], a)
            time = time + lengths[j]
        out[k] = total / time


def march_lanes(state, h, torque, keep, constants, joints, scratch, place, phi_out, w_out, tips_out, failed):
    """Take len(h) steps of `WIDTH` chains side by side, as `simulation.march_loops.march` takes them of one.

    Every array has the lanes last: state (2, n, W) the angles and rates, advanced in place; h and torque (steps, W);
    keep (steps,) the row of the output after the step, or -1, row 0 being the start; constants B (n, n, W), I (n, W),
    h (n, W) and g (2, W); joints (5, n, W) theta0, K, D, gain and K2; scratch (n, n, W) twice and (5, n + 1, W);
    place (n + 3, W) the lengths of the links, the first joint and the base angle.
    A lane that fails has its step written to failed (W,), -1 elsewhere, and goes on as it may; the others do not
    feel it. Returns the bits of the lanes that are good.
    """
    n = state.shape[1]
    chain = as_lanes(joints)
    B, I, first_moment, g = constants
    gravity = as_lanes(g)
    body = Body(as_lanes(B), as_lanes(I), as_lanes(first_moment), gravity[0], gravity[1])
    joint = Joints(chain[0], chain[1], chain[2], chain[3], chain[4], chain[0])
    A, S, vectors = scratch
    rows = as_lanes(vectors)
    work = Workspace(as_lanes(A), as_lanes(S), rows[0, :n], rows[1, :n], rows[2], rows[3, :n], rows[4, :n])
    both = as_lanes(state)
    phi = both[0]
    w = both[1]
    where = as_lanes(place)
    lengths, torques = as_lanes(h), as_lanes(torque)
    phi_rows, w_rows, tip_rows = as_lanes(phi_out), as_lanes(w_out), as_lanes(tips_out)
    tips(phi, where[:n], where[n], where[n + 1], tip_rows[0])
    for i in range(n):
        phi_rows[0, i] = phi[i]
        w_rows[0, i] = w[i]
    good = (1 << WIDTH) - 1
    for k in range(len(lengths)):
        step(phi, w, where[n + 2], lengths[k], torques[k], body, joint, work)
        now = good
        for i in range(n):
            now &= within(w[i] * lengths[k], 1.0)
            far = FAR * joint.K[i]  # positive is what lies no further from a far point than zero does
            now &= within(tangent(i, phi, where[n + 2], joint) - far, far)
        if good & ~now:
            for lane in range(WIDTH):
                if (good & ~now) >> lane & 1:
                    failed[lane] = k
            good &= now
        row = keep[k]
        if row >= 0:
            for i in range(n):
                phi_rows[row, i] = phi[i]
                w_rows[row, i] = w[i]
            tips(phi, where[:n], where[n], where[n + 1], tip_rows[row])
    return good


def unpack_lanes(phi_rows, w_rows, tip_rows, rest, base_angle, sign, angle_out, rate_out, tip_out):
    """From the rows (rows, n, W) and (rows, n, 2, W) of `march_lanes` to samples (samples, rows, n[, 2]).

    Joint angles and rates relative to the link before; rest (n, W) and base_angle (W,) as in the march, `sign` is the
    sense of bending. An output of no samples is not asked for.
    """
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
                tip_out[lane, row, i, 0] = sign * tip_rows[row, i, 0, lane]
                tip_out[lane, row, i, 1] = tip_rows[row, i, 1, lane]
