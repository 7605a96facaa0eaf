"""Propagation of the covariance of fitted parameters to any quantity computed from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from statistics import NormalDist

import numpy as np

from pliant.failures import FAILED
from pliant.identification.result import FitResult

Array = np.ndarray
LEAST = 1e-6  # of the largest variance of scaled parameters: smaller ones are neglected


def half_widths(
    fitted: FitResult, measure: Callable[[Mapping[str, float]], Array], *, level: float = 0.95,
    problems: list[str] | None = None,
) -> Array:
    """Return half-widths of the confidence interval of quantities that `measure` computes from the parameters.

    The parameters are moved by one standard error to both sides along each principal direction of their covariance,
    within their bounds; half the difference of the results is that direction's contribution. This is exact for
    quantities linear in the parameters, and steadier than a derivative for others. Parameters of the training
    recordings alone, such as their edge times, are held constant.

    Parameters
    ----------
    fitted : FitResult
    measure : callable
        Takes parameter values by name and returns an array, always of the same shape; NaN for a missing value.
    problems : list of str, optional
        Every distinct reason why `measure` failed is appended to this list.

    Returns
    -------
    array
        Of the shape that `measure` returns; 0 where the fit has no covariance, NaN where `measure` fails or returns
        NaN.
    """
    here = np.asarray(measure(fitted.values), dtype=float)
    total = np.zeros_like(here)
    if fitted.covariance is None:
        return total
    own = tuple(f"{name}." for name in fitted.rmse)
    shared = [k for k, name in enumerate(fitted.covariance.names) if not name.startswith(own)]
    parameters = {p.name: p for p in fitted.parameters}
    chosen = [parameters[fitted.covariance.names[k]] for k in shared]
    size = np.array([p.scale or 1.0 for p in chosen])
    variance, directions = np.linalg.eigh(fitted.covariance.matrix[np.ix_(shared, shared)] / np.outer(size, size))
    for v, direction in zip(variance, directions.T, strict=True):
        if v <= LEAST * max(float(variance[-1]), 1e-300):
            continue
        ends = []
        for side in (-1.0, 1.0):
            moved = side * np.sqrt(v) * direction * size
            values = {p.name: float(np.clip(p.value + m, p.lower, p.upper)) for p, m in zip(chosen, moved, strict=True)}
            try:
                ends.append(np.asarray(measure({**fitted.values, **values}), dtype=float))
            except FAILED as error:
                if problems is not None and str(error) not in problems:
                    problems.append(str(error))
                ends.append(np.full_like(here, np.nan))
        total += (0.5 * (ends[1] - ends[0])) ** 2
    return np.asarray(NormalDist().inv_cdf(0.5 + 0.5 * level) * np.sqrt(total))
