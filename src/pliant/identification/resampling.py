"""Block bootstrap of a fit: refits to data whose residuals are resampled in blocks, which keep their correlation in
time.
"""

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
from pliant.shapes import Float

Array = np.ndarray
FEWEST = 20  # replicates that a covariance needs


def bootstrapped(
    experiments: Sequence[Experiment], fitted: FitResult, *, replicates: int = 200, time_step: float | None = None,
    weighting: str = "travel", loss: str = "linear", rng: np.random.Generator | int | None = 0,
) -> FitResult:
    """Return the fit with covariance and standard errors estimated by a block bootstrap of its residuals.

    The arguments are those of `bootstrap`.

    Raises
    ------
    InputError
        When the fit has no covariance, or there are fewer than 20 replicates.
    """
    if fitted.covariance is None:
        raise InputError("a bootstrap needs the covariance of a fit: fit with at least one free parameter")
    if replicates < FEWEST:
        raise InputError(f"a bootstrap needs at least {FEWEST} replicates, got {replicates}: raise their number")
    _, values = bootstrap(
        experiments, fitted, replicates=replicates, time_step=time_step, weighting=weighting, loss=loss, rng=rng
    )
    redrawn = fitted.covariance._replace(matrix=np.atleast_2d(np.cov(values.T)), source="block bootstrap", clusters="")
    errors = dict(zip(redrawn.names, redrawn.doubt, strict=True))
    parameters = tuple(p.with_(std=errors.get(p.name)) for p in fitted.parameters)
    note = f"Standard errors come from {replicates} block-bootstrap replicates: residuals stay correlated in time."
    notes = tuple(n for n in fitted.notes if n != fitted.covariance.note)
    return replace(fitted, parameters=parameters, covariance=redrawn, notes=(*notes, note))


def bootstrap(
    experiments: Sequence[Experiment], fitted: FitResult, *, replicates: int = 200, block: int | None = None,
    time_step: float | None = None, weighting: str = "travel", loss: str = "linear",
    rng: np.random.Generator | int | None = 0,
) -> tuple[tuple[str, ...], Float[Array, "R P"]]:
    """Return the names of P free parameters, and their values (replicates, P) from refits to synthetic data: the
    modelled motion plus residuals resampled in blocks of frames.

    Parameters
    ----------
    experiments : sequence of Experiment
        The experiments of the fit.
    fitted : FitResult
    replicates : int
        Number R of refits.
    block : int, optional
        Frames in a block; default: twice the correlation length of the residuals.
    time_step : float, optional
        Longest time step, s; default: that of the fit.
    weighting, loss : str
        Those of the fit.
    rng : numpy.random.Generator, int or None
        Random generator or seed.

    Returns
    -------
    names : tuple of str
        The P free parameters.
    values : array (R, P)
        Their values in each refit, SI. Percentiles of a column give a confidence interval.
    """
    free = [p for p in fitted.parameters if p.free]
    generator = np.random.default_rng(rng)
    time_step = time_step or fitted.time_step
    base = Problem(list(experiments), fitted.model, list(fitted.parameters), time_step, weighting)
    parts = base.parted(base.data_residual(base.start))
    frames = [block or int(np.ceil(2 * correlated_frames(o, r))) for o, r in parts]
    motions = [predict(fitted.model, e, fitted.values, time_step)["compared"] for e in experiments]
    drawn = []
    for _ in range(replicates):
        again = [
            with_drawn(e, redrawn(e, p, width, generator))
            for e, p, width in zip(experiments, motions, frames, strict=True)
        ]
        problem = Problem(again, fitted.model, list(fitted.parameters), time_step, weighting)
        drawn.append(solve(problem, problem.start, loss, 20).x * problem.scale)
    return tuple(p.name for p in free), np.array(drawn)


def with_drawn(exp: Experiment, drawn: Array) -> Experiment:
    """Return the experiment with its observations of S stations in T frames replaced by `drawn`: positions (T, S, 2 or
    3) [m], angles (T, S, 1) [rad] or values of a further variable (T, S, d).
    """
    if exp.alone in exp.further:
        rows = exp.further[exp.alone]
        return replace(exp, further={**exp.further, exp.alone: rows._replace(values=drawn.reshape(rows.values.shape))})
    return replace(exp, angle=drawn[..., 0]) if exp.without_positions else replace(exp, position=drawn)


def redrawn(exp: Experiment, motion: Array, width: int, rng: np.random.Generator) -> Array:
    """Return synthetic observations (T, S, 2 or 3), or (T, S, 1) for angles, of S stations in T frames: the modelled
    motion plus residuals in randomly drawn blocks of frames.

    A block has `width` frames. Blocks wrap around the end, so that every frame is drawn with equal probability.
    Residuals are not centred: the mean error of the model stays. Missing observations stay missing, those of a
    warm-up stay as they are, and a missing residual counts as 0.

    Source: Politis and Romano (1992), the circular block bootstrap
    """
    residual = exp.compared - motion
    count = exp.time.size
    first = rng.integers(count, size=-(-count // width))
    index = ((first[:, None] + np.arange(width)) % count).ravel()[:count]
    drawn = np.nan_to_num(residual[index], nan=0.0)
    return np.where(np.isfinite(exp.compared), motion + drawn, exp.recorded)
