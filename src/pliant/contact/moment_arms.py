"""Torques at the joints of a chain from a force at a point of the body that the chain stands for."""

from __future__ import annotations

import numpy as np

from pliant.model import Model, fixed_length
from pliant.numerics.spline import CLAMPED, spline_matrix

Array = np.ndarray


def mean_moment_arm(model: Model, joint: Array, u: Array) -> Array:
    """Moment arm (P,) [m] at `joint` (P,) of a force across a body that bends everywhere, u (P,) [m] beyond the joint.

    The angle between two links of a body weighs its curvature by a hat: up along the link before, or from the base at
    once, and down along the link behind. The mean of max(u, 0) under that hat is the arm, scaled to be the chain's
    own at the tip, as the joint's stiffness was found with the chain.
    """
    l = fixed_length(model).link_length
    tip = np.cumsum(l[::-1])[::-1][joint]
    up, down = np.append(max(model.base_length, 1e-9), l[:-1])[joint], l[joint]

    def moment(u: Array) -> Array:
        v, w = np.maximum(u + up, 0.0), np.maximum(u, 0.0)
        base = np.where(v < up, 0.5 * v**2, up * (v - 0.5 * up))
        rise = np.where(v < up, v**3 / (6.0 * up), up * (0.5 * v - up / 3.0))
        fall = np.where(w < down, 0.5 * w**2 - w**3 / (6.0 * down), down * (0.5 * w - down / 6.0))
        return np.asarray(np.where(joint == 0, base, rise) + fall)

    return np.asarray(tip * moment(u) / moment(tip))


def moment_arms(model: Model, angle: Array, link: Array, along: Array, *, rigid: bool = False) -> Array:
    """Joint torques (T, P, 2, n) of a unit force to the left of the body and of one towards its tip, m.

    Parameters
    ----------
    angle : array (T, n)
        Absolute link angles, rad.
    link, along : arrays (P,)
        Of the points: link, and distance from its joint, m.
    rigid : bool
        Whether the body bends at its joints alone. Otherwise `mean_moment_arm` holds at the joints beside the force.
    """
    l, n = fixed_length(model).link_length, model.n
    ahead = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)  # (T, n, 2)
    joint = np.concatenate([np.zeros((len(angle), 1, 2)), np.cumsum(l[:, None] * ahead, axis=1)], axis=1)[:, :n]
    own = ahead[:, link]
    arm = (joint[:, link] + along[:, None] * own)[:, :, None] - joint[:, None]  # (T, P, n, 2)
    arm = np.where((np.arange(n) <= link[:, None])[..., None], arm, 0.0)
    if not rigid:
        for k, u in ((link, along), (link + 1, along - l[link])):
            here = np.flatnonzero(k < n)
            arm[:, here, k[here]] = mean_moment_arm(model, k[here], u[here])[:, None] * own[:, here]
    sides = (np.stack([-own[..., 1], own[..., 0]], axis=-1), own)
    return np.stack([arm[..., 0] * d[:, :, None, 1] - arm[..., 1] * d[:, :, None, 0] for d in sides], axis=2)


def curve_at(model: Model, angle: Array, arc_length: float) -> tuple[Array, Array]:
    """Point and unit tangent (2,) at an arc length [m] of the cubic spline through the joints, before `bend_sign`."""
    l = fixed_length(model).link_length
    steps = np.concatenate([[[0.0, 0.0]], l[:, None] * np.stack([-np.sin(angle), np.cos(angle)], axis=1)])
    nodes, arc = model.first_joint + np.cumsum(steps, axis=0), model.base_length + np.append(0.0, np.cumsum(l))
    if model.base_length:
        nodes, arc = np.concatenate([[[0.0, 0.0]], nodes]), np.append(0.0, arc)
    if arc.size < 3:
        return np.array([np.interp(arc_length, arc, x) for x in nodes.T]), steps[-1] / l[-1]
    base = np.array([-np.sin(model.base_angle), np.cos(model.base_angle)])
    point, slope = (
        (B @ nodes + w[:, None] * base)[0]
        for B, w in (spline_matrix(arc, [arc_length], CLAMPED, order) for order in (0, 1))
    )
    return point, slope / np.linalg.norm(slope)
