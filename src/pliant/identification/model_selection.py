"""Comparison of models fitted to the same recordings, by their information criterion (BIC)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pliant.identification.experiment import Experiment
from pliant.identification.problem import Problem
from pliant.identification.residuals import correlated_frames
from pliant.identification.result import FitResult
from pliant.identification.uncertainty import information_criterion


class Follows(NamedTuple):
    """How well a fit matches its training recordings, in units that are the same for all fits to these recordings."""

    mean_square: float  # of the residuals, weighted alike for every model
    numbers: float  # effective number of independent observed values, given the residuals' correlation
    free: int  # number of free parameters, edge times of the recordings included

    def bic(self, numbers: float) -> float:
        """Return the Bayesian information criterion of the fit for `numbers` effectively independent residuals."""
        return information_criterion(self.mean_square, numbers, self.free)


def follows(train: Sequence[Experiment], result: FitResult, time_step: float, weighting: str) -> Follows:
    """Return how well the fit `result` matches the training recordings.
    Residuals have the same weights for all fits.
    """
    problem = Problem(list(train), result.model, list(result.parameters), time_step, weighting)
    r = problem.data_residual(problem.start)
    numbers = sum(part.size / correlated_frames(o, part) for o, part in problem.parted(r))
    return Follows(float(np.mean(r**2)), float(numbers), len(problem.free))


def shared_bic(fits: Sequence[Follows]) -> list[float]:
    """Return the BIC of several models fitted to the same recordings, all with the best model's effective sample size.

    Residuals of a poor model are correlated for longer and hold fewer independent values. With each model's own count
    the criteria could not be compared.
    """
    numbers = min(fits, key=lambda f: f.mean_square).numbers
    return [f.bic(numbers) for f in fits]
