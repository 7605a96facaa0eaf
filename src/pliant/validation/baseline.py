"""The plain map of a fit: fitted to the fit's training recordings, compared with its model on every recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.identification.experiment import Experiment
from pliant.simulation import Trace
from pliant.validation.explained import Residual, explained, suggestion
from pliant.validation.metrics import compare
from pliant.validation.outcome import Baseline, FitOutcome, RecordOutcome
from pliant.validation.plain_map import PlainMap
from pliant.validation.wording import sized

Array = np.ndarray
MOST_NAMED = 3  # recordings that a sentence lists
BETTER = 0.95  # of the model's error: a smaller error of the plain map is better
Spare = Mapping[str, Mapping[str, Trace]]


class Mapped(NamedTuple):
    """The prediction of a plain map for one recording."""

    predicted: Array  # (T, S, d), m or rad
    metrics: dict[str, Any]
    outside: float  # % of the frames beyond the range of the training inputs


def mapped(plain: PlainMap, exp: Experiment, length: float) -> Mapped | str:
    """Return the prediction of a plain map for a recording of a body of this length [m], or why there is none."""
    try:
        predicted = plain.predict(exp)
    except InputError as error:
        return f"The plain map does not predict {exp.name}: {error}."
    return Mapped(predicted, compare(exp, predicted, length), 100 * plain.outside(exp))


def with_baseline(
    fit: FitOutcome, plain: PlainMap, spare: Spare | None = None, known: Mapping[str, Mapped | str] | None = None,
) -> FitOutcome:
    """Return a fit with the predictions of a plain map for each of its recordings.

    `spare` holds, by recording, the recorded inputs that drive no input of the model; `known` holds predictions of the
    map that exist already. Where the map is better than the model on held-out recordings, the baseline says what the
    model's residual suggests.
    """
    unit, factor = plain.unit
    done = {r.name: (known or {}).get(r.name) or mapped(plain, r.experiment, fit.result.model.length)
            for r in fit.records}
    good = {name: one for name, one in done.items() if isinstance(one, Mapped)}
    records = tuple(replace(r, baseline=good[r.name].predicted) if r.name in good else r for r in fit.records)
    metrics = {r.name: {"role": r.role, **good[r.name].metrics} for r in records if r.name in good}
    better = [r for r in records if r.role == "held_out" and r.name in good and is_better(metrics[r.name], r.metrics)]
    fractions = explained([residual_of(r, fit, spare or {}) for r in better], plain.table) if better else {}
    baseline = Baseline(
        plain.title, plain.degree, plain.time_constants, plain.ridge, plain.held, plain.inputs, plain.coefficients.size,
        plain.frames, unit, factor * plain.left_out_error if np.isfinite(plain.left_out_error) else None,
        factor * plain.training_error, (*plain.notes, *(one for one in done.values() if isinstance(one, str))), metrics,
        {name: one.outside for name, one in good.items()}, tuple(r.name for r in better), fractions,
        suggestion(fractions) if better else "",
    )
    return replace(fit, records=records, baseline=baseline)


def is_better(plain: Mapping[str, Any], model: Mapping[str, Any]) -> bool:
    """Return whether the plain map's error of a recording is clearly smaller than the model's."""
    return bool(sized(dict(plain), "rmse")[0] < BETTER * sized(dict(model), "rmse")[0])


def residual_of(record: RecordOutcome, fit: FitOutcome, spare: Spare) -> Residual:
    """Return what the model leaves of a recording."""
    exp: Experiment = record.experiment.synchronised(fit.result.values)
    return Residual(exp, record.modelled - exp.compared, spare.get(record.name, {}))


def plain_map_sentence(fit: FitOutcome) -> str:
    """Return a sentence on the errors of the plain map and of the model on held-out recordings, or on training ones if
    none is held out; "" without a map.
    """
    records = [r for r in fit.records if fit.baseline and r.name in fit.baseline.records]
    if fit.baseline is None or not records:
        return ""
    held = [r for r in records if r.role == "held_out"]
    shown = held or records
    (low, high, unit), (least, most, _) = (error_range(errors) for errors in (
        [fit.baseline.records[r.name] for r in shown], [r.metrics for r in shown]))
    which = f"the {'held-out' if held else 'training'} record{'s' * (len(shown) > 1)}"
    beyond = max(fit.baseline.outside[r.name] for r in shown)
    how = "holds its value at their edge" if fit.baseline.held else "extrapolates there"
    left = (f" Up to {beyond:.0f} % of the frames are outside the range of its training inputs; it {how}."
            if beyond > 1 else "")
    return (f"A plain map ({fit.baseline.title}) {'predicts' if held else 'follows'} {which} with an RMS error of "
            f"{span(low, high)} {unit}, the model with {span(least, most)} {unit}.{left}")


def better_sentence(fit: FitOutcome) -> str:
    """Return a sentence on the held-out recordings that the plain map predicts better than the model; "" if there are
    none.
    """
    baseline = fit.baseline
    if baseline is None or not baseline.better:
        return ""
    held = [r for r in fit.records if r.role == "held_out"]
    worst = sorted((r for r in held if r.name in baseline.better),
                   key=lambda r: sized(baseline.records[r.name], "rmse")[0] / sized(r.metrics, "rmse")[0])
    listed = [f"{r.name} {sized(baseline.records[r.name], 'rmse')[0]:.2g} against {sized(r.metrics, 'rmse')[0]:.2g} "
              f"{baseline.unit}" for r in worst[:MOST_NAMED]]
    more = f" and {len(worst) - MOST_NAMED} more" if len(worst) > MOST_NAMED else ""
    count = (f"{len(worst)} of {len(held)} held-out records" if len(held) > 1 else "the held-out record")
    return (f"A plain map without mechanics ({baseline.title}) predicts {count} better than the model: "
            f"{', '.join(listed)}{more}.")


def error_range(metrics: Sequence[Mapping[str, Any]]) -> tuple[float, float, str]:
    """Return the smallest and the largest RMS error of recordings, and its unit."""
    errors = [sized(dict(m), "rmse")[0] for m in metrics]
    return min(errors), max(errors), sized(dict(metrics[0]), "rmse")[1]


def span(low: float, high: float) -> str:
    """Return a range of errors as text, or one number if both ends are the same."""
    first, last = f"{low:.2g}", f"{high:.2g}"
    return first if first == last else f"{first} to {last}"
