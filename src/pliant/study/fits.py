"""Fits and model selection of a study: fit the training recordings, then predict the held-out ones with 95 % prediction
bands.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from pliant.failures import FAILED, Failures, finite
from pliant.identification import (
    Band,
    Experiment,
    FitResult,
    bootstrapped,
    fit,
    predict,
    predict_held_out,
)
from pliant.identification.fit import parameters_from
from pliant.identification.nested import parents
from pliant.identification.prediction import predict_body
from pliant.identification.prediction_bands import TrainingResiduals
from pliant.model import Model
from pliant.selection import ModelSelection, select_model, terms_for
from pliant.selection.result import RivalModel
from pliant.selection.saved import SearchFile
from pliant.simulation.time_step import LIMIT, nice, step_for, tip_error
from pliant.study.body import study_model
from pliant.study.schema import Fit, SelectionEntry, Study
from pliant.validation.metrics import compare
from pliant.validation.outcome import FitOutcome, RecordOutcome, Role

Notify = Callable[[str], None]
Array = np.ndarray


def run_fit(
    study: Study, name: str, experiments: Mapping[str, Experiment], model: Model, notify: Notify,
    nested: Mapping[str, FitResult],
) -> FitOutcome:
    """Fit the model to the training recordings and predict the held-out ones. The results of `nested` fits, which this
    one contains, are further starts.

    For a held-out recording, all parameters are held constant except its own edge times.
    """
    began, entry = clock.perf_counter(), study.fits[name]
    training = [experiments[r] for r in entry.train]
    result = fitted(study, entry, training, model, nested=nested, progress=lambda line: notify(f"fit {name}: {line}"))
    seconds = clock.perf_counter() - began
    return fit_outcome(study, name, entry.title or name, entry, result, seconds, experiments, notify)


def fitted(study: Study, entry: Fit, training: list[Experiment], model: Model, **more: Any) -> FitResult:
    """Return the fit of the model to training recordings with the options of an entry of the study, and `more` of
    `fit`.
    """
    return fit(
        training, model_for_fit(study, entry, model), parameters_from(entry.parameters), time_step=study.time_step,
        loss=entry.loss, starts=entry.starts, weighting=entry.weighting, regularise=entry.regularise,
        section_area=study.actuator.section_area, rng=study.seed, **more,
    )


def smaller_fits(study: Study, model: Model) -> dict[str, tuple[str, ...]]:
    """Return for each fit of a study the names of the largest fits that it contains: fits with the same recordings,
    weights and links, and fewer free parameters.
    """
    def alike(name: str) -> tuple[object, ...]:
        entry = study.fits[name]
        return (sorted(entry.train), entry.weighting, entry.loss, entry.links or model.n,
                entry.joint_placement or study.actuator.joint_placement)  # fmt: skip

    listed = {name: parameters_from(entry.parameters) for name, entry in study.fits.items()}
    return parents(listed, lambda one, other: alike(one) == alike(other))


def model_for_fit(study: Study, entry: Fit, model: Model) -> Model:
    """Return the study's model with the number of links and the joint placement of this fit."""
    if entry.joint_placement is None and entry.links is None:
        return model
    same = {"joint_placement": entry.joint_placement or study.actuator.joint_placement,
            "links": entry.links or model.n, "gravity": model.gravity.tolist()}  # fmt: skip
    return study_model(study.actuator.model_copy(update=same), None)


def fit_outcome(
    study: Study, name: str, title: str, entry: Fit | SelectionEntry, result: FitResult, seconds: float,
    experiments: Mapping[str, Experiment], notify: Notify,
) -> FitOutcome:
    """Return the predictions of a fitted model for each recording, and bootstrap standard errors if the study requests
    them.

    Results that cannot be computed (a recording, a band, the bootstrap) are listed in `not_computed` of the outcome.
    """
    failures = Failures(name, notify)
    train, held_out = ([experiments[r] for r in names] for names in (entry.train, entry.held_out))
    if entry.bootstrap and result.covariance is not None:
        notify(f"fit {name}: {entry.bootstrap} replicates of a block bootstrap")
        drawn = partial(bootstrapped, train, result, replicates=entry.bootstrap,
                        weighting=entry.weighting, loss=entry.loss, rng=study.seed)
        result = failures.attempt("bootstrap of standard errors", "", drawn) or result
    records = records_of(train, held_out, result, result.time_step, entry.weighting, failures)
    notify(f"fit {name}: {result.status}")
    return FitOutcome(name, title, result, records, seconds, tuple(failures))


def run_model_selection(
    study: Study, experiments: Mapping[str, Experiment], model: Model, notify: Notify, file: SearchFile | None = None,
) -> ModelSelection | None:
    """Run the study's model selection and return its result; None if the study has none. `file` keeps what is done."""
    entry = study.model_selection
    if entry is None:
        return None
    train = [experiments[r] for r in entry.train]
    return select_model(
        train, model, common=parameters_from(entry.common), minutes=entry.minutes,
        terms=terms_for(model, train, only=entry.terms, without=entry.without), time_step=study.time_step,
        weighting=entry.weighting, loss=entry.loss, rng=study.seed, file=file,
        progress=lambda line: notify(f"model selection: {line}"),
    )


def selection_fit(
    study: Study, selection: ModelSelection, experiments: Mapping[str, Experiment], notify: Notify,
) -> FitOutcome:
    """Return the results of the model that the model selection chose, in the same form as those of a fit."""
    entry = study.model_selection or SelectionEntry.model_validate({"train": []})
    outcome = fit_outcome(
        study, "model_selection", "Chosen terms", entry, selection.result, selection.seconds, experiments, notify,
    )
    return replace(outcome, records=tuple(with_rivals(r, selection.rivals) for r in outcome.records))


