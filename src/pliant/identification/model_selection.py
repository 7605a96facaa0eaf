"""Comparison of fitted models: determined parameters, BIC, and paired errors on held-out recordings."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.failures import finite
from pliant.identification.experiment import Experiment
from pliant.identification.fit import predict_held_out
from pliant.identification.parameters import Parameter, kind_of
from pliant.identification.problem import Problem
from pliant.identification.residuals import correlated_frames, falling_correlations
from pliant.identification.result import FitResult, touches_bound
from pliant.identification.uncertainty import information_criterion

Array = np.ndarray
DETERMINED = 0.5  # standard error over value, above which a parameter is not determined: its 95 % interval holds zero


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


def missed(exp: Experiment, result: FitResult, time_step: float) -> Array:
    """Return the squared error (T,) of each frame of a held-out recording, in (% of its peak displacement)^2.

    The mean over frames is the square of the recording's RMS error. Missing stations do not count.
    """
    prediction, _ = predict_held_out(exp, result, time_step=time_step)
    finite(prediction["compared"], "the modelled motion")
    square = np.sum((prediction["compared"] - exp.compared) ** 2, axis=-1)
    seen = np.isfinite(square)
    per_frame = np.where(seen, square, 0.0).sum(axis=1) * exp.time.size / seen.sum()
    return np.asarray(per_frame * (100 / exp.travel) ** 2)


def error(records: dict[str, Array]) -> float:
    """Return the mean over recordings of the RMS error [% of peak displacement], from squared errors per frame."""
    return float(np.mean([np.sqrt(m.mean()) for m in records.values()]))


def lead(one: dict[str, Array], other: dict[str, Array]) -> tuple[float, float]:
    """Return by how much the mean error of one model exceeds another's, and the standard error of this difference.

    Both refer to the same held-out recordings and are in % of the peak displacement, from the frame-by-frame
    differences of `missed` with their autocorrelation taken into account. With several recordings, the scatter between
    them gives the standard error where it is larger.

    Raises
    ------
    InputError
        When the recordings differ.
    """
    if one.keys() != other.keys() or not one:
        raise InputError(f"models must be compared on the same recordings, got {', '.join(one)} and {', '.join(other)}")
    gaps, variances = [], []
    for name, mine in one.items():
        theirs = other[name]
        size = max(np.sqrt(mine.mean()) + np.sqrt(theirs.mean()), 1e-300)  # d(root) from d(square)
        apart = (mine - theirs) / size
        r = (apart - apart.mean())[:, None]
        frames = 1.0 + 2.0 * sum(falling_correlations(r, 2.0 / np.sqrt(r.size)))
        gaps.append(apart.mean())
        variances.append(apart.var() * frames / r.size)
    within = np.sqrt(np.sum(variances)) / len(gaps)
    across = np.std(gaps, ddof=1) / np.sqrt(len(gaps)) if len(gaps) > 1 else 0.0
    return float(np.mean(gaps)), float(max(within, across))


def undetermined(result: FitResult, added: Collection[str]) -> dict[str, str]:
    """Return, by parameter name, a sentence about each fitted parameter that the recordings do not determine.

    Checked are the parameters `added` by a model, and every other one that must be positive. Parameters of a recording
    or a station, those with a prior, and those at a bound (unless added) are not checked.
    """
    found = {}
    for p in result.parameters:
        if not p.free or p.value is None or p.prior_std is not None or p.name.partition(".")[0] in result.rmse:
            continue
        own = p.name in added
        if not own and (kind_of(p.name).lower < 0 or touches_bound(p)):
            continue
        if own and touches_bound(p):
            found[p.name] = f"{p.name} ends at its bound of {p.value:.4g} {p.unit}"
        elif p.std is None:
            found[p.name] = f"{p.name} is not shown by the recordings"
        elif p.std > DETERMINED * abs(p.value):
            found[p.name] = f"{p.name} is known as {of_size(p)}"
    return found


def of_size(p: Parameter) -> str:
    """Return a parameter's value, standard error and unit as text, such as "0.12 +- 0.03 N m"."""
    return f"{p.value:.3g} +- {p.std:.2g} {p.unit}".removesuffix(" 1")
