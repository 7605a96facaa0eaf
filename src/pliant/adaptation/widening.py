"""How far the body of another day may differ from the earlier fit, judged by parts of the seconds that are left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pliant.adaptation.posterior import Posterior
from pliant.identification.experiment import Experiment
from pliant.identification.fit import FitResult
from pliant.identification.joint_prior import JointPrior
from pliant.identification.problem import Problem, known_rows
from pliant.identification.residuals import Observations

Array = np.ndarray
FACTORS = (1.0, 4.0, 16.0, 64.0)  # on the covariance of the body
BLOCKS = 5  # of the fitted seconds
RIDGE = 1e-13  # of the trace of the information, for directions that nothing determines
CLEAR = 0.8  # of the squared left-out error: a wider prior must reach this to be preferred


def widened_body(posterior: Posterior, factor: float) -> Posterior:
    """Return a posterior whose covariance of the body is multiplied by a factor."""
    return replace(posterior, body=replace(posterior.body, covariance=factor * posterior.body.covariance))


def body_factor(
    posterior: Posterior, experiments: Sequence[Experiment], result: FitResult, *, weighting: str, least_error: float,
) -> float:
    """Return the factor on the covariance of the body with which parts of the fitted seconds are predicted best from
    the other parts.

    The covariance of a fit holds the noise that the fit saw. What its model lacks moves the parameters farther from day
    to day. The model is linearised at the fit, so that no part needs a fit of its own. A wider prior must lower the
    squared error of the left-out parts by a fifth.
    """
    problem = Problem(list(experiments), result.model, list(result.parameters), result.time_step, weighting,
                      posterior.prior)  # fmt: skip
    problem.least_error = least_error
    x = problem.start
    problem.learn_sizes(x)
    residual, jacobian = problem.data_residual(x), problem.data_jacobian(x)
    blocks = blocks_of(problem.parted(np.arange(residual.size)))
    if len(blocks) < BLOCKS or problem.broken:
        return 1.0
    errors = [left_out_error(problem, x, residual, jacobian, blocks, widened_body(posterior, f).prior) for f in FACTORS]
    best, factor = errors[0], FACTORS[0]
    for error, wider in zip(errors[1:], FACTORS[1:], strict=True):
        if error < CLEAR * best:
            best, factor = error, wider
    return factor


def blocks_of(parted: Sequence[tuple[Observations, Array]]) -> list[Array]:
    """Return the indices of the residuals of each of the blocks of each recording: consecutive frames of equal number
    among those that were compared.
    """
    blocks = []
    for observed, index in parted:
        frames = np.unique(observed.rows)
        place = np.searchsorted(frames, observed.rows) * BLOCKS // max(frames.size, 1)
        blocks += [index[place == k] for k in range(BLOCKS)]
    return [b for b in blocks if b.size]


def left_out_error(
    problem: Problem, x: Array, residual: Array, jacobian: Array, blocks: Sequence[Array], prior: JointPrior,
) -> float:
    """Return the sum of squared residuals of left-out blocks, each predicted from the others with a `prior`, for the
    model linearised at the scaled parameters x (P,), with residuals (N,) and their Jacobian (N, P) there.
    """
    rows, aim = known_rows(problem.free, problem.scale, problem.start, prior)
    known, off = problem.size * rows, problem.size * (rows @ x - aim)
    information = jacobian.T @ jacobian + known.T @ known
    information += RIDGE * float(np.trace(information)) * np.eye(len(x))
    step = -np.linalg.solve(information, jacobian.T @ residual + known.T @ off)
    after, total = residual + jacobian @ step, 0.0
    for block in blocks:
        J = jacobian[block]
        inside = np.eye(block.size) - J @ np.linalg.solve(information, J.T)
        total += float(np.sum(np.linalg.lstsq(inside, after[block], rcond=1e-9)[0] ** 2))
    return total
