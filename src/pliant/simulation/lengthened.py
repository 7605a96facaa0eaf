"""Bodies that lengthen: their rest, stiffness and inertia, and the arrays that their kernels work in."""

from __future__ import annotations

import numpy as np

from pliant.equations import extension
from pliant.equations.elastic import joint_torques
from pliant.equations.symbols import ExtensibleBody, ExtensibleWorkspace, Joints
from pliant.mechanics import mechanics_of
from pliant.mechanics.planar import extensible_slopes as slopes
from pliant.mechanics.planar import pull_of, workspace
from pliant.model import Model

Array = np.ndarray
__all__ = ["forces_at_rest", "inertia", "of_joints", "pull_of", "slopes", "stretches", "to_joints", "workspace"]


def inertia(model: Model, x: Array) -> Array:
    """M (n + S, n + S) in absolute angles and strains."""
    return mechanics_of(model).inertia(x)


def stretches(model: Model, x: Array) -> Array:
    """Stretch (..., n + 1) of every link, the part before the first joint first; see `PlanarChain.stretches`."""
    chain = mechanics_of(model)
    made: Array = chain.stretches(x)  # type: ignore[attr-defined]
    return made


def forces_at_rest(x: Array, torque: Array, body: ExtensibleBody, joints: Joints) -> Array:
    """What drive, springs and weight do to angles and strains x (n + S,) of a body that does not move; N m.

    On real or on complex numbers: zero at rest.
    """
    n, still = len(joints.theta0), np.zeros_like(x)
    work = ExtensibleWorkspace(*(a.astype(complex) for a in workspace(n, x.size - n)))
    extension.place(x, still, 0.0, body, joints, work)
    extension.inertial_forces(still, body, work, work.f)
    joint_torques(x, still, joints, torque, 0.0, work.t)
    bending, axial = -np.diff(work.t[: n + 1]), torque[n:] - joints.K[n:] * x[n:]
    return np.concatenate([bending, axial]) - work.f


def to_joints(n: int, size: int) -> Array:
    """T (n + S, n + S) of x = T (q, e) + constant: sums of joint angles, strains as they are."""
    T = np.eye(size)
    T[:n, :n] = np.tri(n)
    return T


def of_joints(n: int, size: int) -> Array:
    """The inverse (n + S, n + S) of `to_joints`: differences of absolute angles, strains as they are."""
    R = np.eye(size)
    R[np.arange(1, n), np.arange(n - 1)] = -1.0
    return R
