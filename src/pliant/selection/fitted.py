"""A fitted model of a search: its parameters, residuals and derivatives at the optimum."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pliant.errors import FitError
from pliant.identification.experiment import Experiment
from pliant.identification.initial_guess import prepare
from pliant.identification.optimise import solve
from pliant.identification.parameters import Parameter
from pliant.identification.problem import Problem
from pliant.identification.residuals import Observations
from pliant.identification.uncertainty import covariance
from pliant.model import Model
from pliant.shapes import Float

Array = np.ndarray
TOLERANCE = 1e-5  # relative change of the cost at which a fit of the search stops: far below what decides
EVALUATIONS = 40


@dataclass(frozen=True)
class FitSetting:
    """What all fits of a search share: recordings, time step [s], weighting and loss of the residuals."""

    experiments: tuple[Experiment, ...]
    time_step: float
    weighting: str = "travel"
    loss: str = "linear"

    def problem(self, model: Model, parameters: Sequence[Parameter]) -> Problem:
        """Return the least-squares problem of a model with observed points and of parameters with start values."""
        model, filled = prepare(self.experiments, model, parameters)
        return Problem(list(self.experiments), model, filled, self.time_step, self.weighting)


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
        """Return half the sum of squared residuals of the recordings."""
        return 0.5 * float(self.residual @ self.residual)

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
    def information(self) -> Float[Array, "P P"]:
        """Return J^T J of the recordings and priors."""
        rows = self.problem.size * self.problem.all_known[0]
        return np.asarray(self.jacobian.T @ self.jacobian + rows.T @ rows)

    @cached_property
    def prior_weight(self) -> float:
        """Return the weight of priors that follows from the size of the residuals (see `Problem.learn_sizes`)."""
        problem = copy.copy(self.problem)
        problem.learn_sizes(self.x)
        return problem.size

    @cached_property
    def standard_errors(self) -> dict[str, float | None]:
        """Return the standard error (SI) of each free parameter by name; None for one that is not determined."""
        matrix = covariance(self.problem, self.x)
        return dict(zip(matrix.names, matrix.std, strict=True))

    def percent(self, residual: Float[Array, " N"]) -> dict[str, float]:
        """Return the RMS error [% of peak displacement] of each recording for weighted residuals (N,).

        Counted are positions or, in recordings without any, angles.
        """
        return {o.exp.name: percent_of(o, part) for o, part in self.problem.parted(residual)}


def percent_of(observed: Observations, residual: Array) -> float:
    """Return the RMS error [% of peak displacement] of one recording from its weighted residuals (N,)."""
    exp = observed.exp
    mine = observed.station < len(exp.stations)
    if observed.planar:
        mine &= (observed.channel == 2) == exp.without_positions
    off = (residual / observed.flat_weight)[mine]
    count = np.unique(observed.rows[mine] * len(exp.stations) + observed.station[mine]).size
    return float(100 * np.sqrt(np.sum(off**2) / max(count, 1)) / exp.travel)


def fitted(
    setting: FitSetting, model: Model, parameters: Sequence[Parameter], *, prior_weight: float | None = None,
    evaluations: int = EVALUATIONS,
) -> FittedModel:
    """Fit the free parameters from their start values, and return the optimum.

    Parameters
    ----------
    parameters : sequence of Parameter
        All with start values.
    prior_weight : float, optional
        Weight of the priors' residuals; default: that of a first fit.
    evaluations : int
        Highest number of evaluations; 0: the start values are taken as the optimum.

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
    if evaluations:
        end = solve(problem, problem.start, setting.loss, evaluations, tolerance=TOLERANCE)
        x, converged = end.x, end.status > 0
    residual = problem.data_residual(x)
    if problem.broken:
        raise FitError(problem.broken)
    return FittedModel(problem, x, residual, problem.data_jacobian(x), converged)
