"""The least-squares problem of a fit: residuals of recordings and priors, and their Jacobian."""

from __future__ import annotations

import copy
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pliant.errors import InputError, PliantError
from pliant.identification.chamber_parameters import held_gains
from pliant.identification.experiment import EDGES_OF, Experiment
from pliant.identification.following import observed_rows
from pliant.identification.forward_model import forward_problem
from pliant.identification.names import path_of
from pliant.identification.parameters import Parameter
from pliant.identification.plans import Plans
from pliant.identification.residuals import Observations, correlated_frames
from pliant.identification.sensitivity import slopes_of
from pliant.model import Model
from pliant.shapes import Float

Array = np.ndarray
LEAST_EIGENVALUE = 1e-6  # of a correlation matrix; a smaller one is rounding, or a direction that was not determined
FAR = 1e3  # residual, in peak displacements, of a parameter set that cannot be simulated
BLIND = 1e-11  # of the longest column of the Jacobian: a shorter one is rounding error
MOST_PLANS = 100  # cached models, and cached steps and torques
HELD_MEAN = 1e-3  # standard deviation of the held mean of joint gains, which no recording determines
EDGE_TIMES = {edge for names in EDGES_OF.values() for edge in names}
FIRST_GUESS = 0.01  # of a peak displacement: assumed size of the residuals before the first fit


@dataclass(frozen=True, eq=False)
class JointPrior:
    """Gaussian prior of P parameters with a covariance, SI units.

    Attributes
    ----------
    names : tuple of str
    mean : array (P,)
    covariance : array (P, P)

    Raises
    ------
    InputError
        When the shapes do not fit each other, or a number is not finite or a variance not positive.
    """

    names: tuple[str, ...]
    mean: Float[Array, " P"]
    covariance: Float[Array, "P P"]

    def __post_init__(self) -> None:
        size = len(self.names)
        if self.mean.shape != (size,) or self.covariance.shape != (size, size):
            raise InputError(f"a prior of {size} parameters needs a mean ({size},) and a covariance ({size}, {size}), "
                             f"got {self.mean.shape} and {self.covariance.shape}")  # fmt: skip
        if not (np.isfinite(self.mean).all() and np.isfinite(self.covariance).all()):
            raise InputError("a prior needs finite means and covariances")
        if not (np.diag(self.covariance) > 0).all():
            worst = self.names[int(np.argmin(np.diag(self.covariance)))]
            raise InputError(f"a prior needs a positive variance of every parameter: that of {worst} is not")

    @property
    def std(self) -> dict[str, float]:
        """Return the standard deviation (SI) of each parameter by name."""
        return dict(zip(self.names, map(float, np.sqrt(np.diag(self.covariance))), strict=True))

    @property
    def means(self) -> dict[str, float]:
        """Return the mean (SI) of each parameter by name."""
        return dict(zip(self.names, map(float, self.mean), strict=True))

    def of(self, names: Collection[str]) -> JointPrior:
        """Return the marginal prior of those parameters that are in `names`."""
        index = [i for i, name in enumerate(self.names) if name in names]
        return JointPrior(tuple(self.names[i] for i in index), self.mean[index], self.covariance[np.ix_(index, index)])

    def widened(self, variances: Mapping[str, float]) -> JointPrior:
        """Return the prior with the given variances (SI) added to those of the parameters named."""
        added = np.array([variances.get(name, 0.0) for name in self.names])
        return JointPrior(self.names, self.mean, self.covariance + np.diag(added))

    def rows(self, free: Sequence[Parameter], scale: Array) -> tuple[Array, Array]:
        """Return R residuals A x - b of unit variance, as A (R, P) and b (R,), for the scaled values x (P,) of the free
        parameters of a fit. Parameters of the prior that are not free are left out.
        """
        listed = [p.name for p in free]
        joint_prior = self.of(listed)
        std = np.sqrt(np.diag(joint_prior.covariance))
        size, turn = np.linalg.eigh(joint_prior.covariance / np.outer(std, std))
        root = (turn / np.sqrt(np.maximum(size, LEAST_EIGENVALUE))).T / std  # W with W C W' = 1
        columns = [listed.index(name) for name in joint_prior.names]
        rows = np.zeros((len(columns), len(listed)))
        rows[:, columns] = root * scale[columns]
        return rows, root @ joint_prior.mean


