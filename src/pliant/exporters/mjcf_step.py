"""The largest time step at which MuJoCo simulates an exported chain stably, from its stiffest mode."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Model

Array = np.ndarray
USUAL = 1e-3  # s
MARGIN = 2.0  # ratio of the longest stable step to the chosen one, for springs that stiffen
SHORTEST = 2.0**-7 * USUAL  # s


class Hidden(NamedTuple):
    """Constants of the hidden hinges of one creep or slip element: each joint has one, tied to it by a spring."""

    share: float  # stiffness as a fraction of the joint's
    time: float  # s, relaxation time of its damper; 0: held by dry friction
    inertia: float  # kg m^2


class HingeChain(NamedTuple):
    """Linearised equation of motion of an exported chain about its rest shape, M a + D v + K q = 0."""

    M: Array  # (N, N)
    D: Array  # (N, N)
    K: Array  # (N, N)
    late: Array  # (N, N) dampers of D that are not at a joint: Euler takes them at the beginning of a step


def linear_chain(model: Model, hidden: list[Hidden]) -> HingeChain:
    """Return the inertia, damping and stiffness matrices of an exported chain's joints and hidden hinges.

    A hidden hinge that dry friction holds counts as a spring.
    """
    n, moving = model.size, [h for h in hidden if h.time]
    N = n * (1 + len(moving))
    mechanics = mechanics_of(model)
    turn, joints = mechanics.from_joints, np.arange(n)
    stiffness = np.array(mechanics.joints.K)
    M, D, K = np.zeros((N, N)), np.zeros((N, N)), np.zeros((N, N))
    M[:n, :n] = turn.T @ mechanics.inertia(mechanics.coordinates(np.zeros(n))) @ turn
    D[joints, joints] = mechanics.joints.D
    remembering = joints < mechanics.remembering
    K[joints, joints] = stiffness * (1.0 + sum(h.share for h in hidden) * remembering)
    for tendon, lever in zip(model.chambers, model.actuation.gain, strict=True):
        K[:n, :n] += tendon.line_stiffness * np.outer(lever, lever)
    for b, (share, time, inertia) in enumerate(moving):
        rows, spring = joints + (b + 1) * n, share * stiffness * remembering
        M[rows, rows], D[rows, rows], K[rows, rows] = np.where(remembering, inertia, 1.0), spring * time, spring
        K[rows, joints] = K[joints, rows] = -spring
    late = np.zeros((N, N))
    late[joints, joints] = np.where(joints < n - len(model.extensions), 0.0, mechanics.joints.D)
    return HingeChain(M, D, K, late)


def bounded_by(chain: HingeChain, integrator: str) -> Callable[[float], bool]:
    """Return a function that takes a time step [s] and returns whether MuJoCo's integrator is stable for the chain at
    this step.

    MuJoCo's Euler and implicit methods evaluate dampers at the end of the step and springs at its beginning: (M + h D)
    q_2 - (2 M + h D - h^2 K) q_1 + M q_0 = 0, which is stable while 4 M + 2 h D - h^2 K is positive definite. Dampers
    at the beginning, which are late, count with the other sign. RK4 multiplies the mode of eigenvalue s by the
    fourth-order Taylor polynomial of exp(h s).
    """
    M, D, K, late = chain
    if integrator != "RK4":
        end = D - 2.0 * late if integrator == "Euler" else D
        return lambda h: is_definite(4.0 * M + 2.0 * h * end - h**2 * K)
    inverse = np.linalg.inv(M)
    zero, identity = np.zeros_like(M), np.eye(len(M))
    roots = np.linalg.eigvals(np.block([[zero, identity], [-inverse @ K, -inverse @ D]]))

    def stays(h: float) -> bool:
        z = h * roots
        return bool(np.abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0)))).max() < 1.0 + 1e-9)

    return stays


def is_definite(a: Array) -> bool:
    """Return whether a symmetric matrix is positive definite."""
    try:
        np.linalg.cholesky(a)
    except np.linalg.LinAlgError:
        return False
    return True


def checked_step(chain: HingeChain, integrator: str, time_step: float) -> float:
    """Return a time step [s] at which MuJoCo is stable: `time_step` or, if it is 0, a suitable one with a margin.

    The steps tried are 1 ms, 0.5 ms, and so on.

    Raises
    ------
    InputError
        When the simulation is unstable at the given step, or at every step tried.
    """
    stays = bounded_by(chain, integrator)
    if time_step > 0 and stays(time_step):
        return time_step
    chosen = USUAL
    while not stays(MARGIN * chosen):
        chosen *= 0.5
        if chosen < SHORTEST:
            raise InputError(
                f"mjcf: with integrator={integrator} this chain is unstable at all time steps down to "
                f"{1e6 * SHORTEST:.2g} us: use integrator=implicitfast, or a model with fewer links"
            )
    if time_step > 0:
        raise InputError(
            f"mjcf: with integrator={integrator} and time_step={time_step:g} s this chain is unstable: use "
            f"time_step={chosen:g}, or leave it out"
        )
    return chosen
