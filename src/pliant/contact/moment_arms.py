"""Joint torques of a chain under a force at a point of the continuous body that the chain represents."""

from __future__ import annotations

import numpy as np

from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.numerics.spline import CLAMPED, spline_matrix

Array = np.ndarray


def mean_moment_arm(model: Model, joint: Array, u: Array) -> Array:
    """Return the moment arm (P,) [m] of each of P forces about the joint with the index `joint` (P,). The forces are
    perpendicular to a continuously bending body.

    The force acts at u (P,) [m] beyond the joint, on the unstretched body. The angle between two links is a weighted
    mean of the body's curvature, with a hat function: it rises along the link before (at the base, at once) and falls
    along the link after. The arm is the mean of max(u, 0) under the hat, scaled to equal that of the chain at the tip,
    since the joint's stiffness was identified with the chain.
    """
    l = model.link_length
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
    """Return the moment arms (T, P, 2, n) [m] of forces at P points of the body about n joints, in T frames: the joint
    torques per newton of a force to the left of the body, and of one towards its tip.

    For an extensible body (T, P, 2, n + S), followed by the generalised forces of the strains. In space (T, P, 3, N),
    for unit forces along the link's axes x and y and along the link, by all coordinates.

    Source: virtual work, as `equations.extension.add_link_loads`

    Parameters
    ----------
    angle : array (T, n)
        Absolute link angles, rad; (T, n + S) for an extensible body, followed by its strains; in space (T, N),
        coordinates.
    link, along : arrays (P,)
        Link index of each point, and its distance from the link's joint on the unstretched link, m.
    rigid : bool
        Whether the body bends at its joints only. Otherwise `mean_moment_arm` holds at the two joints next to the
        force, times the stretch of the force's link.
    """
    n, chain = model.n, mechanics_of(model)
    stretch, frames = chain.stretches(angle), chain.link_frames(angle)
    directions = frames[..., -1]
    l, part = stretch[:, 1:] * model.link_length, stretch[:, 1 + link]  # (T, n), (T, P)
    ahead = directions[:, 1:]  # (T, n, d)
    ends = np.cumsum(l[..., None] * ahead, axis=1)
    joint = np.concatenate([np.zeros_like(ends[:, :1]), ends], axis=1)[:, :n]
    own = ahead[:, link]
    arm = (joint[:, link] + (part * along)[..., None] * own)[:, :, None] - joint[:, None]  # (T, P, n, d)
    arm = np.where((np.arange(n) <= link[:, None])[..., None], arm, 0.0)
    if not rigid:
        for k, u in ((link, along), (link + 1, along - model.link_length[link])):
            here = np.flatnonzero(k < n)
            lever = part[:, here] * mean_moment_arm(model, k[here], u[here])
            arm[:, here, k[here]] = lever[..., None] * own[:, here]
    turning = chain.turning_moments(angle, arm, frames[:, 1 + link])  # (T, P, d, turns)
    stretching = np.einsum("tpsa,tpak->tpks", growth(model, directions, link, along), frames[:, 1 + link])
    return np.concatenate([turning, stretching], axis=-1)


def growth(model: Model, directions: Array, link: Array, along: Array) -> Array:
    """Return the displacement (T, P, S, d) [m] of P points per unit strain of each of S segments, over T frames in d
    dimensions.
    """
    rows = np.arange(-1, model.n)
    length = np.append(model.base_length, model.link_length)
    way = np.where(rows < link[:, None], length, np.where(rows == link[:, None], along[:, None], 0.0))  # (P, n + 1)
    return np.einsum("pk,ks,tka->tpsa", way, model.stretch_share, directions)


def curve_at(model: Model, angle: Array, arc_length: float) -> tuple[Array, Array]:
    """Return the point [m] at an arc length [m] of the smooth curve through the joints, and the unit tangent there.
    Both have the shape (2,), in space (3,).

    The curve is a cubic spline. For an extensible body, `angle` (n + S,) ends with its strains, and the arc length is
    on the unstretched body.
    """
    chain, first = mechanics_of(model), int(model.base_length == 0.0)
    stretch, directions = chain.stretches(angle), chain.directions(angle)
    nodes = chain.nodes(angle)[first:]
    arc = np.append(0.0, model.base_length + np.append(0.0, np.cumsum(model.link_length)))[first:]
    if arc.size < 3:
        return np.array([np.interp(arc_length, arc, x) for x in nodes.T]), directions[-1]
    base = stretch[first] * directions[0]
    point, slope = (
        (B @ nodes + w[:, None] * base)[0]
        for B, w in (spline_matrix(arc, [arc_length], CLAMPED, order) for order in (0, 1))
    )
    return point, slope / np.linalg.norm(slope)
