"""The plain map of a fit: fitted to the fit's training recordings, compared with its model on every recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.identification.experiment import Experiment
from pliant.numerics.ridge import left_out_errors, products
from pliant.simulation import Trace
from pliant.validation.map_inputs import InputTable
from pliant.validation.metrics import compare
from pliant.validation.outcome import Baseline, FitOutcome, RecordOutcome
from pliant.validation.plain_map import PlainMap, basis_of, forgetting_time
from pliant.validation.wording import sized, span

Array = np.ndarray
MOST_NAMED = 3  # recordings that a sentence lists
BETTER = 0.95  # of the model's error: a smaller error of the plain map is better
Spare = Mapping[str, Mapping[str, Trace]]


RIDGES = (1e-6, 1e-4, 1e-2, 1.0)
BLOCKS = 8  # of each recording, left out in turn
MOST_ROWS = 2000
FEWEST_ROWS = 4 * BLOCKS
FAST = 0.2  # of the time after which the motion forgets itself: lag that shows the rate of an input
LEAST_RATE = 0.02  # of an input's range: a smaller change within that lag has no direction
WORTH_NAMING = 0.2  # fraction of the residual's mean square

STATIC, DRIFT, DIRECTION, RATE = "static", "drift", "direction", "rate"
MEANING = {
    STATIC: ("a static function of the inputs", "check torque law, gains, rest pose and base"),
    DRIFT: ("a slow drift in each recording", "add creep or a viscoelastic lag, or check whether the base moves"),
    DIRECTION: ("the direction in which the inputs change", "add friction or hysteresis"),
    RATE: ("the rate of the inputs", "check damping, valve lag and the clock of the inputs"),
}


class Residual(NamedTuple):
    """What a model leaves of one recording, with recorded inputs that drive no input of the model."""

    experiment: Experiment
    missed: Array  # (T, S, d), modelled less measured, m or rad
    spare: Mapping[str, Trace] = {}


def explained(residuals: Sequence[Residual], table: InputTable) -> dict[str, float]:
    """Return the fraction (0 to 1) of the residuals' mean square that each kind of regressor explains, in blocks of the
    recordings to which it was not fitted. The fractions of different kinds overlap.

    The kinds are "static" (a quadratic function of the inputs), "drift" (a straight line in time for each recording),
    "direction" (the sign of the inputs' change), "rate" (of the inputs), and the name of each recorded input that
    drives no input of the model; for the last three, what they add to a constant or to the static function. The result
    is empty if the recordings are too short.
    """
    rows = [thinned(r, len(residuals)) for r in residuals]
    missed = np.concatenate([r.missed[k].reshape(k.size, -1) for r, k in zip(residuals, rows, strict=True)])
    group = np.concatenate([BLOCKS * i + np.arange(k.size) * BLOCKS // k.size for i, k in enumerate(rows)])
    finite = np.isfinite(missed).all(axis=1)
    if finite.sum() < FEWEST_ROWS or not missed[finite].any():
        return {}

    def fraction(parts: Sequence[Array]) -> float:
        regressors = np.concatenate([part[k] for part, k in zip(parts, rows, strict=True)])
        return explained_fraction(regressors[finite], missed[finite], group[finite])

    values = [table.values(r.experiment) for r in residuals]
    basis = basis_of(np.concatenate([v[k] for v, k in zip(values, rows, strict=True)]), 2)
    static = [basis.terms(v)[:, 1:] for v in values]
    constant, still = fraction([np.zeros((len(v), 0)) for v in values]), fraction(static)
    changes = [rates(r.experiment, table) for r in residuals]
    kinds = {
        STATIC: still,
        DRIFT: fraction([trend(r.experiment, i, len(residuals)) for i, r in enumerate(residuals)]),
        DIRECTION: fraction([directed(change, v) for change, v in zip(changes, values, strict=True)]) - constant,
        RATE: fraction(changes) - constant,
    }
    for name in dict.fromkeys(n for r in residuals for n in r.spare):
        column = [r.spare[name](r.experiment.time) if name in r.spare else np.zeros(r.experiment.time.size)
                  for r in residuals]
        kinds[name] = fraction([np.column_stack([s, c]) for s, c in zip(static, column, strict=True)]) - still
    return {name: float(np.clip(value, 0.0, 1.0)) for name, value in kinds.items()}


def thinned(residual: Residual, count: int) -> Array:
    """Return the indices of the frames that are used of one of `count` residuals."""
    frames = residual.experiment.time.size
    return np.arange(0, frames, -(-frames * count // MOST_ROWS))


def explained_fraction(regressors: Array, missed: Array, group: Array) -> float:
    """Return the fraction of the mean square of residuals (N, M) that regressors (N, P) and a constant explain in
    groups of rows (N,) to which they were not fitted.
    """
    spread = np.std(regressors, axis=0)
    moving = spread > 0
    scaled = (regressors[:, moving] - regressors[:, moving].mean(axis=0)) / spread[moving]
    terms = np.column_stack([np.ones(len(missed)), scaled])
    sums = [products(terms[group == g], missed[group == g]) for g in np.unique(group)]
    left = min(float(left_out_errors(sums, ridge).sum()) for ridge in RIDGES)
    return 1.0 - left / float(np.sum(missed**2))


def trend(exp: Experiment, index: int, count: int) -> Array:
    """Return an offset and a straight line in time (T, 2 count) for recording `index` of `count`, 0 for the others."""
    lines = np.zeros((exp.time.size, 2 * count))
    lines[:, 2 * index] = 1.0
    lines[:, 2 * index + 1] = (exp.time - exp.time[0]) / max(float(np.ptp(exp.time)), 1e-300)
    return lines


def rates(exp: Experiment, table: InputTable) -> Array:
    """Return the change (T, C) of each of C inputs within a short lag, SI units; 0 for settled poses."""
    count = len(table.names)
    values = table.values(exp, (max(FAST * forgetting_time(exp), 1e-3),) if count else ())
    return np.asarray(values[:, :count] - values[:, table.size :]) if count else values[:, :0]


def directed(change: Array, values: Array) -> Array:
    """Return the direction (-1, 0, 1) of the change (T, C) of C inputs, alone and times the inputs (T, C or more)."""
    inputs = values[:, : change.shape[1]]
    span = np.ptp(inputs, axis=0, keepdims=True) if len(inputs) else inputs
    sign = np.where(np.abs(change) > LEAST_RATE * span, np.sign(change), 0.0)
    return np.column_stack([sign, sign * inputs])


def suggestion(fractions: Mapping[str, float]) -> str:
    """Return a sentence that names what explains most of a residual, and where to look."""
    if not fractions:
        return "These recordings are too short to say what the model's residual depends on."
    name = max(fractions, key=lambda kind: fractions[kind])
    size, squared = 100 * fractions[name], "of the model's squared residual"
    if fractions[name] < WORTH_NAMING:
        return (f"Where the plain map is better, no simple regressor explains more than {max(size, 1):.0f} % {squared}"
                ": it follows neither inputs, nor their direction or rate, nor a drift.")
    if name not in MEANING:
        return (f"Where the plain map is better, the recorded input {name}, which drives no input of the model, "
                f"explains {size:.0f} % {squared} beyond the other inputs: let it drive one.")
    what, where = MEANING[name]
    return f"Where the plain map is better, {what} explains {size:.0f} % {squared}: {where}."


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
    good = {name: item for name, item in done.items() if isinstance(item, Mapped)}
    records = tuple(replace(r, baseline=good[r.name].predicted) if r.name in good else r for r in fit.records)
    metrics = {r.name: {"role": r.role, **good[r.name].metrics} for r in records if r.name in good}
    better = [r for r in records if r.role == "held_out" and r.name in good and is_better(metrics[r.name], r.metrics)]
    fractions = explained([residual_of(r, fit, spare or {}) for r in better], plain.table) if better else {}
    baseline = Baseline(
        plain.title, plain.degree, plain.time_constants, plain.ridge, plain.held, plain.inputs, plain.coefficients.size,
        plain.frames, unit, factor * plain.left_out_error if np.isfinite(plain.left_out_error) else None,
        factor * plain.training_error,
        (*plain.notes, *(item for item in done.values() if isinstance(item, str))), metrics,
        {name: item.outside for name, item in good.items()}, tuple(r.name for r in better), fractions,
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
    held_out = [r for r in records if r.role == "held_out"]
    judged = held_out or records
    (low, high, unit), (least, most, _) = (error_range(errors) for errors in (
        [fit.baseline.records[r.name] for r in judged], [r.metrics for r in judged]))
    which = f"the {'held-out' if held_out else 'training'} record{'s' * (len(judged) > 1)}"
    beyond = max(fit.baseline.outside_percent[r.name] for r in judged)
    how = "holds its value at their edge" if fit.baseline.held_at_edge else "extrapolates there"
    left = (f" Up to {beyond:.0f} % of the frames are outside the range of its training inputs; it {how}."
            if beyond > 1 else "")
    return (f"A plain map ({fit.baseline.title}) {'predicts' if held_out else 'follows'} {which} with an RMS error of "
            f"{span(low, high)} {unit}, the model with {span(least, most)} {unit}.{left}")


def better_sentence(fit: FitOutcome) -> str:
    """Return a sentence on the held-out recordings that the plain map predicts better than the model; "" if there are
    none.
    """
    baseline = fit.baseline
    if baseline is None or not baseline.better:
        return ""
    held_out = [r for r in fit.records if r.role == "held_out"]
    worst = sorted((r for r in held_out if r.name in baseline.better),
                   key=lambda r: sized(baseline.records[r.name], "rmse")[0] / sized(r.metrics, "rmse")[0])
    listed = [f"{r.name} {sized(baseline.records[r.name], 'rmse')[0]:.2g} against {sized(r.metrics, 'rmse')[0]:.2g} "
              f"{baseline.unit}" for r in worst[:MOST_NAMED]]
    more = f" and {len(worst) - MOST_NAMED} more" if len(worst) > MOST_NAMED else ""
    count = (f"{len(worst)} of {len(held_out)} held-out records" if len(held_out) > 1 else "the held-out record")
    return (f"A plain map without mechanics ({baseline.title}) predicts {count} better than the model: "
            f"{', '.join(listed)}{more}.")


def error_range(metrics: Sequence[Mapping[str, Any]]) -> tuple[float, float, str]:
    """Return the smallest and the largest RMS error of recordings, and its unit."""
    errors = [sized(dict(m), "rmse")[0] for m in metrics]
    return min(errors), max(errors), sized(dict(metrics[0]), "rmse")[1]
