"""Static poses of a chain in space: one equilibrium under a load, or a sequence of equilibria, each under its own
torques and tendon inputs.

The friction of tendons acts against the motion from one pose to the next and holds a tendon that does not slip, and the
slip elements of the joints stretch with it until they slip. A pose therefore depends on the path that led to it: the
slip directions and the stretches are states. Derivatives are complex steps, so that all
arrays except the resulting poses are complex. The imaginary parts of the inputs give those of the poses by the implicit
function theorem.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pliant.equations.observation import observe
from pliant.equations.spatial_memory import ratio_of, yielded
from pliant.equations.spatial_points import add_pose_loads
from pliant.equations.tendon import drawn_in, eliminate, forces_at_rest

STEP = 1e-30  # imaginary part: its square vanishes beside 1
ROUNDS = 60  # iterations of Newton's method for a pose, at most
PARTS = (1, 8, 64)  # numbers of sub-steps of a change of inputs, tried in turn until one converges
FARTHEST = 0.5  # rad, largest Newton move
SETTLED = 1e-10  # rad, size of a Newton move at convergence
SHIFT = 1e-3  # first diagonal shift of a stiffness matrix that is not positive definite, over its largest entry
TURN = 2e-3  # rad, turn of the joint with the largest lever arm that reverses half of a tendon's friction
STABLE = 1e-9  # smallest pivot of a stable equilibrium, over the largest diagonal entry


class Settling(NamedTuple):
    """Results and scratch arrays of the search for T static poses of a chain, each computed from the one before."""

    x: np.ndarray  # (T + 1, N) coordinates, the start first
    K: np.ndarray  # (T + 1, N, N) stiffness at each pose: minus the derivative of the net force by x
    at: np.ndarray  # (N,) coordinates of the present pose; complex, as are all arrays below
    last: np.ndarray  # (N,) coordinates of the pose before
    torque: np.ndarray  # (N + R,) inputs between two poses
    push: np.ndarray  # (N,) net force
    move: np.ndarray  # (N,) Newton move
    run: np.ndarray  # (R, n + 1) slip directions of R tendons at the pose before
    load: np.ndarray  # (n + 1, 3, 5) forces on the links, as `add_pose_loads` takes them
    stretch: np.ndarray  # (J, T) rad, stretches of J slip elements of the joints' T angles at the pose before
    share: np.ndarray  # (J,) their stiffness, as a fraction of the joint's
    limit: np.ndarray  # (J,) rad, the stretch at which they slip


def slip_on(r, x, found, body, work):
    """Write the slip direction of tendon r at its entry and at n joints to work.run[r] (n + 1,), after the chain has
    moved from found.last (N,) to x (N,). found.run (R, n + 1) are the slip directions at found.last.

    The direction changes with the length drawn in, up to 1 or -1, where the tendon slips. `TURN` times the largest
    lever arm is the length over which it changes by 1. Until it slips, the tendon is held. This is a Prandtl element.
    """
    arm = 1e-30 + 0.0 * x[0]
    for i in range(len(x)):
        work.v[i] = x[i] - found.last[i]
        work.arm[r, i] = body.lever[r, i] + body.chord[r, i] * (x[i] + found.last[i])
        if abs(body.lever[r, i].real) > arm.real:
            arm = body.lever[r, i] if body.lever[r, i].real > 0.0 else -body.lever[r, i]
    for k in range(body.beyond.shape[1]):
        way = found.run[r, k] + drawn_in(r, k, work.v, body, work) / (TURN * arm)
        if way.real > 1.0:
            way = 1.0 + 0.0 * way
        elif way.real < -1.0:
            way = 0.0 * way - 1.0
        work.run[r, k] = way


def stretch_on(j, i, k, ratio, x, found):
    """Return the stretch (two components) [rad] of slip element j at the coordinates i and k of a joint, after the
    chain has moved from found.last (N,) to x (N,). It is scaled back to its limit where the element slips.

    `ratio` is K_k / K_i; a twist has k = i, ratio 0 and the second component 0.
    """
    a = found.stretch[j, i] + x[i] - found.last[i]
    b = 0.0 * a
    if k > i:
        b = found.stretch[j, k] + x[k] - found.last[k]
    part, _, _ = yielded(a, b, ratio, found.limit[j])
    return part * a, part * b


def add_slip(x, found, joints, push):
    """Add the torques [N m] of the joints' slip elements at x (N,) to push (N,), as `forces_after`."""
    n = len(joints.unloaded)
    for j in range(len(found.share)):
        for i in range(0, 2 * n, 2):
            a, b = stretch_on(j, i, i + 1, ratio_of(i, joints), x, found)
            push[i] = push[i] - found.share[j] * joints.K[i] * a
            push[i + 1] = push[i + 1] - found.share[j] * joints.K[i + 1] * b
        for i in range(2 * n, found.stretch.shape[1]):
            a, _ = stretch_on(j, i, i, 0.0 * x[i], x, found)
            push[i] = push[i] - found.share[j] * joints.K[i] * a


def forces_after(x, torque, found, body, joints, work, push):
    """Write the net generalized force on the chain at rest at x (N,) to push (N,) [N m]. The chain has moved there from
    found.last (N,), with the slip directions found.run of its tendons and the stretches found.stretch of its joints.

    Friction opposes this motion. The force is zero in equilibrium. found.load are the forces on the links.
    """
    for r in range(len(body.friction)):
        slip_on(r, x, found, body, work)
    forces_at_rest(x, torque, body, joints, work, push)
    add_pose_loads(found.load, body, work, push)
    add_slip(x, found, joints, push)


