"""What earlier fits say about the body of an arm, as the prior of the next fit."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pliant.adaptation.mounting import COMMON_GAIN, common_gain, of_mounting
from pliant.errors import InputError
from pliant.identification.fit import FitResult
from pliant.identification.names import find_path
from pliant.identification.parameters import OF_A_RECORD, Parameter
from pliant.identification.problem import JointPrior
from pliant.model import Model

Array = np.ndarray
FROM_DAY_TO_DAY = 0.02  # of each parameter of a body: temperature, humidity and age; standard deviation


@dataclass(frozen=True)
class Posterior:
    """Parameters of a body after a fit.

    Attributes
    ----------
    model : Model
    parameters : tuple of Parameter
        Those of the body at their fitted values, free or fixed, without those of the mounting and of recordings.
    body : JointPrior
        Mean and covariance of the free ones on a day of their own: the doubt of the fit, and the scatter between days.
    values : dict
        Fitted values (SI) of the mounting's parameters, by name.
    std : dict
        Standard errors (SI) of the parameters that were free, by name, mounting included.
    between : array (P, P) or None
        Scatter of the body's parameters between days, SI, from the recordings of the first fit; None if unknown.
    """

    model: Model
    parameters: tuple[Parameter, ...]
    body: JointPrior
    values: dict[str, float]
    std: dict[str, float]
    between: Array | None = None

    @property
    def gain_direction(self) -> Array:
        """Return the change (P,) of the body's free parameters with the logarithm of a factor on all inputs, SI."""
        return common_gain(self.body.names, self.body.means)

    def scatter(self, names: Sequence[str]) -> Array | None:
        """Return the scatter between days (N, N) of N parameters by name, 0 for those of the mounting; None if it is
        unknown.
        """
        if self.between is None:
            return None
        matrix = np.zeros((len(names), len(names)))
        there = [(names.index(n), k) for k, n in enumerate(self.body.names) if n in names]
        to, of = (list(i) for i in zip(*there, strict=True))
        matrix[np.ix_(to, to)] = self.between[np.ix_(of, of)]
        return matrix

    @property
    def prior(self) -> JointPrior:
        """Return the prior of another day: that of the body, with a common factor on the gains of all inputs."""
        direction = COMMON_GAIN * self.gain_direction
        return replace(self.body, covariance=self.body.covariance + np.outer(direction, direction))


def posterior_of(result: FitResult, recordings: Collection[str]) -> Posterior:
    """Return what a fit says about the body.

    Parameters
    ----------
    result : FitResult
    recordings : collection of str
        Names of the fit's recordings, whose own parameters are left out.

    Raises
    ------
    InputError
        When the fit has no covariance, or no free parameter of the body.
    """
    shared = [p for p in result.parameters if p.name.partition(".")[0] not in recordings or "." not in p.name]
    body = [p for p in shared if not of_mounting(p.name) and p.name not in OF_A_RECORD]
    free = [p for p in body if p.free]
    if not free:
        raise InputError("this fit has no free parameter of the body that another day could update: run a study "
                         "in which stiffness, damping or gains are free")  # fmt: skip
    return Posterior(
        result.model, tuple(p.with_(prior=None, prior_std=None, shrink=0.0) for p in body),
        gaussian_of(result, free), between=scatter_of(result, free),
        values={p.name: float(p.value) for p in shared if of_mounting(p.name) and p.value is not None},
        std={p.name: p.std for p in shared if p.free and p.std is not None},
    )


def gaussian_of(result: FitResult, free: Sequence[Parameter]) -> JointPrior:
    """Return mean and covariance of some free parameters of a fit, for a day of their own: the doubt of the fit, the
    scatter between its recordings, and 2 % of each for temperature and age.

    A parameter that its recordings do not determine has its own size as standard deviation, or its prior's.
    """
    covariance = result.covariance
    if covariance is None:
        raise InputError("this fit has no covariance of its parameters, which another day starts from: run it again")
    if lost := [p.name for p in free if p.name not in covariance.names]:
        raise InputError(f"the covariance of this fit does not contain its free parameter {lost[0]}: run it again")
    index = [covariance.names.index(p.name) for p in free]
    matrix = covariance.matrix + (0.0 if covariance.between is None else covariance.between)
    values = np.array([float(p.value or 0.0) for p in free])
    matrix = matrix[np.ix_(index, index)] + np.diag((FROM_DAY_TO_DAY * values) ** 2)
    for i, p in enumerate(free):
        if covariance.hidden[index[i]] or not matrix[i, i] > 0:
            size = p.prior_std or max(abs(float(p.value or 0.0)), p.scale)
            matrix[i], matrix[:, i] = 0.0, 0.0
            matrix[i, i] = size**2
    return JointPrior(tuple(p.name for p in free), values, matrix)


