"""The chain at rest, its modes, and the arrays that the kernels work in."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.equations import chain, inertia
from pliant.equations.symbols import ExtensibleWorkspace, Held, Workspace
from pliant.errors import InputError, SimulationError
from pliant.model import Model
from pliant.simulation import lengthened

Array = np.ndarray


def workspace(n: int, kind: type = float) -> Workspace:
    """Scratch arrays of a `kind` of numbers for the kernels of an n-link chain."""
    shapes = ((n, n), (n, n), n, n, n + 1, n, n, n)
    return Workspace(*(np.zeros(shape, dtype=kind) for shape in shapes))


def work_of(model: Model, kind: type = float) -> Workspace | ExtensibleWorkspace:
    """Scratch arrays for the kernels of a model, whether it lengthens or not."""
    return lengthened.workspace(model.n, len(model.extensions), kind) if model.extensions else workspace(model.n, kind)


def held(model: Model) -> Held:
    """Scratch arrays for the steps of a model with memory."""
    joints = model.joints()
    size = {name: model.size if name in ("phi", "w") else model.n for name in Held._fields if name != "springs"}
    rows = {name: np.zeros(length) for name, length in size.items()}
    rows |= {"K": joints.K.copy(), "theta0": joints.theta0.copy()}
    springs = joints._replace(theta0=rows["theta0"], K=rows["K"])
    return Held(springs=springs, **rows)


def relaxed(model: Model, q: Array) -> Array:
    """States (n, branches) of a memory long at rest at the joint angles q: creep relaxed, the others unstretched."""
    memory = model.memory
    creep = len(memory.creep_share)
    states = np.zeros((model.n, creep + len(memory.slip_share) + 1))
    states[:, :creep] = q[: model.n, None]
    return states


def absolute(model: Model, q: Array) -> Array:
    """Absolute link angles (n,) of the joint angles q (n,); strains behind them, (n + S,), stay as they are."""
    phi = np.array(q, dtype=float)
    chain.absolute_angles(phi[: model.n].copy(), model.rest_angle, model.base_angle, phi[: model.n])
    return phi


def relative(model: Model, x: Array) -> Array:
    """Joint angles with strains behind them (n + S,), of absolute link angles and strains; undoes `absolute`."""
    return np.append(joint_angles(model, x), x[model.n :]) if model.extensions else joint_angles(model, x)


def joint_angles(model: Model, phi: Array) -> Array:
    """Joint angles (..., n) of absolute link angles (..., n), with or without strains behind them."""
    return np.diff(phi[..., : model.n], axis=-1, prepend=model.base_angle) - model.rest_angle


def joint_rates(w: Array) -> Array:
    """Joint rates (..., n) of absolute link rates (..., n)."""
    return np.diff(w, axis=-1, prepend=0.0)


def absolute_rates(model: Model, dq: Array) -> Array:
    """Absolute link rates (n,) of joint rates (n,); rates of strains behind them stay as they are."""
    return np.append(np.cumsum(dq[: model.n]), dq[model.n :])


def vector(model: Model, value: Any) -> Array:
    """`value` as n finite numbers, or n + S where segments lengthen."""
    a = np.asarray(value, dtype=float)
    if a.shape != (model.size,) or not np.isfinite(a).all():
        strains = f", then {len(model.extensions)} strain(s)" if model.extensions else ""
        raise InputError(f"expected {model.size} finite numbers, one for each joint{strains}, got {value!r:.80}")
    return a


def equilibrium(
    model: Model, pressure: float | Array = 0.0, tip_force: Array | None = None, link_load: Array | None = None,
) -> Array:
    """Joint angles (n,) at rest under constant `pressure` [Pa], gravity and a force at the last tip, rad.

    Paper: Eq. (5) [eq:eom] without motion.

    Parameters
    ----------
    model : Model
    pressure : float, Pa gauge; an array (C,) where there are several chambers
    tip_force : array (2,)
        Force on the last tip in the base frame, N; none by default.
    link_load : array (n, 2)
        Loads of forces at other points, N m: what each link carries, times the force, before `bend_sign` is applied.
        Of a body that lengthens (n + 1, 4), see `pliant.simulation.forces.link_loads`.

    Returns
    -------
    array (n,)
        Stable equilibrium, by Newton's method with the exact tangent, reached from the unloaded shape. Of a body that
        lengthens (n + S,), the strains of its segments behind the joint angles.

    Raises
    ------
    SimulationError
        When no stable equilibrium is found: the load buckles the chain, or the chamber's wall gives way.
    InputError
        When the pressure or the force is not finite.
    """
    joints = model.joints()
    force = np.zeros(2) if tip_force is None else np.asarray(tip_force, dtype=float) * [model.bend_sign, 1]
    if not (np.isfinite(pressure).all() and np.isfinite(force).all()):
        raise InputError(f"rest needs a finite pressure (Pa) and tip force (N), got {pressure} and {tip_force}")
    torque = model.actuation.joint_torques(pressure)
    if not np.isfinite(torque).all():
        raise SimulationError(model.actuation.no_rest(pressure))
    q = spring_angle(model, torque[: model.n])
    if model.extensions:
        return lengthened.rest(model, np.append(q, torque[model.n :] / joints.K[model.n :]), torque, force, link_load)
    body = model.body()
    load = np.outer(body.h, [body.gx, body.gy]) + np.outer(model.link_length, force)
    load = load if link_load is None else load + link_load
    if not load.any():
        return q

    def residual(q: Array, share: float) -> tuple[Array, Array]:
        phi = absolute(model, q)
        c, s = np.cos(phi), np.sin(phi)
        g = share * (load[:, 0] * c + load[:, 1] * s)
        slope = share * (load[:, 1] * c - load[:, 0] * s)
        tail = np.cumsum(slope[::-1])[::-1]
        K = np.diag(tangents(model, q)) + tail[np.maximum.outer(np.arange(model.n), np.arange(model.n))]
        return torque - (joints.K + (joints.K2 + joints.K3 * q) * q) * q - np.cumsum(g[::-1])[::-1], K

    return lengthened.loaded_rest(residual, q, float(np.abs(joints.K).max()))


def tangents(model: Model, q: Array) -> Array:
    """Slopes (..., n) of the springs K q (1 + s q + a q^2) at joint angles (..., n), N m/rad."""
    return np.asarray(model.stiffness * (1.0 + (2.0 * model.stiffening + 3.0 * model.cubic_stiffening * q) * q))


def spring_angle(model: Model, torque: Array) -> Array:
    """Joint angles (n,) at which the springs alone hold `torque` (n,) [N m], on the branch that begins at 0.

    Raises
    ------
    SimulationError
        When softening springs cannot hold it.
    """
    x = np.asarray(torque / model.stiffness)
    q = bend(x, model.stiffening, model.cubic_stiffening)
    if not np.isfinite(q).all():
        i = int(np.argmin(np.isfinite(q)))
        most = model.stiffness[i] * softest_bend(x, model.stiffening, model.cubic_stiffening)[1][i]
        raise SimulationError(
            f"the spring of joint {i + 1}, which softens with its angle, holds at most "
            f"{np.copysign(most, torque[i]):.4g} N m, but {torque[i]:.4g} N m bend it: lower the "
            "pressure or the size of the stiffening"
        )
    return q


def bend(x: Array, s: Array, a: Array) -> Array:
    """Solution q, from 0 on without a turn, of q (1 + s q + a q^2) = x; not a number where there is none."""
    root = 1.0 + 4.0 * s * x
    with np.errstate(invalid="ignore"):
        q = np.where(root > 0, x * (2.0 / (1.0 + np.sqrt(root))), np.nan)
    if not np.any(a):
        return q
    turn, most = softest_bend(x, s, a)
    size, s = np.abs(x), np.sign(x) * s
    low, high = np.zeros_like(q), np.minimum(turn, 4.0 * size)  # a spring that never softens to nothing: x > q/4
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = middle * (1.0 + (s + a * middle) * middle) < size
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.where(size < most, np.sign(x) * 0.5 * (low + high), np.nan)


def softest_bend(x: Array, s: Array, a: Array) -> tuple[Array, Array]:
    """Size of q at which the slope 1 + 2 s q + 3 a q^2 falls to 0 on the side of x, and the size of x there."""
    s = np.sign(x) * s
    inside = s * s - 3.0 * a
    inverse = np.where(inside > 0, np.sqrt(np.maximum(inside, 0.0)) - s, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        q = np.where(inverse > 0, 1.0 / inverse, np.inf)
        most = np.where(inverse > 0, q * (1.0 + (s + a * q) * q), np.inf)
    return q, most


def given_way(model: Model, phi: Array, least: float = 0.0) -> str:
    """A sentence on the first spring whose slope falls to a share `least` of K at angles phi (n,), or an empty one."""
    q = joint_angles(model, phi)
    lost = np.flatnonzero(tangents(model, q) <= least * model.stiffness)
    if not lost.size:
        return ""
    i = int(lost[0])
    cubic = f"and {model.cubic_stiffening[i]:.4g} 1/rad^2 " if model.cubic_stiffening[i] else ""
    return (
        f"the spring of joint {i + 1} has softened to nothing at {q[i]:.4g} rad, beyond what the stiffening of "
        f"{model.stiffening[i]:.4g} 1/rad {cubic}describes: lower the pressure or the size of the stiffening"
    )


def first_given_way(model: Model, times: Array, phi: Array) -> str:
    """As `given_way`, of a trajectory (T, n) at `times` [s], with the time."""
    lost = np.flatnonzero((tangents(model, joint_angles(model, phi)) <= 0).any(axis=1))
    return f"{times[lost[0]] - times[0]:.6g} s after the start {given_way(model, phi[lost[0]])}" if lost.size else ""


def modes(model: Model, q: Array | None = None) -> tuple[Array, Array]:
    """Undamped natural frequencies [Hz] and damping ratios (n,), ascending, of small motions about `q` (default: rest).

    Of a body that lengthens there are n + S, those of its strains among them.

    The damping ratio is that of the modal diagonal of D: exact where D is proportional to K. Memory adds its stiffness
    as before it gives way: creep has no time to flow, slip elements stick. Paper: Eq. (5) [eq:eom], linearised.

    Parameters
    ----------
    model : Model
    q : (n,) array, rad, optional
        Joint angles of the shape, with strains behind them where segments lengthen.

    Raises
    ------
    SimulationError
        When the chain is not stable at this shape, or no equilibrium is found.
    """
    q = equilibrium(model) if q is None else vector(model, q)
    M, K = linear_parts(model, q)
    L = np.linalg.cholesky(M)
    inverse = np.linalg.inv(L)
    squared, V = np.linalg.eigh(inverse @ K @ inverse.T)
    if squared[0] <= 0:
        raise SimulationError("the chain is not stable at this shape: it has no frequency of oscillation there")
    omega = np.sqrt(squared)
    modal = inverse.T @ V
    damping = np.einsum("ik,i,ik->k", modal, model.joints().D, modal)
    return omega / (2 * np.pi), damping / (2 * omega)


def linear_parts(model: Model, q: Array) -> tuple[Array, Array]:
    """Inertia and stiffness (n, n) in joint angles at q (n,); (n + S, n + S) of a body that lengthens."""
    x, joints, n = absolute(model, q), model.joints(), model.n
    X, stiffness = absolute_inertia(model, x), tangents(model, q[:n]) + joints.K[:n] * model.memory.instantaneous
    if model.extensions:
        T = lengthened.to_joints(n, model.size)
        _, slope = lengthened.dead_loads(model, x, lengthened.link_loads(model, np.zeros(2), None))
        return T.T @ X @ T, np.diag(np.append(stiffness, joints.K[n:])) - T.T @ slope @ T
    body, c, s, M = model.body(), np.cos(x), np.sin(x), np.empty((n, n))
    inertia.to_joint_angles(X, M)
    tail = np.cumsum((body.h * (body.gy * c - body.gx * s))[::-1])[::-1]
    return M, np.diag(stiffness) + tail[np.maximum.outer(np.arange(n), np.arange(n))]


def absolute_inertia(model: Model, x: Array) -> Array:
    """Inertia (n, n) in absolute link angles; (n + S, n + S) of a body that lengthens."""
    if model.extensions:
        return lengthened.inertia(model, x)
    body, M = model.body(), np.empty((model.n, model.n))
    inertia.inertia_absolute(np.cos(x), np.sin(x), body.B, body.I, M)
    return M


def tips(model: Model, phi: Array) -> Array:
    """Link tips (..., n, 2) of absolute link angles (..., n), with strains behind them, in the model's frame, m."""
    first, length = model.first_joint, model.link_length
    if model.extensions:
        stretch = lengthened.stretches(model, phi)
        first, length, phi = first * stretch[..., :1], length * stretch[..., 1:], phi[..., : model.n]
    x = -np.cumsum(length * np.sin(phi), axis=-1) + first[..., :1]
    y = np.cumsum(length * np.cos(phi), axis=-1) + first[..., 1:]
    return np.stack([model.bend_sign * x, y], axis=-1)