def with_rivals(record: RecordOutcome, rivals: Sequence[RivalModel]) -> RecordOutcome:
    """Return the record with a band that is wider where models that are almost as good predict something else. A rival
    that cannot follow the recording is left out.
    """
    apart = []
    for rival in rivals if record.band is not None else ():
        with suppress(*FAILED):
            apart.append(predicted_outcome(record.experiment, rival.result, rival.result.time_step)[0].modelled
                         - record.modelled)  # fmt: skip
    if record.band is None or not apart:
        return record
    band = record.band.widened(np.sqrt(np.mean(np.square(apart), axis=0)))
    return replace(record, band=band, metrics={
        **record.metrics, "within_band_percent": 100 * band.holds(record.experiment.compared)})


def outcome_of(
    exp: Experiment, role: Role, result: FitResult, values: Mapping[str, float], time_step: float,
) -> RecordOutcome:
    """Return the comparison of one recording with the motion that the fitted model predicts for it."""
    prediction = predict(result.model, exp, values, time_step)
    finite(prediction["compared"], "the modelled motion")
    metrics = compare(exp.synchronised(values), prediction["compared"], result.model.length)
    body = None if exp.without_positions else predict_body(result.model, exp, values, time_step)
    actuation = result.model.actuation
    return RecordOutcome(exp.name, role, exp, prediction["compared"], prediction["pressure"], metrics, body=body,
                         inputs=dict(zip(actuation.names, actuation.units, strict=True)))  # fmt: skip


def records_of(
    train: Sequence[Experiment], held_out: Sequence[Experiment], result: FitResult, time_step: float, weighting: str,
    failures: Failures,
) -> tuple[RecordOutcome, ...]:
    """Compare each training and held-out recording with the motion that the fitted model predicts for it, and return
    the comparisons.

    For a held-out recording, all parameters are held constant except its own edge times.

    A recording whose motion cannot be computed is added to `failures` and left out. One whose band cannot be
    computed is added to `failures` and returned without a band.
    """
    records: list[RecordOutcome] = []
    for exp in train:
        followed = partial(outcome_of, exp, "train", result, result.values, time_step)
        if (record := failures.attempt("prediction", exp.name, followed, "train")) is not None:
            records.append(record)
            warn_of_step(record, result, result.values, time_step, failures)
    left = TrainingResiduals([r.experiment for r in records], [r.modelled for r in records], weighting)
    for exp in held_out:
        forecast = partial(predicted_outcome, exp, result, time_step)
        predicted = failures.attempt("prediction", exp.name, forecast, "held_out")
        if predicted is None:
            continue
        record, refit = predicted
        warn_of_step(record, refit, refit.values, time_step, failures)
        if result.covariance is not None and left.train:
            banded = partial(band_of, left, result, record, refit, time_step)
            if (band := failures.attempt("band", exp.name, banded, "held_out")) is not None:
                coverage = 100 * band.holds(exp.compared)
                record = replace(record, metrics={**record.metrics, "within_band_percent": coverage}, band=band)
        records.append(record)
    return tuple(records)


def warn_of_step(
    record: RecordOutcome, result: FitResult, values: Mapping[str, float], time_step: float, failures: Failures,
) -> None:
    """Warn if the time step [s] may change the tip position of a recording by more than 1 % of the body's length, after
    its warm-up.
    """
    model, exp = result.model, record.experiment
    if exp.poses:  # equilibria, computed without time steps
        return

    def tips(h: float) -> Array:
        return predict_body(model, exp, values, h)[compared, -1] / model.length

    compared = ~exp.warming
    tips_used = tips(time_step) if record.body is None else record.body[compared, -1] / model.length
    error = tip_error(lambda factor: (tips_used, tips(factor * time_step)))
    if error > LIMIT and failures.warn is not None:
        size = f"by {1e3 * error * model.length:.3g} mm" if np.isfinite(error) else "by an unknown amount"
        failures.warn(
            f"warning: fit {failures.fit}: the simulated tip of record {exp.name} may be wrong {size}: the "
            f"step of {1e3 * time_step:.3g} ms is too long for its motion; set time_step = "
            f"{nice(time_step * step_for(error)):g} in the study"
        )


def predicted_outcome(exp: Experiment, result: FitResult, time_step: float) -> tuple[RecordOutcome, FitResult]:
    """Return the comparison of a held-out recording with its prediction. If its pressure was not measured, the times at
    which the pressure rises and falls are fitted to the recording; the result of this fit is returned too.
    """
    _, refit = predict_held_out(exp, result, time_step=time_step)
    record = outcome_of(exp, "held_out", refit, refit.values, time_step)
    edges = {p.name.removeprefix(f"{exp.name}."): refit.values[p.name] for p in refit.parameters if p.free}
    return replace(record, metrics={**record.metrics, **({"fitted_edges_s": edges} if edges else {})}), refit


def band_of(
    left: TrainingResiduals, result: FitResult, record: RecordOutcome, refit: FitResult, time_step: float,
) -> Band:
    """Return the 95 % band of a prediction, from the parameters' uncertainty and the training residuals `left`."""
    band = left.band(record.experiment, result, record.modelled, refit, time_step=time_step)
    finite(band.std, "the width of the band")
    return band
