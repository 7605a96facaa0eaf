"""Records of a study beside the model of a fit, those that it has not seen with the band of their prediction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from pliant.identification import Experiment, FitResult, predict, predict_held_out, prediction_band, residual_noise
from pliant.identification.experiment import predict_body
from pliant.validation.metrics import compare
from pliant.validation.outcome import RecordOutcome, Role


def outcome_of(
    exp: Experiment, role: Role, result: FitResult, values: Mapping[str, float], step: float,
) -> RecordOutcome:
    """One record beside the model of a fit."""
    prediction = predict(result.model, exp, values, step)
    metrics = compare(exp.synchronised(values), prediction["compared"], result.model.length)
    body = None if exp.placeless else predict_body(result.model, exp, values, step)
    return RecordOutcome(exp.name, role, exp, prediction["compared"], prediction["pressure"], metrics, body=body)


def records_of(
    train: Sequence[Experiment], held_out: Sequence[Experiment], result: FitResult, step: float, weighting: str,
) -> tuple[RecordOutcome, ...]:
    """The training records as followed; the held-out ones as predicted, everything frozen but their edge times."""
    records = [outcome_of(exp, "train", result, result.values, step) for exp in train]
    for exp in held_out:
        _, own = predict_held_out(exp, result, step=step)
        made = outcome_of(exp, "held_out", own, own.values, step)
        if result.covariance is not None:
            noise = residual_noise(train, result, exp, made.modelled, step=step, weighting=weighting)
            band = prediction_band(exp, result, step=step, noise=noise, own=own, taught=train)
            held = 100 * band.holds(exp.compared)
            made = replace(made, metrics={**made.metrics, "within_band_percent": held}, band=band)
        records.append(made)
    return tuple(records)
