"""Rests of a chain in space: of one load, and settled poses one after the other, each under the inputs of its row.

Friction of tendons holds against the way from one pose to the next: `tendon.slip` sees the change of the coordinates as
rates over one second. Slopes come from complex steps, so all but what is found is complex; imaginary parts of what is
given lead to those of the poses by the implicit function theorem.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pliant.equations.spatial_points import add_pose_loads, observe
from pliant.equations.tendon import eliminate, forces_at_rest, slip

STEP = 1e-30  # imaginary part: its square vanishes beside 1
ROUNDS = 60  # of Newton's method for a pose, at most
PARTS = (1, 8, 64)  # a change of inputs is divided into so many where it does not settle in fewer
FARTHEST = 0.5  # rad, of a move
SETTLED = 1e-10  # rad, of the last move
SHIFT = 1e-3  # of the stiffest coordinate: a first help where the chain would run away
STABLE = 1e-9  # of the stiffest coordinate: a stable rest has no smaller pivot


class Settling(NamedTuple):
    """What is found of T poses and the start before them, and scratch arrays."""

    x: np.ndarray  # (T + 1, N) coordinates, the start first
    K: np.ndarray  # (T + 1, N, N) minus the slopes of what pulls there, by x
    at: np.ndarray  # (N,) complex, as the others: coordinates of a pose
    last: np.ndarray  # (N,) of the one before
    torque: np.ndarray  # (N + R,) inputs on the way from one to the next
    push: np.ndarray  # (N,) what pulls
    move: np.ndarray  # (N,) of Newton's method
    load: np.ndarray  # (n + 1, 3, 5) of forces on the links, as `add_pose_loads` takes it


def forces_after(x, last, torque, load, body, joints, work, push):
    """Write what pulls at x (N,) at rest, reached from `last` (N,): push (N,), zero in equilibrium, N m.

    `load` (n + 1, 3, 5) is that of forces on the links.
    """
    for i in range(len(x)):
        work.v[i] = x[i] - last[i]
    for r in range(len(body.friction)):
        slip(r, x, work.v, body, work)
    forces_at_rest(x, torque, body, joints, work, push)
    add_pose_loads(load, body, work, push)


def stiffness_at(x, last, torque, load, body, joints, work, K):
    """Write minus the slopes of `forces_after` by x to K (N, N), N m/rad."""
    for j in range(len(x)):
        x[j] = x[j] + complex(0.0, STEP)
        forces_after(x, last, torque, load, body, joints, work, work.a)
        x[j] = x[j] - complex(0.0, STEP)
        for i in range(len(x)):
            K[i, j] = -work.a[i].imag / STEP


def solved(K, shift, push, work, move):
    """Solve (K + shift) move = push for move (N,); return the smallest pivot, which is positive in a stable rest."""
    for i in range(len(push)):
        move[i] = push[i]
        for j in range(len(push)):
            work.B[i, j] = complex(K[i, j], 0.0)
        work.B[i, i] = work.B[i, i] + shift
    eliminate(work.B, move)
    least = 1e300
    for i in range(len(push)):
        least = min(least, work.B[i, i].real)
    return least


def largest_of(values):
    """Return the largest size of the real parts of values (N,)."""
    largest = 0.0
    for i in range(len(values)):
        largest = max(largest, abs(values[i].real))
    return largest


def settle(torque, body, joints, work, found, K):
    """Move found.at (N,) to the rest under `torque` (N + R,), reached from found.last; write K (N, N) there.

    Newton's method; a move that makes matters worse is halved. Returns 1 where a stable rest is found, else 0.
    """
    x, last, push, move = found.at, found.last, found.push, found.move
    forces_after(x, last, torque, found.load, body, joints, work, push)
    for _ in range(ROUNDS):
        before = largest_of(push)
        stiffness_at(x, last, torque, found.load, body, joints, work, K)
        stiffest = 0.0
        for i in range(len(x)):
            stiffest = max(stiffest, abs(K[i, i]))
        shift = 0.0
        while not solved(K, shift, push, work, move) > STABLE * stiffest and shift < 1e6 * stiffest:
            shift = max(4.0 * shift, SHIFT * stiffest)
        far = largest_of(move)
        part = min(1.0, FARTHEST / max(far, 1e-300))
        for i in range(len(x)):
            x[i] = x[i] + part * move[i].real
        forces_after(x, last, torque, found.load, body, joints, work, push)
        if far < SETTLED:
            return 1.0 if shift == 0.0 else 0.0
        while largest_of(push) > before and part > 1e-4:
            part = 0.5 * part
            for i in range(len(x)):
                x[i] = x[i] - part * move[i].real
            forces_after(x, last, torque, found.load, body, joints, work, push)
    return 0.0


def reach(torque, before, parts, body, joints, work, found, K):
    """Move found.at (N,) from found.last to the rest under `torque` (N + R,) while inputs change from `before`.

    They change in so many parts. Returns 1 where a stable rest is found each time, else 0.
    """
    for i in range(len(found.at)):
        found.at[i] = found.last[i]
    good = 1.0
    for part in range(parts):
        for i in range(len(torque)):
            found.torque[i] = before[i] + (part + 1.0) / parts * (torque[i] - before[i])
        good = good * settle(found.torque, body, joints, work, found, K)
    return good


def settle_all(torque, body, joints, work, found):
    """Find the rests under the inputs torque (T + 1, N + R) of all poses, each from the one before; in the first none.

    found.x[0] (N,) is the rest of the first row, where nothing rubs. Returns the index of the first row without a
    stable rest, or -1.
    """
    size = found.x.shape[1]
    for i in range(size):
        found.last[i] = complex(found.x[0, i], 0.0)
    stiffness_at(found.last, found.last, torque[0], found.load, body, joints, work, found.K[0])
    for row in range(1, len(found.x)):
        good = 0.0
        for parts in PARTS:
            if not good > 0.0:
                good = reach(torque[row], torque[row - 1], parts, body, joints, work, found, found.K[row])
        if not good > 0.0:
            return row
        for i in range(size):
            found.x[row, i] = found.at[i].real
            found.last[i] = complex(found.at[i].real, 0.0)
    return -1


def show_all(torque, body, joints, work, found, places, seen):
    """Observe all poses that were found, seen (T + 1, S, 3); imaginary parts of what is given lead to those of it."""
    size = found.x.shape[1]
    for row in range(len(found.x)):
        for i in range(size):
            found.at[i] = complex(found.x[row, i], 0.0)
        if row == 0:
            forces_after(found.at, found.at, torque[row], found.load, body, joints, work, found.push)
        else:
            forces_after(found.at, found.last, torque[row], found.load, body, joints, work, found.push)
        for i in range(size):
            found.push[i] = complex(0.0, found.push[i].imag)
        solved(found.K[row], 0.0, found.push, work, found.move)
        for i in range(size):
            found.at[i] = found.at[i] + found.move[i]
            found.last[i] = found.at[i]
        observe(found.at, joints.base_angle, places, seen[row])