def stations(model: Model, phi: Array, ends: Array | None = None) -> tuple[Array, Array]:
    """Positions (..., S, 2) [m] and angles (..., S) [rad] of the model's observed points; `ends` are known `tips`."""
    ends = tips(model, phi) if ends is None else ends
    stretch = lengthened.stretches(model, phi) if model.extensions else np.ones((*phi.shape[:-1], model.n + 1))
    joints = np.concatenate(
        [np.broadcast_to([0.0, 0.0], (*phi.shape[:-1], 1, 2)),
         stretch[..., :1, None] * model.first_joint,
         ends[..., :-1, :] * [model.bend_sign, 1]], axis=-2,
    )
    angles = np.concatenate([np.full((*phi.shape[:-1], 1), model.base_angle), phi[..., : model.n]], axis=-1)
    carrier = np.array([p.link + 1 for p in model.points])
    along = np.array([p.along for p in model.points]) * stretch[..., carrier]
    across = np.array([p.across for p in model.points])
    a = angles[..., carrier]
    x = joints[..., carrier, 0] - along * np.sin(a) - across * np.cos(a)
    y = joints[..., carrier, 1] + along * np.cos(a) - across * np.sin(a)
    return np.stack([model.bend_sign * x, y], axis=-1), model.bend_sign * a