def stiffness_at(x, torque, found, body, joints, work, K):
    """Write the stiffness K (N, N) [N m/rad] at the pose x (N,): minus the derivative of the net force at rest by x.

    The net force is that of `forces_after`.
    """
    for j in range(len(x)):
        x[j] = x[j] + complex(0.0, STEP)
        forces_after(x, torque, found, body, joints, work, work.a)
        x[j] = x[j] - complex(0.0, STEP)
        for i in range(len(x)):
            K[i, j] = -work.a[i].imag / STEP


def solved(K, shift, push, work, move):
    """Solve (K + shift I) move = push for move (N,), and return the smallest pivot, which is positive for a positive
    definite matrix.

    The smallest pivot is positive in a stable equilibrium.
    """
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
    """Return the largest absolute real part of values (N,)."""
    largest = 0.0
    for i in range(len(values)):
        largest = max(largest, abs(values[i].real))
    return largest


def settle(torque, body, joints, work, found, K, rounds):
    """Move the pose found.at (N,) to the static equilibrium under `torque` (N + R,): N torques [N m], then the inputs
    [N] of R tendons. Write the stiffness there to K. Return 1 if the equilibrium is stable, else 0.

    found.last (N,) and found.run (R, n + 1) are the pose before and its slip directions. Newton's method, with at most
    `rounds` iterations; a move that increases the residual is halved. Returns 0 also where no equilibrium is found.
    found.push (N,) receives the net force at the last pose; with 0 rounds, that at the given one.
    """
    x, push, move = found.at, found.push, found.move
    forces_after(x, torque, found, body, joints, work, push)
    for _ in range(rounds):
        before = largest_of(push)
        stiffness_at(x, torque, found, body, joints, work, K)
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
        forces_after(x, torque, found, body, joints, work, push)
        if far < SETTLED:
            return 1.0 if shift == 0.0 else 0.0
        while largest_of(push) > before and part > 1e-4:
            part = 0.5 * part
            for i in range(len(x)):
                x[i] = x[i] - part * move[i].real
            forces_after(x, torque, found, body, joints, work, push)
    return 0.0


def reach(torque, before, parts, body, joints, work, found, K):
    """Find the equilibrium after the inputs change from `before` to `torque` in `parts` equal steps, and write it to
    found.at (N,).

    The inputs (N + R,) change in `parts` equal steps. Returns 1 where every step ends in a stable equilibrium, else 0.
    """
    for i in range(len(found.at)):
        found.at[i] = found.last[i]
    good = 1.0
    for part in range(parts):
        for i in range(len(torque)):
            found.torque[i] = before[i] + (part + 1.0) / parts * (torque[i] - before[i])
        good = good * settle(found.torque, body, joints, work, found, K, ROUNDS)
    return good


def settle_all(torque, body, joints, work, found):
    """Find the static pose under each row of `torque` (T + 1, N + R): N torques [N m], then the inputs [N] of R
    tendons. Each search starts from the pose before.

    found.x[0] (N,) is the given equilibrium of the first row, without friction: found.run and found.stretch are 0
    there. Returns the index of the first row without a stable equilibrium, or -1.
    """
    size = found.x.shape[1]
    for i in range(size):
        found.last[i] = complex(found.x[0, i], 0.0)
    stiffness_at(found.last, torque[0], found, body, joints, work, found.K[0])
    for row in range(1, len(found.x)):
        good = 0.0
        for parts in PARTS:
            if not good > 0.0:
                good = reach(torque[row], torque[row - 1], parts, body, joints, work, found, found.K[row])
        if not good > 0.0:
            return row
        move_on(body, joints, work, found)
        for i in range(size):
            found.x[row, i] = found.at[i].real
    return -1


def move_on(body, joints, work, found):
    """Make the pose found.at (N,) the one from which the next is sought: update found.last (N,), found.run and
    found.stretch.
    """
    for r in range(len(body.friction)):
        slip_on(r, found.at, found, body, work)
        for k in range(found.run.shape[1]):
            found.run[r, k] = work.run[r, k]
    n = len(joints.unloaded)
    for j in range(len(found.share)):
        for i in range(0, 2 * n, 2):
            a, b = stretch_on(j, i, i + 1, ratio_of(i, joints), found.at, found)
            found.stretch[j, i] = a
            found.stretch[j, i + 1] = b
        for i in range(2 * n, found.stretch.shape[1]):
            a, _ = stretch_on(j, i, i, 0.0 * found.at[i], found.at, found)
            found.stretch[j, i] = a
    for i in range(len(found.at)):
        found.last[i] = found.at[i]


def show_all(torque, body, joints, work, found, places, seen):
    """Write the positions [m] of the S observed points in all T + 1 static poses to seen (T + 1, S, 3).

    Imaginary parts of the inputs and constants give those of the observed points (derivatives by complex step).
    """
    size = found.x.shape[1]
    for r in range(len(body.friction)):
        for k in range(found.run.shape[1]):
            found.run[r, k] = 0.0
    for j in range(len(found.share)):
        for i in range(found.stretch.shape[1]):
            found.stretch[j, i] = 0.0
    for row in range(len(found.x)):
        for i in range(size):
            found.at[i] = complex(found.x[row, i], 0.0)
            if row == 0:
                found.last[i] = found.at[i]
        forces_after(found.at, torque[row], found, body, joints, work, found.push)
        for i in range(size):
            found.push[i] = complex(0.0, found.push[i].imag)
        solved(found.K[row], 0.0, found.push, work, found.move)
        for i in range(size):
            found.at[i] = found.at[i] + found.move[i]
            if row == 0:
                found.last[i] = found.at[i]
        move_on(body, joints, work, found)
        observe(found.at, joints.base_angle, places, seen[row])
