"""A fitted model of a search: its parameters, residuals and derivatives at the optimum."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pliant.errors import FitError
from pliant.identification.experiment import Experiment
from pliant.identification.fit import finished
from pliant.identification.initial_guess import prepare
from pliant.identification.optimise import solve
from pliant.identification.parameters import Parameter, apply
from pliant.identification.prediction import fit_step
from pliant.identification.problem import Problem
from pliant.identification.residuals import Observations
from pliant.identification.uncertainty import Covariance, covariance
from pliant.model import Model
from pliant.selection.result import RivalModel
from pliant.shapes import Float
from pliant.simulation import Trace
from pliant.simulation.solve import longest_allowed_step

Array = np.ndarray
TOLERANCE = 1e-5  # relative change of the cost at which a fit of the search stops: far below what decides
EVALUATIONS = 40
ALMOST, RIVALS = 0.2, 2  # of the criterion: a model within that of the chosen one is a rival; the best of them
RIVAL_EVALUATIONS = 6  # with which a rough fit goes on
STEPS = (0.05, 0.02, 0.01, 0.005, 0.002)  # s, time steps that are tried
STEP_ERROR = 0.05  # % of the peak displacement: what halving the time step may change
FARTHER = 1.5  # times the inputs of the training recordings, under which models are compared beyond these


@dataclass(frozen=True)
class FitSetting:
    """What all fits of a search share: recordings, time step [s], weighting and loss of the residuals, the highest
    number of evaluations, whether the time step is stated, so that it is not chosen, and the deadline after which every
    fit stops at its best iterate (see `time.monotonic`).
    """

    experiments: tuple[Experiment, ...]
    time_step: float
    weighting: str = "travel"
    loss: str = "linear"
    evaluations: int = EVALUATIONS
    stated_step: bool = False
    deadline: float = np.inf

    def problem(self, model: Model, parameters: Sequence[Parameter]) -> Problem:
        """Return the least-squares problem of a model with observed points and of parameters with start values."""
        model, filled = prepare(self.experiments, model, parameters)
        return Problem(list(self.experiments), model, filled, self.time_step, self.weighting)

    def cheapest(
        self, model: Model, starts: Sequence[Sequence[Parameter]], prior_weight: float,
    ) -> Sequence[Parameter]:
        """Return the parameters, all with start values, from which the cost is lowest without a fit."""
        if len(starts) == 1:
            return starts[0]
        problem = self.problem(model, starts[0])
        problem.size = prior_weight

        def cost(start: Sequence[Parameter]) -> float:
            values = {p.name: p.value for p in start if p.value is not None}
            return problem.cost(np.array([values[p.name] for p in problem.free]) / problem.scale)

        return min(starts, key=cost)


class Linearised(NamedTuple):
    """A linear least-squares problem near the optimum of a fit: N residuals of recordings and R residuals of priors,
    with their derivatives with respect to P scaled parameters.
    """

    residual: Float[Array, " N"]
    jacobian: Float[Array, "N P"]
    prior_residual: Float[Array, " R"]
    prior_jacobian: Float[Array, "R P"]

    @property
    def cost(self) -> float:
        """Return half the sum of squared residuals."""
        return 0.5 * float(self.residual @ self.residual + self.prior_residual @ self.prior_residual)

    @property
    def whole(self) -> tuple[Float[Array, " M"], Float[Array, "M P"]]:
        """Return the M = N + R residuals and their derivatives."""
        return (np.concatenate([self.residual, self.prior_residual]),
                np.concatenate([self.jacobian, self.prior_jacobian]))

    @property
    def information(self) -> Float[Array, "P P"]:
        """Return J^T J of the recordings and priors."""
        jacobian = self.whole[1]
        return np.asarray(jacobian.T @ jacobian)

    def without(self, columns: Sequence[int]) -> Linearised:
        """Return the problem without the parameters in some columns, which stay at their values."""
        return self._replace(jacobian=np.delete(self.jacobian, columns, axis=1),
                             prior_jacobian=np.delete(self.prior_jacobian, columns, axis=1))

    def moved(self, move: Float[Array, " P"]) -> Linearised:
        """Return the problem at parameters changed by `move`."""
        return self._replace(residual=self.residual + self.jacobian @ move,
                             prior_residual=self.prior_residual + self.prior_jacobian @ move)


@dataclass(frozen=True)
class FittedModel:
    """A fitted model of a search.

    Attributes
    ----------
    problem : Problem
    x : array (P,)
        Scaled free parameters.
    residual : array (N,)
        Weighted residuals of the recordings.
    jacobian : array (N, P)
    converged : bool
        Whether the optimiser converged.
    """

    problem: Problem
    x: Float[Array, " P"]
    residual: Float[Array, " N"]
    jacobian: Float[Array, "N P"]
    converged: bool = True

    @property
    def model(self) -> Model:
        """Return the model to which the parameters are applied."""
        return self.problem.model

    @property
    def cost(self) -> float:
        """Return half the sum of squared residuals of the recordings and priors, which a fit minimises."""
        return self.linear.cost

    @property
    def values(self) -> dict[str, float]:
        """Return the values (SI) of all parameters by name."""
        return self.problem.values(self.x)

    @property
    def parameters(self) -> list[Parameter]:
        """Return all parameters at their fitted values."""
        values = self.values
        return [replace(p, value=float(np.clip(values[p.name], p.lower, p.upper))) for p in self.problem.parameters]

    @property
    def free(self) -> tuple[str, ...]:
        """Return the names of the free parameters."""
        return tuple(p.name for p in self.problem.free)

    @property
    def linear(self) -> Linearised:
        """Return the linear least-squares problem that stands for the model near its optimum."""
        rows, aims = self.problem.all_known
        return Linearised(self.residual, self.jacobian, self.problem.size * (rows @ self.x - aims),
                          self.problem.size * rows)

    def known_as(self, problem: Problem) -> FittedModel:
        """Return the fit as that of a `problem` with the same values, of which some are held or have other priors:
        residuals and derivatives stay.
        """
        problem.size, x = self.prior_weight, problem.start
        problem.observed = self.problem.observed  # with the weights that they have learnt
        jacobian = self.jacobian[:, [self.free.index(p.name) for p in problem.free]]
        problem.latest = x.tobytes(), jacobian
        return FittedModel(problem, x, self.residual, jacobian, self.converged)

    @cached_property
    def prior_weight(self) -> float:
        """Return the weight of priors that follows from the size of the residuals (see `Problem.learn_sizes`)."""
        problem = copy.copy(self.problem)
        problem.learn_sizes(self.x)
        return problem.size

    @cached_property
    def covariance(self) -> Covariance:
        """Return the covariance of the free parameters."""
        return covariance(self.problem, self.x)

    @cached_property
    def residual_beyond(self) -> Array | None:
        """Return the weighted residuals (N,) under `FARTHER` times the inputs of the recordings; None if the model
        cannot be simulated there. Differences between them are those between predictions beyond the recordings.
        """
        mine = self.problem
        problem = Problem([farther(e) for e in mine.experiments], mine.model, self.parameters, mine.time_step,
                          mine.weighting)  # fmt: skip
        residual = problem.data_residual(problem.start)
        return None if problem.broken else residual

    @property
    def standard_errors(self) -> dict[str, float | None]:
        """Return the standard error (SI) of each free parameter by name; None for one that is not determined."""
        return dict(zip(self.covariance.names, self.covariance.std, strict=True))

    @property
    def doubts(self) -> dict[str, float | None]:
        """Return the standard errors with errors of the model's form, as a finished fit reports them."""
        return dict(zip(self.covariance.names, self.covariance.doubt, strict=True))

    def percent(self, residual: Float[Array, " N"]) -> dict[str, float]:
        """Return the RMS error [% of peak displacement] of each recording for weighted residuals (N,).

        Counted are positions or, in recordings without any, angles.
        """
        return {o.exp.name: percent_of(o, part) for o, part in self.problem.parted(residual)}


