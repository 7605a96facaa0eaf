"""Fits to residuals drawn again in blocks, which keep their correlation: the block bootstrap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pliant.errors import InputError
from pliant.identification.experiment import Experiment
from pliant.identification.optimise import solve
from pliant.identification.prediction import predict
from pliant.identification.problem import Problem
from pliant.identification.residuals import correlated_frames
from pliant.identification.result import FitResult

Array = np.ndarray
FEWEST = 20  # replicates of a bootstrap, of which a covariance can be taken


def bootstrapped(
    experiments: Sequence[Experiment], fitted: FitResult, *, replicates: int = 200, step: float = 2e-3,
    weighting: str = "travel", loss: str = "linear", rng: np.random.Generator | int | None = 0,
) -> FitResult:
    """The fit with covariance and standard errors from `bootstrap`; reports and bands then rest on it.

    Raises
    ------
    InputError
        When the fit has no covariance, or the replicates are too few for one.
    """
    if fitted.covariance is None or replicates < FEWEST:
        raise InputError(f"a bootstrap needs a fit with free parameters and {FEWEST} replicates, got {replicates}")
    _, values = bootstrap(
        experiments, fitted, replicates=replicates, step=step, weighting=weighting, loss=loss, rng=rng
    )
    found = fitted.covariance._replace(matrix=np.atleast_2d(np.cov(values.T)), source="block bootstrap")
    errors = dict(zip(found.names, found.std, strict=True))
    parameters = tuple(p.with_(std=errors.get(p.name)) for p in fitted.parameters)
    note = f"Standard errors come from {replicates} replicates that keep residuals correlated as they are."
    return replace(fitted, parameters=parameters, covariance=found, notes=(*fitted.notes, note))


def bootstrap(
    experiments: Sequence[Experiment], fitted: FitResult, *, replicates: int = 200, block: int | None = None,
    step: float = 2e-3, weighting: str = "travel", loss: str = "linear",
    rng: np.random.Generator | int | None = 0,
) -> tuple[tuple[str, ...], Array]:
    """Parameters (R, P), SI, of fits to the model's motion plus its own residuals, drawn again in blocks of frames.

    Parameters
    ----------
    experiments : sequence of Experiment
        Those of the fit.
    block : int, optional
        Frames in a block; default: twice as many as residuals are correlated over.
    weighting, loss : str
        Those of the fit.

    Returns
    -------
    names, values
        Of the free parameters; percentiles of a column are an interval.
    """
    free = [p for p in fitted.parameters if p.free]
    generator = np.random.default_rng(rng)
    base = Problem(list(experiments), fitted.model, list(fitted.parameters), step, weighting)
    parts = np.split(base.data_residual(base.start), base.ends[:-1])
    frames = [block or int(np.ceil(2 * correlated_frames(o, r))) for o, r in zip(base.observed, parts, strict=True)]
    motions = [predict(fitted.model, e, fitted.values, step)["compared"] for e in experiments]
    drawn = []
    for _ in range(replicates):
        again = [
            with_drawn(e, redrawn(e, p, width, generator))
            for e, p, width in zip(experiments, motions, frames, strict=True)
        ]
        problem = Problem(again, fitted.model, list(fitted.parameters), step, weighting)
        drawn.append(solve(problem, problem.start, loss, 20).x * problem.scale)
    return tuple(p.name for p in free), np.array(drawn)


def with_drawn(exp: Experiment, drawn: Array) -> Experiment:
    """The experiment with other places (T, S, 2), or angles (T, S, 1) where it holds those alone."""
    return replace(exp, angle=drawn[..., 0]) if exp.without_positions else replace(exp, position=drawn)


def redrawn(exp: Experiment, motion: Array, width: int, rng: np.random.Generator) -> Array:
    """Return compared values (T, S, 2 or 1) for a bootstrap: the modelled motion plus residual blocks of `width`
    frames, reordered.

    Blocks wrap around the end, so that every frame is drawn alike; residuals are not centred: what the model leaves on
    average stays. What was not seen stays so, and a residual that is missing where it is drawn to is replaced by none.

    Source: Politis and Romano (1992), the circular block bootstrap
    """
    residual = exp.compared - motion
    count = exp.time.size
    first = rng.integers(count, size=-(-count // width))
    index = ((first[:, None] + np.arange(width)) % count).ravel()[:count]
    drawn = np.nan_to_num(residual[index], nan=0.0)
    return np.where(np.isfinite(exp.compared), motion + drawn, np.nan)