def scatter_of(result: FitResult, free: Sequence[Parameter]) -> Array | None:
    """Return the scatter (P, P) of P free parameters between the recordings of a fit, SI; None if it is unknown. It is
    0 for parameters that the recordings do not determine.
    """
    covariance = result.covariance
    if covariance is None or covariance.between is None:
        return None
    index = [covariance.names.index(p.name) for p in free]
    matrix = covariance.between[np.ix_(index, index)].copy()
    lost = np.asarray(covariance.hidden, dtype=bool)[index]
    matrix[lost], matrix[:, lost] = 0.0, 0.0
    return np.asarray(matrix)


def of_a_kind(robots: Sequence[Posterior], spread: float) -> Posterior:
    """Return what fits of several robots of one kind say about the body of another.

    Parameters
    ----------
    robots : sequence of Posterior
        One or more. Parameters that not all of them have free keep the posterior of the first.
    spread : float
        Standard deviation between robots of one kind, as a fraction of each parameter, where there are fewer than
        three robots. Of the two gains of an input in space it is a fraction of their root sum of squares: a tendon that
        pulls along one axis may pull a little across it in another robot.
    """
    first = robots[0]
    names = [n for n in first.body.names if all(n in r.body.names for r in robots)]
    values = np.array([[r.body.means[n] for n in names] for r in robots])
    mean = values.mean(axis=0)
    scales = {p.name: p.scale for p in first.parameters}
    sizes = vector_sizes(dict(zip(names, mean, strict=True)))
    between = np.diag([(spread * max(sizes[n], 0.1 * scales[n])) ** 2 for n in names])
    if len(robots) > 2:
        between = np.diag(np.maximum(values.var(axis=0, ddof=1) * (1.0 + 1.0 / len(robots)), 1e-6 * np.diag(between)))
    within = np.mean([doubt_of(r, names) for r in robots], axis=0)
    body = JointPrior(tuple(names), mean, within + between)
    placed = first.body.means | body.means
    return replace(first, body=body, between=None, parameters=tuple(
        p.with_(value=placed[p.name]) if p.name in body.names else p.with_(free=False) if p.free else p
        for p in first.parameters
    ))  # fmt: skip


def doubt_of(robot: Posterior, names: Sequence[str]) -> Array:
    """Return the covariance (N, N) of N parameters of a robot's body by name, without the scatter between its own
    recordings: that is no difference between robots.
    """
    index = [robot.body.names.index(n) for n in names]
    matrix = robot.body.covariance if robot.between is None else robot.body.covariance - robot.between
    return np.asarray(matrix[np.ix_(index, index)])


def vector_sizes(values: Mapping[str, float]) -> dict[str, float]:
    """Return the magnitude (SI) of each parameter by name; of the gains of an input about two axes, which turn as one
    vector, their root sum of squares.
    """
    def squared(name: str) -> float:
        path = find_path(name)
        across = {"gain_x": "gain_y", "gain_y": "gain_x"}.get(path.stem) if path else None
        other = values.get(f"{path.owner}.{across}" if path and path.owner else across or "", 0.0)
        return values[name] ** 2 + other**2

    return {name: squared(name) ** 0.5 for name in values}


def joints_of(model: Model) -> list[str]:
    """Return the names of the stiffnesses of a model's joints."""
    return [f"stiffness_{k + 1}" for k in range(model.n)]


def by_joint(posterior: Posterior, spread: float, most: int) -> Posterior:
    """Return what is known about the body with a stiffness of each joint in place of a common one; the same if the
    stiffness is not free, or a chain has one joint or more than `most`.

    `spread` is the standard deviation of a joint's stiffness about the common one, as a fraction.
    """
    names, stiffness = posterior.body.names, posterior.model.stiffness
    if "stiffness" not in names or not 1 < posterior.model.n <= most:
        return posterior
    k, joints = names.index("stiffness"), joints_of(posterior.model)
    rows = np.r_[np.arange(k), np.full(len(joints), k), np.arange(k + 1, len(names))]
    there = slice(k, k + len(joints))
    ratio = np.ones(rows.size)
    ratio[there] = stiffness / posterior.body.mean[k]
    own = np.zeros(rows.size)
    own[there] = (spread * stiffness) ** 2

    def widened(matrix: Array) -> Array:
        return np.asarray(np.outer(ratio, ratio) * matrix[np.ix_(rows, rows)])

    (common,) = (p for p in posterior.parameters if p.name == "stiffness")
    separate = [Parameter(n, float(v)) for n, v in zip(joints, stiffness, strict=True)]
    body = replace(posterior.body, names=(*names[:k], *joints, *names[k + 1:]), mean=ratio * posterior.body.mean[rows],
                   covariance=widened(posterior.body.covariance) + np.diag(own))  # fmt: skip
    return replace(posterior, body=body, between=None if posterior.between is None else widened(posterior.between),
                   parameters=(*(p for p in posterior.parameters if p is not common), *separate))  # fmt: skip