def farther(experiment: Experiment) -> Experiment:
    """Return the experiment with `FARTHER` times its inputs."""

    def scaled(trace: Trace) -> Trace:
        return Trace(trace.time, FARTHER * trace.pressure)

    pressure = None if experiment.pressure is None else scaled(experiment.pressure)
    return replace(experiment, pressure=pressure, level=FARTHER * experiment.level,
                   drives={name: scaled(trace) for name, trace in experiment.drives.items()})


def frame_spacing(experiments: Sequence[Experiment]) -> float:
    """Return the shortest median time [s] between the frames of experiments of motion; 0 if all are settled poses."""
    spacings = [float(np.median(np.diff(e.time))) for e in experiments if not e.poses and e.time.size > 1]
    return min(spacings, default=0.0)


def tried_step(fit: FittedModel, shortest: float) -> float:
    """Return the longest of `STEPS` [s], no longer than the time between frames or than the first mode allows, whose
    motion differs from that with half of it by at most 0.05 % of the peak displacement (RMS) in every recording;
    `shortest` where none does.
    """
    spacing = frame_spacing(fit.problem.experiments)
    longest = min(spacing, longest_allowed_step(apply(fit.model, fit.values))) if spacing else 0.0
    tried = (step for step in STEPS if shortest < step <= longest)
    return next((step for step in tried if step_error(fit, step) <= STEP_ERROR), shortest)


