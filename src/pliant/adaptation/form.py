"""Errors of a model's form in the parameters of the mounting, as recordings of the earlier day show them.

A model that lacks something is followed more closely with a mounting that is a little wrong. The same fit of recordings
in whose time nothing moved shows by how much.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pliant.adaptation.change import spaced
from pliant.adaptation.mounting import of_mounting
from pliant.failures import FAILED
from pliant.identification.experiment import Experiment
from pliant.identification.fit import FitResult
from pliant.identification.uncertainty import Covariance

Array = np.ndarray
MOST_EARLIER = 3  # recordings of the earlier day that are fitted as the new one


def mounting_of_earlier(
    earlier: Callable[[], Sequence[Experiment]], fit_alike: Callable[[Experiment], FitResult],
) -> list[dict[str, float]]:
    """Return by how much (SI) the same fit moves the mounting in up to three recordings of the earlier day, by name."""
    moves = []
    for exp in spaced(earlier(), MOST_EARLIER):
        try:
            result = fit_alike(exp)
        except FAILED:  # such as a recording whose first seconds hold no motion
            continue
        moves.append({p.name: p.value - p.prior for p in result.parameters
                      if p.free and of_mounting(p.name) and p.value is not None and p.prior is not None})  # fmt: skip
    return moves


def with_error_of_form(result: FitResult, moves: Sequence[Mapping[str, float]]) -> FitResult:
    """Return the fit of a day whose standard errors include the moves (SI) of the mounting in K earlier recordings: the
    mean square of these moves, for another recording (1 + 1 / K) of it. No prior is left with less certainty than it
    states.
    """
    covariance = result.covariance
    if covariance is None or not moves:
        return result
    names = covariance.names
    away = np.array([[m.get(n, 0.0) for n in names] for m in moves])
    form = (1.0 + 1.0 / len(moves)) * away.T @ away / len(moves)
    priors = {p.name: p.prior_std for p in result.parameters if p.prior_std}
    left = np.array([priors.get(n, np.inf) for n in names]) ** 2 - np.diag(covariance.total)
    size = np.diag(form)
    part = np.sqrt(np.minimum(np.divide(np.maximum(left, 0.0), size, out=np.ones_like(size), where=size > 0), 1.0))
    return with_covariance(result, covariance._replace(
        form=(0.0 if covariance.form is None else covariance.form) + np.outer(part, part) * form))  # fmt: skip


def with_covariance(result: FitResult, covariance: Covariance) -> FitResult:
    """Return a fit with another covariance of its parameters, from which their standard errors follow."""
    doubt = dict(zip(covariance.names, covariance.doubt, strict=True))
    parameters = tuple(p.with_(std=doubt[p.name]) if p.name in doubt else p for p in result.parameters)
    before = result.covariance.note if result.covariance else ""
    notes = tuple(covariance.note if before and note == before else note for note in result.notes)
    return replace(result, covariance=covariance, parameters=parameters, notes=notes)
