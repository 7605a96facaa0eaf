"""Force and moment that the base exerts on a chain, from its motion: Newton and Euler for the whole body."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pliant.mechanics.complex_slopes import TINY
from pliant.model import Station
from pliant.model.extensible import extensible_inertia
from pliant.numerics.curve import tangents

Array = np.ndarray


class BaseTwist(NamedTuple):
    """Motion of a base at T instants, in its own axes."""

    gravity: Array  # (T, d) m/s^2
    velocity: Array  # (T, d) m/s, of the origin
    acceleration: Array  # (T, d) m/s^2
    rate: Array  # (T,) rad/s about +z in the plane, (T, 3) in space
    turning: Array  # (T,) or (T, 3) rad/s^2


def point_carried(chain: Any) -> Array:
    """Return the position (2,) [m] of the point of the base of a planar chain whose acceleration acts on the links as
    weight does: the first joint, or the origin if the part before it may lengthen.
    """
    return np.asarray(chain.model.first_joint * (not chain.model.extensions))


def planar_reaction(chain: Any, x: Array, v: Array, a: Array, base: BaseTwist) -> tuple[Array, Array]:
    """Return the force (T, 2) [N] and the moment (T, 1) [N m] about the origin that the base exerts on a planar chain
    at coordinates x, rates v and accelerations a (T, N), in the axes of the base.

    v and a are relative to the base. With u_k = st_k e(phi_k), the body's first moment is sum_k h_k u_k and its moment
    of momentum sum_kl B_kl u_k x u'_l, plus that of the payload's turn.
    """
    (B, h), n, share = extensible_inertia(chain.model), chain.n, chain.stretch_share
    angle = np.column_stack([np.full(len(x), chain.joints.base_angle), x[:, :n]])
    rate, turning = (np.column_stack([about_links, about_links[:, None] + inner[:, :n]])
                     for about_links, inner in ((base.rate, v), (base.turning, a)))  # fmt: skip
    stretch, growth, growing = 1.0 + x[:, n:] @ share.T, v[:, n:] @ share.T, a[:, n:] @ share.T
    ahead = tangents(angle)
    aside = np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1)
    u = stretch[..., None] * ahead
    across = 2.0 * growth * rate + stretch * turning
    second = (growing - stretch * rate**2)[..., None] * ahead + across[..., None] * aside
    lifted = base.acceleration - base.gravity
    force = chain.model.mass * lifted + np.einsum("k,tki->ti", h, second)
    moment = np.sum(cross(u, np.einsum("kl,tli->tki", B, second)), axis=1) + chain.model.tip_inertia * turning[:, n]
    return force, (moment + cross(np.einsum("k,tki->ti", h, u), lifted))[:, None]


def cross(a: Array, b: Array) -> Array:
    """Return the products a x b (...) of plane vectors (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def spatial_reaction(chain: Any, x: Array, v: Array, a: Array, base: BaseTwist) -> tuple[Array, Array]:
    """Return the force (T, 3) [N] and the moment (T, 3) [N m] about the origin that the base exerts on a chain in space
    at coordinates x, rates v and accelerations a (T, N), in the axes of the base.

    They are the rates of momentum and of moment of momentum, less the weight. The rates are complex steps along the
    motion.
    """
    moved = [value + 1j * TINY * slope for value, slope in (
        (x, v), (v, a), (base.rate, base.turning),
        (base.velocity, base.acceleration - np.cross(base.rate, base.velocity)),
    )]  # fmt: skip
    P, L, first = momenta(chain, *moved)
    dP, dL = P.imag / TINY, L.imag / TINY
    P, L, first = P.real, L.real, first.real
    weight = chain.body.mass.sum() * base.gravity
    force = dP + np.cross(base.rate, P) - weight
    moment = dL + np.cross(base.rate, L) + np.cross(base.velocity, P) - np.cross(first, base.gravity)
    return force, moment


def momenta(chain: Any, x: Array, v: Array, rate: Array, velocity: Array) -> tuple[Array, Array, Array]:
    """Return momentum (T, 3) [N s], moment of momentum about the origin (T, 3) [N m s] and first moment of mass (T, 3)
    [kg m] of a chain in space, in the axes of the base. All arguments may be complex.
    """
    body, n = chain.body, chain.n
    work = chain.posed(x)
    axes, R = np.moveaxis(work.S, -1, 0), np.moveaxis(work.R, -1, 0)
    joint = np.append(np.repeat(np.arange(n), 2), np.tile(np.arange(n), axes.shape[1] // n - 2))
    P, L, first = (np.zeros(velocity.shape, dtype=complex) for _ in range(3))
    for k in range(n):
        z = R[:, k + 1, :, 2]
        centre = np.moveaxis(work.r[k + 1], -1, 0) + work.centre[k][:, None] * z
        slope = chain.position_jacobian(x, Station("", k, float(body.centre[k])))
        speed = velocity + np.cross(rate, centre) + np.einsum("tij,tj->ti", slope, v)
        turn = rate + np.einsum("tji,tj->ti", axes[:, joint <= k], v[:, : joint.size][:, joint <= k])
        along = np.sum(turn * z, axis=1, keepdims=True)
        spin = work.lateral[k][:, None] * (turn - along * z) + body.axial[k] * along * z
        P, first = P + body.mass[k] * speed, first + body.mass[k] * centre
        L = L + body.mass[k] * np.cross(centre, speed) + spin
    return P, L, first


def accelerations(chain: Any, x: Array, v: Array, torque: Array, base: BaseTwist) -> Array:
    """Return the accelerations (T, N) of a chain at coordinates x and rates v (T, N), all relative to its moving base.
    `torque` (T, N + R) holds the torques of its joints and the inputs of R tendons.
    """
    chain = chain.with_own_base()
    (body, joints, work), kernel, a = chain.parts(), chain.acceleration(), np.zeros(chain.size)
    turns = slice(0, chain.n) if chain.dimension == 2 else slice(0, 0)
    lifted, out = chain.base_weight(base), np.empty(x.shape)
    for t in range(len(x)):
        now = dict(zip(("gx", "gy", "gz"), lifted[t].tolist(), strict=False))
        rates = v[t].copy()
        rates[turns] += base.rate[t] if chain.dimension == 2 else 0.0
        (joints if chain.dimension == 2 else body).spin[:] = base.rate[t], base.turning[t]
        kernel(x[t].copy(), rates, torque[t].copy(), body._replace(**now), joints, work, a)
        out[t] = a
        out[t, turns] -= base.turning[t] if chain.dimension == 2 else 0.0
    return out

