"""Comparison of wirings (which recorded pressure drives which chamber) by their fit to the training recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import permutations
from typing import NamedTuple

import numpy as np
import xarray as xr

from pliant.errors import FitError, InputError
from pliant.failures import FAILED
from pliant.identification import Experiment
from pliant.identification.problem import Problem
from pliant.model import Model
from pliant.selection.criterion import effective_numbers
from pliant.study.fits import fitted
from pliant.study.prepare import study_experiment
from pliant.study.schema import Study
from pliant.validation.outcome import WiringRow, Wirings

Drive = dict[str, str | int]
STATED = "as stated"
MOST = 24  # wirings to try if the study lists none: all permutations of four chambers


class WiredFit(NamedTuple):
    """How well a fit with one wiring matches the training recordings."""

    mean_square: float  # of the residuals, weighted alike for every wiring
    numbers: float  # effective number of independent residuals
    percent: float  # mean error of the recordings, % of the peak displacement


def candidates(study: Study) -> dict[str, Drive]:
    """Return a dict of the wirings to compare: those that the study lists or, if it lists none, all permutations of the
    pressures in the wiring that its recordings state.

    Raises
    ------
    InputError
        When the study lists no wirings and the recordings do not state exactly one, or when there are more than 24
        permutations.
    """
    assert study.wiring is not None
    stated = list({tuple(sorted(r.drive.items())): r.drive for r in study.recordings.values() if r.drive}.values())
    if study.wiring.drives:
        return ({STATED: stated[0]} if len(stated) == 1 else {}) | dict(study.wiring.drives)
    if len(stated) != 1:
        raise InputError("[wiring] has no wirings to compare: list them as [wiring.drives.NAME], or state the same "
                         "drive in all recordings")
    chambers, pressures = list(stated[0]), list(stated[0].values())
    orders = list(permutations(pressures))
    if len(orders) > MOST:
        raise InputError(f"[wiring] would compare {len(orders)} wirings: list up to {MOST} as [wiring.drives.NAME]")
    return {
        STATED if list(order) == pressures else ", ".join(f"{c} = {p}" for c, p in zip(chambers, order, strict=True)):
        dict(zip(chambers, order, strict=True)) for order in orders
    }


def compare_wirings(
    study: Study, recordings: Mapping[str, xr.Dataset], model: Model, notify: Callable[[str], None],
) -> Wirings | None:
    """Fit the model with every candidate wiring to the training recordings of one fit, and rank the wirings by
    likelihood.

    Held-out recordings are not used. All candidates have the same free parameters, so that their likelihoods can be
    compared directly: 2 ln L = -N ln(mean square residual), with N the independent residuals of the best candidate.

    Raises
    ------
    FitError
        When no candidate can be fitted.
    """
    if study.wiring is None:
        return None
    name = study.wiring.fit or next(iter(study.fits))
    fits: dict[str, WiredFit] = {}
    failed: dict[str, str] = {}
    for label, drive in candidates(study).items():
        try:
            fits[label] = fit_statistics(study, name, wired_experiments(study, recordings, name, drive), model)
            notify(f"wiring {label}: training error {fits[label].percent:.2f} % of the peak displacement")
        except FAILED as error:
            failed[label] = str(error)
            notify(f"wiring {label}: {error}")
    if not fits:
        raise FitError(f"no wiring can be fitted: {next(iter(failed.values()))}")
    order = sorted(fits, key=lambda label: fits[label].mean_square)
    best = fits[order[0]]
    rows = [
        WiringRow(label, fits[label].percent, best.numbers * float(np.log(fits[label].mean_square / best.mean_square)))
        for label in order
    ]
    return Wirings(name, (*rows, *(WiringRow(label, None, None, reason) for label, reason in failed.items())))


def wired_experiments(
    study: Study, recordings: Mapping[str, xr.Dataset], fit_name: str, drive: Drive,
) -> list[Experiment]:
    """Return the training experiments of a fit in which `drive` states the recorded pressure that drives each
    chamber.
    """
    names = study.fits[fit_name].train
    entries = {n: study.recordings[n].model_copy(update={"drive": drive}) for n in names}
    other = study.model_copy(update={"recordings": study.recordings | entries})
    return [study_experiment(other, n, recordings[n]) for n in names]


def fit_statistics(study: Study, name: str, training: list[Experiment], model: Model) -> WiredFit:
    """Fit the model to training recordings with one assignment of recorded pressures to chambers; return the statistics
    of the residuals.
    """
    entry = study.fits[name]
    result = fitted(study, entry, training, model)
    error = float(np.mean([100 * result.rmse[e.name] / e.travel for e in training]))
    problem = Problem(training, result.model, list(result.parameters), result.time_step, entry.weighting)
    residual = problem.data_residual(problem.start)
    return WiredFit(float(np.mean(residual**2)), effective_numbers(problem, residual), error)


def wiring_warnings(wirings: Wirings | None) -> tuple[str, ...]:
    """Return a warning if another wiring than the stated one fits the training recordings best; else ()."""
    if wirings is None or wirings.winner.name == STATED or STATED not in {r.name for r in wirings.rows}:
        return ()
    return (f"{wirings.sentence} The recordings state a different wiring: check which pressure drives which chamber.",)
