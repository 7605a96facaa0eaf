"""Comparison of each recording of a study with a fitted model, with prediction bands for the held-out ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pliant.failures import Failures, finite
from pliant.identification import (
    Band,
    Experiment,
    FitResult,
    predict,
    predict_held_out,
    prediction_band,
    residual_noise,
)
from pliant.identification.prediction import predict_body
from pliant.simulation.accuracy import LIMIT, step_for, tip_error
from pliant.simulation.time_step import nice
from pliant.validation.metrics import compare
from pliant.validation.outcome import RecordOutcome, Role

Array = np.ndarray


def outcome_of(
    exp: Experiment, role: Role, result: FitResult, values: Mapping[str, float], step: float,
) -> RecordOutcome:
    """Return the comparison of one recording with the motion that the fitted model predicts for it."""
    prediction = predict(result.model, exp, values, step)
    finite(prediction["compared"], "the modelled motion")
    metrics = compare(exp.synchronised(values), prediction["compared"], result.model.length)
    body = None if exp.without_positions else predict_body(result.model, exp, values, step)
    actuation = result.model.actuation
    return RecordOutcome(exp.name, role, exp, prediction["compared"], prediction["pressure"], metrics, body=body,
                         inputs=dict(zip(actuation.names, actuation.units, strict=True)))  # fmt: skip


def records_of(
    train: Sequence[Experiment], held_out: Sequence[Experiment], result: FitResult, step: float, weighting: str,
    failures: Failures,
) -> tuple[RecordOutcome, ...]:
    """Return the outcomes of the training recordings and of the held-out ones, predicted by the fit.

    For a held-out recording, all parameters are held constant except its own edge times.

    A recording whose motion cannot be computed is added to `failures` and left out. One whose band cannot be
    computed is added to `failures` and returned without a band.
    """
    records = []
    for exp in train:
        followed = partial(outcome_of, exp, "train", result, result.values, step)
        if (made := failures.attempt("prediction", exp.name, followed, "train")) is not None:
            records.append(made)
            warn_of_step(made, result, result.values, step, failures)
    for exp in held_out:
        predicted = failures.attempt("prediction", exp.name, partial(held_out_of, exp, result, step), "held_out")
        if predicted is None:
            continue
        made, own = predicted
        warn_of_step(made, own, own.values, step, failures)
        if result.covariance is not None:
            banded = partial(band_of, train, result, made, own, step, weighting)
            if (band := failures.attempt("band", exp.name, banded, "held_out")) is not None:
                held = 100 * band.holds(exp.compared)
                made = replace(made, metrics={**made.metrics, "within_band_percent": held}, band=band)
        records.append(made)
    return tuple(records)


def warn_of_step(
    made: RecordOutcome, result: FitResult, values: Mapping[str, float], step: float, failures: Failures,
) -> None:
    """Warn if the time step [s] may change the tip position of a recording by more than 1 % of the body's length."""
    model, exp = result.model, made.experiment
    if exp.poses:  # equilibria, computed without time steps
        return

    def tips(h: float) -> Array:
        return predict_body(model, exp, values, h)[:, -1] / model.length

    given = tips(step) if made.body is None else made.body[:, -1] / model.length
    error = tip_error(lambda factor: (given, tips(factor * step)))
    if error > LIMIT and failures.warn is not None:
        size = f"by {1e3 * error * model.length:.3g} mm" if np.isfinite(error) else "by an unknown amount"
        failures.warn(
            f"warning: fit {failures.fit}: the tip of record {exp.name} may be wrong {size}: the step of "
            f"{1e3 * step:.3g} ms is too long for its motion; set step = {nice(step * step_for(error)):g} in the study"
        )


def held_out_of(exp: Experiment, result: FitResult, step: float) -> tuple[RecordOutcome, FitResult]:
    """Return the outcome of a held-out recording, and the fit of its edge times."""
    _, own = predict_held_out(exp, result, step=step)
    made = outcome_of(exp, "held_out", own, own.values, step)
    edges = {p.name.removeprefix(f"{exp.name}."): own.values[p.name] for p in own.parameters if p.free}
    return replace(made, metrics={**made.metrics, **({"fitted_edges_s": edges} if edges else {})}), own


def band_of(
    train: Sequence[Experiment], result: FitResult, made: RecordOutcome, own: FitResult, step: float, weighting: str,
) -> Band:
    """Return the 95 % band of a prediction, from the parameters' uncertainty and the noise of the training
    residuals.
    """
    exp = made.experiment
    noise = residual_noise(train, result, exp, made.modelled, step=step, weighting=weighting)
    band = prediction_band(exp, result, step=step, noise=noise, own=own, training=train)
    finite(band.std, "the width of the band")
    return band
