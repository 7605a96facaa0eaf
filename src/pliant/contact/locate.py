"""Location and size of a contact force, from the joint torques that it makes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pliant.contact.moment_arms import curve_at, moment_arms
from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.model import Model

Array = np.ndarray
HIDDEN = 0.5  # of what friction allows: a component known no better than this is called hidden
NORMAL_PRIOR = 30.0  # N: no opinion on the force across the body
END = 1.5e-3  # m before the end of the body
ROUND = 2.0  # what friction is elsewhere: the end is round, almost any direction may be normal to it


@dataclass(frozen=True)
class Push:
    """One force on the body.

    Attributes
    ----------
    arc_length : float
        Along the body from the origin to the point, m; of one that lengthens, before it does.
    arc_interval : (float, float)
        Where the point lies at 95 %, m.
    end : float
        Of the body, m along it.
    link : int
        0 the first.
    position, left, force : (2,) array, (3,) in space
        Point on the smooth body through the joints [m], unit normal to the left of it, force [N], in the base frame. In
        space the normal points as the part of the force across the body does.
    covariance : (2, 2) array, (3, 3) in space
        Of the force at that point, N^2.
    normal, tangential : float
        Components of the force to the left of the body and towards its tip, N; in space the size of the one across it.
    normal_sd, tangential_sd : float
    chi_square : float
        What the best point leaves unexplained, n - 3 expected; n + S - 3 of a body that lengthens; N - 4 in space.
    chi_square_free : float
        What is unexplained without a force, n expected where nothing touches, n + S of a body that lengthens.
    hidden : tuple of str
        Components that the torques say nothing of: what is given of them is what friction makes likely.
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
    """The single force that explains external joint torques best.

    Every point along the body is tried. There the force is the least-squares one, f = (J S^-1 J^T + W)^-1 J S^-1 r,
    where W says that the tangential part is at most about `friction` times the normal one (at the round end it may
    be larger). The point of the highest evidence is taken: unexplained chi-square, and what a free direction costs.

    Parameters
    ----------
    angle : array (n,)
        Absolute link angles, rad; of a body that lengthens (n + S,), its strains behind them; in space (N,), the
        coordinates.
    torque, covariance : array (n,), (n, n)
        External joint torques [N m] and their covariance; behind them what works on the strains, N m.
    friction : float
        Coefficient of friction that is likely; large: no opinion.
    spacing : float
        Between the points that are tried, m.
    rigid : bool
        Whether the body bends at its joints alone, like the chain; see `pliant.contact.moment_arms.moment_arms`.

    Returns
    -------
    Push
        A straight body cannot show a force along itself, whatever its size: then "tangential" is among `hidden`. One
        that lengthens can.

    Raises
    ------
    InputError
        When shapes do not agree or the covariance is not positive definite.
    """
    n, size = model.n, model.size
    shapes = [np.shape(a) for a in (angle, torque, covariance)]
    if shapes != [(size,), (size,), (size, size)] or not friction > 0:
        strains = f" and {size - n} strains" if size > n else ""
        raise InputError(
            f"a force is located from {n} angles{strains}, {size} torques and their covariance, friction above 0"
        )
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
    return described(model, angle, Tried(link, along, force, information, weight, misfit, evidence), float(z @ z))


class Tried(NamedTuple):
    """The points that are tried, and the best force at each."""

    link: Array  # (P,)
    along: Array  # (P,) m, from the link's joint
    force: Array  # (P, d) N, across the body and towards its tip
    information: Array  # (P, d, d) 1/N^2, inverse of the force's covariance
    weight: Array  # (P, d, d) 1/N^2, of that what friction makes likely
    misfit: Array  # (P,) chi-square left
    evidence: Array  # (P,) that and what freedom costs: the lowest is the likeliest


def points(model: Model, spacing: float) -> tuple[Array, Array]:
    """Points along the links: link and distance along it (P,), m."""
    counts = np.maximum(2, np.ceil(model.link_length / spacing).astype(int))
    along = [(np.arange(c) + 0.5) / c * l for c, l in zip(counts, model.link_length, strict=True)]
    return np.repeat(np.arange(model.n), counts), np.concatenate(along)


def described(model: Model, angle: Array, tried: Tried, without: float) -> Push:
    """The best point in the base frame, with what it cannot show; `without` is the chi-square without a force."""
    best = int(np.argmin(tried.evidence))
    likely = tried.evidence <= tried.evidence[best] + 3.84
    j = int(tried.link[best])
    arc = model.base_length + np.concatenate([[0.0], np.cumsum(model.link_length)])[tried.link] + tried.along
    turn = mechanics_of(model).link_frames(np.asarray(angle))[j + 1]  # columns: across the link, and along it
    point, tangent = curve_at(model, angle, float(arc[best]))
    own, force = np.linalg.inv(tried.information[best]), tried.force[best]
    sd = np.sqrt(np.diag(own))
    allowed = 1.0 / np.sqrt(np.diag(tried.weight[best]))
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
        normal, float(force[-1]), normal_sd, float(sd[-1]), float(tried.misfit[best]), without,
        tuple(dict.fromkeys(name for name, hides in zip(names, sd > HIDDEN * allowed, strict=True) if hides)),
    )