def root_mean_square(modelled: Array, measured: Array) -> float:
    """Return the root-mean-square distance [m; angles: rad] between modelled and measured values.
    Missing values are ignored.
    """
    return float(np.sqrt(np.nanmean(np.sum((modelled - measured) ** 2, axis=-1))))


class Problem:
    """The least-squares problem of a fit: residuals of all experiments at scaled free parameters x (P,), and their
    Jacobian.

    Each parameter is in units of its own scale. A residual is a distance over the peak displacement of its experiment,
    in metres, or in standard deviations of the noise; in the first two cases an experiment with many samples counts no
    more than one with few. The residuals of priors and of parameters that shrink to their mean follow them, weighted by
    `size`, the size of the recordings' residuals.
    """

    def __init__(
        self, experiments: list[Experiment], model: Model, parameters: list[Parameter], time_step: float,
        weighting: str, prior: JointPrior | None = None,
    ) -> None:
        self.experiments = experiments
        self.names = {e.name for e in experiments}
        self.model = model
        self.parameters = parameters
        self.time_step = time_step
        self.weighting = weighting
        self.free = [p for p in parameters if p.free]
        self.scale = np.array([p.scale or 1.0 for p in self.free])
        self.fixed = {p.name: p.value for p in parameters if not p.free}
        self.bounds = tuple(np.array([(p.lower, p.upper) for p in self.free]).reshape(-1, 2).T / self.scale)
        margin = 1e-9 * np.where(np.isfinite(self.bounds[1] - self.bounds[0]), self.bounds[1] - self.bounds[0], 1.0)
        raw = np.array([p.value for p in self.free]) / self.scale
        self.start = np.clip(raw, self.bounds[0] + margin, self.bounds[1] - margin)
        self.observed = [Observations(e, weighting) for e in experiments]
        travels = np.array([e.travel for e in experiments])
        self.unit = float(np.median(travels)) if weighting == "metre" else 1.0  # one peak displacement in residuals
        counts = np.array([o.count for o in self.observed])
        if weighting != "noise":
            for o, balance in zip(self.observed, np.sqrt(counts.mean() / counts), strict=True):
                o.weight *= balance
        self.ends = np.cumsum(counts)
        self.known = known_rows(self.free, self.scale, self.start, prior)
        for chamber in held_gains(parameters, model):
            self.known = with_held_mean(self.known, self.free, self.scale, self.start, chamber)
        self.held = np.zeros((0, len(self.free))), np.zeros(0)
        self.size = 1.0 if weighting == "noise" else FIRST_GUESS * self.unit
        self.least_error = 0.0  # of residuals (RMS): what the model is known to lack, however well it fits
        self.error_time = 0.0  # s, over which that error is correlated
        self.evaluations = 0
        self.broken = ""
        self.plans = Plans()
        self.latest: tuple[bytes, Array] = (b"", np.zeros(0))  # scaled parameters and the Jacobian there

    def values(self, x: Array) -> dict[str, Any]:
        """Return the values (SI) of all parameters by name, at the scaled free parameters x (P,). None passes its
        bounds, which a product of x and scale may do by rounding.
        """
        named = zip(self.free, x * self.scale, strict=True)
        return {**self.fixed, **{p.name: float(np.clip(v, p.lower, p.upper)) for p, v in named}}

    def with_time_step(self, time_step: float) -> Problem:
        """Return a copy of this problem with another integration step [s], with the same weights and scales."""
        other = copy.copy(self)
        other.time_step, other.plans, other.latest = time_step, Plans(), (b"", np.zeros(0))
        return other

    def residual(self, x: Array) -> Array:
        """Return the residuals of all recordings and priors at the scaled parameters x (P,). A recording that cannot be
        simulated at x gets the large residual `FAR`.
        """
        rows, aim = self.all_known
        return np.concatenate([self.data_residual(x), self.size * (rows @ x - aim)])

    def cost(self, x: Array) -> float:
        """Return half the sum of squared residuals at the scaled parameters x (P,); inf if the model cannot be
        simulated there.
        """
        r = self.residual(x)
        return float("inf") if self.broken else 0.5 * float(np.sum(r * r))

    def data_residual(self, x: Array) -> Array:
        """Return the weighted residuals (N,) of all observed values at the scaled parameters x (P,)."""
        self.evaluations += 1
        self.broken = ""
        values = self.values(x)
        parts = []
        for o in self.observed:
            try:
                forward = forward_problem(self.model, o.exp, values, self.time_step, self.plans)
                parts.append(o.residual(observed_rows(forward, forward.numbers, o.exp.time.size)))
            except PliantError as error:
                self.broken = str(error)
                parts.append(FAR * o.exp.travel * o.flat_weight)
        return np.concatenate(parts)

    def jacobian(self, x: Array) -> Array:
        """Return the exact derivatives of all residuals, including those of priors, with respect to the scaled
        parameters x (P,).
        """
        return np.concatenate([self.data_jacobian(x), self.size * self.all_known[0]])

    def data_jacobian(self, x: Array) -> Array:
        """Return the exact derivatives (N, P) of the N weighted observation residuals with respect to the scaled
        parameters x (P,).
        """
        if self.latest[0] == x.tobytes():
            return self.latest[1]
        values = self.values(x)
        sizes = {p.name: float(s) for p, s in zip(self.free, self.scale, strict=True)}
        self.plans.forget(MOST_PLANS)
        self.plans.slopes.clear()
        J = np.zeros((self.ends[-1], len(self.free)))
        for o, end in zip(self.observed, self.ends, strict=True):
            mine = [k for k, p in enumerate(self.free) if self.acts_on(p, o.exp)]
            free_sizes = {self.free[k].name: sizes[self.free[k].name] for k in mine}
            slopes = slopes_of(self.model, o.exp, values, free_sizes, self.time_step, self.plans)
            rows = None
            if o.more:
                forward = forward_problem(self.model, o.exp, values, self.time_step, self.plans)
                rows = observed_rows(forward, forward.numbers, o.exp.time.size)
            J[end - o.count : end, mine] = o.slopes(slopes, rows).T
        J *= self.scale
        length = np.linalg.norm(J, axis=0)
        J[:, length < BLIND * length.max(initial=0.0)] = 0.0  # rounding alone: it would send the optimiser far off
        self.latest = (x.tobytes(), J)
        return np.asarray(J)

    def acts_on(self, p: Parameter, exp: Experiment) -> bool:
        """Return whether parameter `p` can affect an experiment: all can, except those of another recording."""
        owner = p.name.partition(".")[0]
        return owner == exp.name or owner not in self.names

    def parted(self, rows: Array) -> list[tuple[Observations, Array]]:
        """Return the observations of each recording with its part of `rows` (R, ...), one for each of R residuals."""
        return list(zip(self.observed, np.split(rows, self.ends[:-1]), strict=True))

    @property
    def learns(self) -> bool:
        """Return whether the fit weights priors or noise by the size of its residuals, and must thus be repeated."""
        return len(self.all_known[1]) > 0 or self.weighting == "noise"

    def hold_to_start(self) -> None:
        """Add a weak prior to every parameter that has none: its mean is the start value, its standard deviation the
        parameter's scale.
        """
        loose = [i for i, p in enumerate(self.free) if not p.prior_std]
        self.held = np.eye(len(self.free))[loose], self.start[loose]

    @property
    def all_known(self) -> tuple[Array, Array]:
        """Return the R residuals A x - b that do not depend on recordings, as A (R, P) and b (R,), for scaled
        parameters x (P,). They come from priors, and from values held at their mean or start.
        """
        return np.concatenate([self.known[0], self.held[0]]), np.concatenate([self.known[1], self.held[1]])

    def expect_error(self, size: float, time: float) -> None:
        """Expect residuals of the RMS `size`, correlated over `time` [s], however closely the recordings are fitted.
        If the time is known, the weight of the priors follows from them before `learn_sizes`.
        """
        self.least_error, self.error_time = size, time
        if size > 0 and time > 0 and self.weighting != "noise":
            independent = sum(o.count / self.longest_error(o) for o in self.observed)
            self.size = size * float(np.sqrt(self.ends[-1] / max(independent, 1e-300)))

    def longest_error(self, observed: Observations) -> float:
        """Return the frames over which the expected error of the model is correlated, such that a recording shows it
        at least twice; 1 where it is not known.
        """
        step = float(np.median(np.diff(observed.exp.time))) if observed.exp.time.size > 1 else 0.0
        if not (self.error_time > 0 and step > 0) or observed.exp.poses:
            return 1.0
        frames = np.count_nonzero(observed.seen.any(axis=(1, 2)))
        return max(min(self.error_time / step, 0.5 * frames), 1.0)

    def frames_of_error(self, observed: Observations, residual: Array) -> float:
        """Return the correlation length of a residual (N,) in frames; at least that of the expected error where the
        residual is smaller than it.
        """
        frames = correlated_frames(observed, residual)
        if float(np.sqrt(np.mean(residual**2))) >= self.least_error:
            return frames
        return max(frames, self.longest_error(observed))

    def learn_sizes(self, x: Array) -> None:
        """Set the weight of the priors and the unknown noise levels from the size of the residuals at x (P,).

        Residuals that are correlated over many frames count as few independent ones, so that the priors weigh more.
        """
        residual = self.data_residual(x)
        parts = self.parted(residual)
        independent = sum(part.size / self.frames_of_error(o, part) for o, part in parts)
        self.size = float(np.sqrt(residual.size / independent))
        if self.weighting != "noise":
            self.size *= max(float(np.sqrt(np.mean(residual**2))), self.least_error, 1e-12 * self.unit)
            return
        for o, part in parts:
            for s, channel in o.unknown_noise():
                mine = (o.station == s) & np.isin(o.channel, channel)
                if mine.any():
                    self.latest = (b"", np.zeros(0))
                    o.weight[s, list(channel)] /= max(float(np.sqrt(np.mean(part[mine] ** 2))), 1e-6)


