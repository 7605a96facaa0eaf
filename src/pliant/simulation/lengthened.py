"""Bodies that lengthen: their rest, stiffness and inertia, and the arrays that their kernels work in."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pliant.equations import extension
from pliant.equations.elastic import LEAST_STRETCH, joint_torques
from pliant.equations.symbols import ExtensibleBody, ExtensibleWorkspace, Joints, Slopes
from pliant.errors import SimulationError
from pliant.model import Model, fixed_length
from pliant.model.extension import extensible_body

Array = np.ndarray
NEAR = 1e-6  # rad and strains: where a rest under part of a load is near enough to go on from
TINY = 1e-20  # imaginary step: its square vanishes beside 1


def workspace(n: int, segments: int, kind: type = float) -> ExtensibleWorkspace:
    """Scratch arrays of a `kind` of numbers for the kernels of n links, so many segments of which lengthen."""
    N = n + segments
    shapes = {"A": (N, N), "t": (N + 1,), **dict.fromkeys(("stretch", "ax", "ay", "bx", "by"), (n + 1,))}
    return ExtensibleWorkspace(*(np.zeros(shapes.get(f, (N,)), dtype=kind) for f in ExtensibleWorkspace._fields))


def of_rows(model: Model, rows: int) -> ExtensibleWorkspace:
    """Scratch arrays for kernels that take many moments (n + S, T) at once."""
    return ExtensibleWorkspace(*(np.zeros((*a.shape, rows)) for a in workspace(model.n, len(model.extensions))))


def inertia(model: Model, x: Array) -> Array:
    """M (n + S, n + S) in absolute angles and strains."""
    body, work = extensible_body(model), workspace(model.n, len(model.extensions))
    M = np.zeros((model.size, model.size))
    extension.place(x, 0.0 * x, 0.0, body, model.joints(), work)
    extension.inertia(body, work, M)
    return np.asarray(M + np.tril(M, -1).T)


def stretches(model: Model, x: Array) -> Array:
    """Stretch (..., n + 1) of every link of a body that lengthens, the part before the first joint first.

    Raises
    ------
    InputError
        When `x` (..., n) brings no strains.
    """
    if x.shape[-1] != model.size:
        fixed_length(model)  # who follows angles alone cannot follow this body
    return np.asarray(1.0 + x[..., model.n :] @ model.stretch_share.T)


def link_loads(model: Model, tip_force: Array, link_load: Array | None) -> Array:
    """Weight and forces (n + 1, 4) that pull at each link, N m, as `extension.add_link_loads` takes them."""
    body = extensible_body(model)
    along = np.outer(body.h, [body.gx, body.gy]) + np.outer(body.l, tip_force)
    load = np.concatenate([along, np.zeros_like(along)], axis=1)
    return load if link_load is None else load + link_load


def dead_loads(model: Model, x: Array, load: Array) -> tuple[Array, Array]:
    """Generalised forces (n + S,) of loads (n + 1, 4) of the links at x, and their slope (n + S, n + S).

    In absolute angles; a load does not turn with the body: its potential is -sum_k (st_k L_k + R_k) . e(phi_k).
    """
    n, share = model.n, model.stretch_share
    c, s, whole = stretched_loads(x, load, share, model.base_angle)
    slope = np.zeros((x.size, x.size))
    slope[np.arange(n), np.arange(n)] = (whole[:, 0] * s - whole[:, 1] * c)[1:]
    slope[:n, n:] = (share * -(load[:, 0] * c + load[:, 1] * s)[:, None])[1:]
    slope[n:, :n] = slope[:n, n:].T
    return pull_of(x, load, share, model.base_angle), slope


def pull_of(x: Array, load: Array, share: Array, base_angle: Any) -> Array:
    """Generalised forces (n + S,) of loads (n + 1, 4) at x, in absolute angles; also of complex ones."""
    c, s, whole = stretched_loads(x, load, share, base_angle)
    turning = -(whole[:, 0] * c + whole[:, 1] * s)
    return np.concatenate([turning[1:], share.T @ (load[:, 1] * c - load[:, 0] * s)])


def stretched_loads(x: Array, load: Array, share: Array, base_angle: Any) -> tuple[Array, Array, Array]:
    """Cosines and sines (n + 1,) of the links at x, and their loads with the stretch counted (n + 1, 2), N m."""
    n = x.size - share.shape[1]
    angle = np.append(base_angle, x[:n])
    whole = (1.0 + share @ x[n:])[:, None] * load[:, :2] + load[:, 2:]
    return np.cos(angle), np.sin(angle), whole


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


def slopes(x: Array, v: Array, torque: Array, body: Any, joints: Joints, work: Any, out: Slopes) -> None:
    """Acceleration and its derivatives by x and v, row by variable, by complex steps through the kernel's own text.

    As `motion.acceleration_jacobian`; `work.A` keeps the factors of M.
    """
    scratch = ExtensibleWorkspace(*(a.astype(complex) for a in work))
    for rates, rows in enumerate((out.a_phi, out.a_w)):
        for k in range(x.size):
            here, rate, moved = x.astype(complex), v.astype(complex), np.empty(x.size, dtype=complex)
            (rate if rates else here)[k] += 1j * TINY
            extension.acceleration(here, rate, torque, body, joints, scratch, moved)
            rows[k], out.a[:] = moved.imag / TINY, moved.real
    work.A[:] = scratch.A.real


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


def rest(model: Model, q: Array, torque: Array, force: Array, link_load: Array | None) -> Array:
    """As `state.equilibrium`, of a body that lengthens, from the joint angles and strains q (n + S,) without load."""
    joints, n = model.joints(), model.n
    load, T = link_loads(model, force, link_load), to_joints(n, model.size)
    K2, K3, unloaded = np.zeros((3, model.size))
    K2[:n], K3[:n], unloaded[:n] = joints.K2, joints.K3, model.base_angle + np.cumsum(model.rest_angle)

    def residual(q: Array, share: float) -> tuple[Array, Array]:
        pull, slope = dead_loads(model, T @ q + unloaded, share * load)
        tangent = joints.K + (2.0 * K2 + 3.0 * K3 * q) * q
        return torque - (joints.K + (K2 + K3 * q) * q) * q + T.T @ pull, np.diag(tangent) - T.T @ slope @ T

    found = loaded_rest(residual, q, float(joints.K.max())) if load.any() else q
    if (1.0 + model.stretch_share @ found[n:] <= LEAST_STRETCH).any():
        raise SimulationError("a segment is pressed to nothing: raise its axial stiffness, or lower the load")
    return found


def loaded_rest(residual: Callable[[Array, float], tuple[Array, Array]], q: Array, stiffest: float) -> Array:
    """The rest under a load that grows from nothing, from the rest q without it; see `state.equilibrium`."""
    for share in (0.25, 0.5, 0.75, 1.0):  # the load grows in parts, so that a long fall stays on its branch
        for _ in range(50):
            r, K = residual(q, share)
            move = np.linalg.lstsq(K, r)[0]  # at the very load that buckles, K is singular
            size = np.abs(move).max()
            q = q + move * min(1.0, 0.5 / max(size, 1e-300))
            if size < (1e-13 if share == 1.0 else NEAR):
                break
    r, K = residual(q, 1.0)
    if not np.isfinite(q).all() or np.abs(r).max() > 1e-9 * stiffest or np.linalg.eigvalsh(K).min() <= 0:
        raise SimulationError(
            "the chain finds no stable rest under its load: it buckles; raise the stiffness or lower the load"
        )
    return q