def with_checked_step(fit: FittedModel, setting: FitSetting) -> Problem:
    """Return the problem of a fit, with a shorter time step if halving its own changes the motion by more than 0.05 %
    of the peak displacement and no step is stated.
    """
    problem = fit.problem
    if setting.stated_step or step_error(fit, problem.time_step) <= STEP_ERROR:
        return problem
    shortest = min(fit_step(fit.model, fit.values, problem.experiments), problem.time_step)
    return problem.with_time_step(tried_step(fit, shortest))


def step_error(fit: FittedModel, step: float) -> float:
    """Return the largest difference (RMS, % of peak displacement) that halving a time step [s] makes in a recording;
    inf where the model cannot be simulated.
    """
    whole, half = (fit.problem.with_time_step(h) for h in (step, 0.5 * step))
    change = whole.data_residual(fit.x) - half.data_residual(fit.x)
    return float("inf") if whole.broken or half.broken else max(fit.percent(change).values())


def percent_of(observed: Observations, residual: Array) -> float:
    """Return the RMS error [% of peak displacement] of one recording from its weighted residuals (N,)."""
    exp = observed.exp
    mine = observed.is_compared
    off = (residual / observed.flat_weight)[mine]
    count = np.unique(observed.rows[mine] * len(exp.stations) + observed.station[mine]).size
    return float(100 * np.sqrt(np.sum(off**2) / max(count, 1)) / exp.travel)


def fitted(
    setting: FitSetting, model: Model, parameters: Sequence[Parameter], *, prior_weight: float | None = None,
    evaluations: int | None = None, tolerance: float = TOLERANCE,
) -> FittedModel:
    """Fit the free parameters from their start values, and return the optimum.

    Parameters
    ----------
    parameters : sequence of Parameter
        All with start values.
    prior_weight : float, optional
        Weight of the priors' residuals; default: that of a first fit.
    evaluations : int, optional
        Highest number of evaluations, if it is below that of the setting; 0: the start values are taken as the optimum.
    tolerance : float
        Relative change of the cost at which the fit stops.

    Raises
    ------
    InputError
        When a parameter does not belong to the model.
    FitError
        When the model cannot be simulated at the optimum.
    """
    problem = setting.problem(model, parameters)
    if prior_weight is not None:
        problem.size = prior_weight
    x, converged = problem.start, True
    most = setting.evaluations if evaluations is None else min(evaluations, setting.evaluations)
    if most:
        end = solve(problem, problem.start, setting.loss, most, tolerance=tolerance, deadline=setting.deadline)
        x, converged = end.x, end.status > 0
    residual = problem.data_residual(x)
    if problem.broken:
        raise FitError(problem.broken)
    return FittedModel(problem, x, residual, problem.data_jacobian(x), converged)


def rivals_among(
    others: Sequence[tuple[float, str, FittedModel]], score: float, chosen: FittedModel, loss: str,
) -> tuple[RivalModel, ...]:
    """Return the best of other models, each with its criterion and its difference in words, if their criterion is
    within `ALMOST` of the `score` of the chosen model and their parameters differ.
    """

    def names(fit: FittedModel) -> tuple[set[str], set[str]]:
        return set(fit.free), {p.name for p in fit.parameters}

    near = [c for c in others if c[0] < (1 + ALMOST) * score and names(c[2]) != names(chosen)]
    best: dict[str, FittedModel] = {}
    for _, title, other in sorted(near, key=lambda c: c[0]):
        best.setdefault(title, other)
    rivals = []
    for title, other in list(best.items())[:RIVALS]:
        end = solve(other.problem, other.x, loss, RIVAL_EVALUATIONS, tolerance=TOLERANCE)
        rivals.append(RivalModel(title, finished(other.problem, end, loss, None, 0.0, "")))
    return tuple(rivals)