def scattered(free: Sequence[Parameter], x: Array, bounds: Sequence[Array], rng: np.random.Generator) -> Array:
    """Return a random start point near the scaled parameters x (P,): each changed by up to 30 %, except edge times."""
    start = x.copy()
    for i, p in enumerate(free):
        if p.name.rpartition(".")[2] not in EDGE_TIMES:
            start[i] += 0.3 * rng.uniform(-1, 1) * max(abs(start[i]), 1e-3)
    return np.clip(start, *bounds)


def scattered_start(parameters: Sequence[Parameter], rng: np.random.Generator) -> list[Parameter]:
    """Return the fit parameters with random start values: each changed by up to 30 %, except edge times."""
    free = [p for p in parameters if p.free and p.value is not None]
    scale = np.array([p.scale or 1.0 for p in free])
    bounds = np.array([(p.lower, p.upper) for p in free]).reshape(-1, 2).T / scale
    x = scattered(free, np.array([p.value for p in free]) / scale, bounds, rng) * scale
    moved = {p.name: float(np.clip(v, p.lower, p.upper)) for p, v in zip(free, x, strict=True)}
    return [p.with_(value=moved.get(p.name, p.value)) for p in parameters]


def with_held_mean(
    known: tuple[Array, Array], free: list[Parameter], scale: Array, start: Array, chamber: str = "",
) -> tuple[Array, Array]:
    """Return R + 1 residuals A x - b, as A (R + 1, P) and b (R + 1,), for scaled parameters x (P,): the R residuals
    given by `known`, and one that holds a chamber's mean joint gain at its start value.
    """
    paths = [path_of(p.name) for p in free]
    gains = np.array([path.stem == "joint_gain" and path.owner == chamber.removesuffix(".") for path in paths])
    row = gains * scale / (gains.sum() * HELD_MEAN)
    return np.concatenate([known[0], row[None]]), np.append(known[1], row @ start)


