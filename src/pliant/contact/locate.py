"""Location and size of a contact force from the joint torques that it causes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.numerics.spline import CLAMPED, spline_matrix

Array = np.ndarray
HIDDEN = 0.5  # of the force that friction allows: a component less certain than this is called hidden
NORMAL_PRIOR = 30.0  # N, wide prior of the force across the body
END = 1.5e-3  # m, length of the round end of the body
ROUND = 2.0  # friction coefficient at the round end, where almost any direction may be normal to the surface


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
    frame_arms = ahead[:, link]
    arm = (joint[:, link] + (part * along)[..., None] * frame_arms)[:, :, None] - joint[:, None]  # (T, P, n, d)
    arm = np.where((np.arange(n) <= link[:, None])[..., None], arm, 0.0)
    if not rigid:
        for k, u in ((link, along), (link + 1, along - model.link_length[link])):
            inside = np.flatnonzero(k < n)
            lever = part[:, inside] * mean_moment_arm(model, k[inside], u[inside])
            arm[:, inside, k[inside]] = lever[..., None] * frame_arms[:, inside]
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


@dataclass(frozen=True)
class Push:
    """A contact force on the body: position, components, covariance and goodness of fit.

    Attributes
    ----------
    arc_length : float
        Arc length from the origin to the point, m; on the unstretched body.
    arc_interval : (float, float)
        95 % interval of the arc length, m.
    end : float
        Arc length of the body's end, m.
    link : int
        Index of the link, 0 for the first.
    position, left, force : (2,) array, (3,) in space
        Point on the smooth curve through the joints [m], unit normal to the left of it, and force [N], in the base
        frame. In space the normal points along the part of the force across the body.
    covariance : (2, 2) array, (3, 3) in space
        Covariance of the force at that point, N^2.
    normal, tangential : float
        Components of the force to the left of the body and towards its tip, N. In space `normal` is the magnitude of
        the force across the body.
    normal_sd, tangential_sd : float
        Their standard deviations, N.
    chi_square : float
        Chi-square at the best point; its expected value is n - 3, n + S - 3 for an extensible body, N - 4 in space.
    chi_square_free : float
        Chi-square without a force; its expected value without contact is n, n + S for an extensible body.
    hidden : tuple of str
        Components that the torques do not determine; their values come from the friction prior.
    """

    arc_length: float
    arc_interval: tuple[float, float]
    end: float
    link: int
    position: Array
    left: Array
    force: Array
    covariance: Array
    normal: float
    tangential: float
    normal_sd: float
    tangential_sd: float
    chi_square: float
    chi_square_free: float
    hidden: tuple[str, ...]


def locate(
    model: Model, angle: Array, torque: Array, covariance: Array, *, friction: float = 0.5, spacing: float = 5e-4,
    rigid: bool = False,
) -> Push:
    """Find the position and size of the one contact force that best explains external joint torques.

    Points all along the body are tried. At each, the force is the least-squares one, f = (J S^-1 J^T + W)^-1 J S^-1 r.
    The prior W states that the tangential part is at most about `friction` times the normal one (more at the round
    end). The point of highest evidence is returned, from its chi-square and a penalty for an undetermined direction.

    Parameters
    ----------
    angle : array (n,)
        Absolute link angles, rad; (n + S,) for an extensible body, followed by its strains; in space (N,), the
        coordinates.
    torque, covariance : array (n,), (n, n)
        External joint torques [N m] and their covariance; for an extensible body followed by the generalised forces of
        the strains [N m].
    friction : float
        Likely coefficient of friction; a large value removes the prior.
    spacing : float
        Distance between the points that are tried, m.
    rigid : bool
        Whether the body bends at its joints only, like the chain; see `pliant.contact.locate.moment_arms`.

    Returns
    -------
    Push
        A force along a straight body of fixed length causes no joint torque: then "tangential" is among `hidden`.

    Raises
    ------
    InputError
        When shapes do not agree or the covariance is not positive definite.
    """
    n, size = model.n, model.size
    shapes = [np.shape(a) for a in (angle, torque, covariance)]
    if shapes != [(size,), (size,), (size, size)]:
        strains = f" and {size - n} strains" if size > n else ""
        raise InputError(
            f"locate needs {n} angles{strains}, {size} torques and their covariance ({size}, {size}), got shapes "
            f"{shapes[0]}, {shapes[1]} and {shapes[2]}"
        )
    if not friction > 0:
        raise InputError(f"locate needs a coefficient of friction above 0, got {friction}")
    try:
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:
        raise InputError("the covariance of the torques must be symmetric and positive definite") from None
    link, along = points(model, spacing)
    J = moment_arms(model, np.asarray(angle)[None], link, along, rigid=rigid)[0]
    A = J @ whiten.T  # (points, d, n): torque per newton across the body and to the tip
    z = whiten @ torque
    strength = np.full(link.size, np.inf)
    at_end = (link == n - 1) & (along > model.link_length[-1] - END)
    slope = np.where(at_end, ROUND, friction)
    for _ in range(3):  # the tangential prior follows the size of the normal force
        weight = np.tile(NORMAL_PRIOR**-2 * np.eye(J.shape[1]), (link.size, 1, 1))
        weight[:, -1, -1] = 1.0 / (slope * np.minimum(np.maximum(strength, 1e-3), NORMAL_PRIOR)) ** 2
        information = A @ np.swapaxes(A, 1, 2) + weight
        force = np.linalg.solve(information, (A @ z)[..., None])[..., 0]
        strength = np.where(at_end, np.linalg.norm(force, axis=1), np.linalg.norm(force[:, :-1], axis=1))
    misfit = np.sum((z - np.einsum("pa,pan->pn", force, A)) ** 2, axis=1)
    misfit += np.einsum("pa,pab,pb->p", force, weight, force)
    free = np.linalg.det(information) / np.linalg.det(information[:, :-1, :-1]) / weight[:, -1, -1]
    evidence = misfit + np.log(free)  # freedom along the body costs: little where friction leaves little
    return described(model, angle, TrialForce(link, along, force, information, weight, misfit, evidence), float(z @ z))


class TrialForce(NamedTuple):
    """Candidate points of a contact on the body, with the best-fitting force at each."""

    link: Array  # (P,)
    along: Array  # (P,) m, from the link's joint
    force: Array  # (P, d) N, across the body and towards its tip
    information: Array  # (P, d, d) 1/N^2, inverse of the force's covariance
    weight: Array  # (P, d, d) 1/N^2, contribution of the friction prior to `information`
    misfit: Array  # (P,) chi-square
    evidence: Array  # (P,) misfit plus a penalty for undetermined directions: the lowest is the likeliest


def points(model: Model, spacing: float) -> tuple[Array, Array]:
    """Return candidate points every `spacing` [m] along the links: link index (P,) and distance from the link's joint
    (P,) [m].
    """
    counts = np.maximum(2, np.ceil(model.link_length / spacing).astype(int))
    along = [(np.arange(c) + 0.5) / c * l for c, l in zip(counts, model.link_length, strict=True)]
    return np.repeat(np.arange(model.n), counts), np.concatenate(along)


def described(model: Model, angle: Array, trial: TrialForce, without: float) -> Push:
    """Return the candidate that fits best as a `Push` in the base frame.
    `without` is the chi-square without any force.
    """
    best = int(np.argmin(trial.evidence))
    likely = trial.evidence <= trial.evidence[best] + 3.84
    j = int(trial.link[best])
    arc = model.base_length + np.concatenate([[0.0], np.cumsum(model.link_length)])[trial.link] + trial.along
    turn = mechanics_of(model).link_frames(np.asarray(angle))[j + 1]  # columns: across the link, and along it
    point, tangent = curve_at(model, angle, float(arc[best]))
    covariance, force = np.linalg.inv(trial.information[best]), trial.force[best]
    sd = np.sqrt(np.diag(covariance))
    allowed = 1.0 / np.sqrt(np.diag(trial.weight[best]))
    names = ["normal"] * (len(force) - 1) + ["tangential"]
    normal, normal_sd, left = mechanics_of(model).lateral_force(turn, tangent, force, covariance)
    return Push(
        float(arc[best]), (float(arc[likely].min()), float(arc[likely].max())), model.length, j,
        point, left, turn @ force, turn @ covariance @ turn.T,
        normal, float(force[-1]), normal_sd, float(sd[-1]), float(trial.misfit[best]), without,
        tuple(dict.fromkeys(name for name, hides in zip(names, sd > HIDDEN * allowed, strict=True) if hides)),
    )
