"""Location and size of a contact force from the joint torques that it causes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pliant.contact.moment_arms import curve_at, moment_arms
from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Model

Array = np.ndarray
HIDDEN = 0.5  # of the force that friction allows: a component less certain than this is called hidden
NORMAL_PRIOR = 30.0  # N, wide prior of the force across the body
END = 1.5e-3  # m, length of the round end of the body
ROUND = 2.0  # friction coefficient at the round end, where almost any direction may be normal to the surface


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
        Whether the body bends at its joints only, like the chain; see `pliant.contact.moment_arms.moment_arms`.

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
    own, force = np.linalg.inv(trial.information[best]), trial.force[best]
    sd = np.sqrt(np.diag(own))
    allowed = 1.0 / np.sqrt(np.diag(trial.weight[best]))
    names = ["normal"] * (len(force) - 1) + ["tangential"]
    normal, normal_sd, left = float(force[0]), float(sd[0]), np.array([-tangent[1], tangent[0]])
    if model.space:
        normal = float(np.linalg.norm(force[:2]))
        towards = force[:2] / max(normal, 1e-300)
        normal_sd = float(np.sqrt(towards @ own[:2, :2] @ towards))
        across = turn[:, :2] @ force[:2]
        across -= (across @ tangent) * tangent
        left = across / max(float(np.linalg.norm(across)), 1e-300)
    return Push(
        float(arc[best]), (float(arc[likely].min()), float(arc[likely].max())), model.length, j,
        point, left, turn @ force, turn @ own @ turn.T,
        normal, float(force[-1]), normal_sd, float(sd[-1]), float(trial.misfit[best]), without,
        tuple(dict.fromkeys(name for name, hides in zip(names, sd > HIDDEN * allowed, strict=True) if hides)),
    )