def known_rows(
    free: list[Parameter], scale: Array, start: Array, prior: JointPrior | None = None,
) -> tuple[Array, Array]:
    """Return the R residuals A x - b of a fit that do not come from recordings, as A (R, P) and b (R,), for scaled
    parameters x (P,). There is one for each prior, and one for each joint value that is drawn to the mean of all
    joints. A joint `prior` takes the place of the parameters' own priors.
    """
    rows, aims = [], []
    together = set(prior.names) if prior else set()
    for i, p in enumerate(free):
        if p.prior_std and p.name not in together:
            rows.append(np.eye(len(free))[i] * scale[i] / p.prior_std)
            aims.append((start[i] * scale[i] if p.prior is None else p.prior) / p.prior_std)
    stems = [p.name.rpartition("_")[0] if p.shrink else "" for p in free]
    for stem in sorted(set(stems) - {""}):
        mine = np.array([s == stem for s in stems])
        share = np.array([p.shrink for p in free])
        level = abs(float((start * scale)[mine].mean())) or 1.0
        away = (np.eye(len(free)) - mine / mine.sum())[mine]
        rows += list(away * scale / (share[mine][:, None] * level))
        aims += [0.0] * int(mine.sum())
    alone = np.array(rows).reshape(len(rows), len(free)), np.array(aims)
    if prior is None:
        return alone
    A, b = prior.rows(free, scale)
    return np.concatenate([alone[0], A]), np.concatenate([alone[1], b])
