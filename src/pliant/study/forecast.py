"""Predictions of cases that were not recorded: a recorded case with other loads, pressure levels or pressures.

Each says what it extrapolates: levels of inputs, combinations of inputs and loads that no training recording shows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from pliant.errors import InputError, SimulationError
from pliant.failures import Failures, finite
from pliant.identification import Experiment, FitResult, predict
from pliant.identification.beyond_inputs import beyond_inputs
from pliant.identification.discrepancy import discrepancy
from pliant.identification.edges import edges
from pliant.identification.identifiability import join_words
from pliant.identification.parameters import WIDE
from pliant.identification.prediction_bands import half_widths
from pliant.model import Model
from pliant.simulation import Trace
from pliant.study.schema import ForecastEntry, Study
from pliant.units import in_words, pascal_per
from pliant.validation.metrics import NAMES, growth, response
from pliant.validation.outcome import Forecast
from pliant.view.rows import known_unit

Array = np.ndarray
MARGIN = 0.02  # of the range of an input in training: smaller excesses are not named
TOGETHER = 0.25  # of its highest value in training: an input below it counts as not driven
AS_MUCH = 0.5  # of a forecast's combination that a training recording must reach


def check_forecasts(study: Study, experiments: Mapping[str, Experiment]) -> None:
    """Raise InputError if a forecast states a pressure level or pressures although the recording on which it is based
    has no such input.
    """
    for name, entry in study.forecasts.items():
        like, excitation = experiments[entry.like], experiments[entry.like].excitation
        if entry.level is not None and not like.nominal:
            driven = ", ".join(f"{c.name} = ..." for c in study.actuator.chambers) or "chamber = ..."
            raise InputError(
                f"forecast {name}: level needs a recording of a pulse or a step, but {entry.like!r} is a {excitation}"
                + (f": give pressures = {{ {driven} }} instead" if excitation == "trace" else "")
            )
        if entry.pressures and excitation != "trace":
            raise InputError(
                f"forecast {name}: pressures needs a measured pressure, but {entry.like!r} is a {excitation}: name a "
                "recording with a measured pressure as `like`"
            )


def run_forecasts(
    study: Study, experiments: Mapping[str, Experiment], results: Mapping[str, FitResult], failures: Failures,
) -> tuple[Forecast, ...]:
    """Compute all forecasts of a study, each with the fit that it names, and add those that fail to `failures`.

    The key "" of `results` is the fit used by forecasts that name none.
    """
    forecasts = []
    for name, entry in study.forecasts.items():
        case_failures = Failures(entry.fit or failures.fit, failures.warn)
        compute = partial(run_forecast, study, name, experiments, results, case_failures)
        forecasts.append(case_failures.attempt(f"forecast {name}", "", compute))
        failures += case_failures
    return tuple(f for f in forecasts if f is not None)


def run_forecast(
    study: Study, name: str, experiments: Mapping[str, Experiment], results: Mapping[str, FitResult],
    failures: Failures,
) -> Forecast:
    """Compute the forecast `name`: the motion predicted for the conditions of the recording that its entry `like`
    names, with the stated changes of loads or pressures.

    An interval or band that cannot be computed is added to `failures` and left out of the forecast.
    """
    entry = study.forecasts[name]
    if entry.fit not in results:
        raise SimulationError(f"the forecast uses fit {entry.fit}, which could not be computed: correct this fit first")
    result, template = results[entry.fit], experiments[entry.like]
    driven, named = stated_inputs(entry, result.model)
    case = case_of(name, entry, template, driven)
    recorded = edges(template)  # times at which the pressure rises and falls, from the recorded motion
    known = {parameter: recorded[parameter.rpartition(".")[2]] for parameter in case.own_parameters}
    notes: list[str] = []

    def measure(values: Mapping[str, float]) -> np.ndarray:
        motion = predict(result.model, case, {**values, **known}, result.time_step)
        tip, grown = motion["compared"][:, -1], {} if case.without_positions else growth(motion["position"], NAMES)
        traits = {**response(template.synchronised(values), tip), **grown}
        notes[:] = notes or [k for k, v in traits.items() if v is not None]
        numbers = [np.nan if (v := traits[k]) is None else v for k in notes]
        return np.concatenate([numbers, tip.ravel()])

    measures, problems = measure(result.values), list[str]()
    half, count = half_widths(result, measure, problems=problems), len(notes)
    interval = {k: float(h) for k, h in zip(notes, half, strict=False) if h > 0}
    tip = finite(measures[count:], "the predicted motion").reshape(case.time.size, -1)
    if not problems and (lost := [k for k, h in zip(notes, half, strict=False) if np.isnan(h)]):
        failures.add(f"interval of {', '.join(lost)} of forecast {name}", "",
                     "it is not defined for all motions within one standard error of the parameters")
    training = [experiments[n] for n in result.rmse if n in experiments]

    def half_width() -> np.ndarray:
        if problems:
            raise SimulationError(problems[0])
        lacks = tip_lacks(result, case, {**result.values, **known}, training, result.time_step)
        return finite(np.hypot(half[count:].reshape(tip.shape), WIDE * lacks), "the width of the band")

    width = failures.attempt(f"{'interval and ' * bool(problems)}band of forecast {name}", "", half_width)
    stated = entry.known | ({"level": case.level} if entry.level is not None else {}) | named
    return Forecast(
        name, entry.title or name, stated, case.time, tip, dict(zip(notes, measures[:count].tolist(), strict=True)),
        interval, width, extrapolations(case, result, training, entry.known),
        rows=case.axes if case.alone in case.further else (),
    )


def stated_inputs(entry: ForecastEntry, model: Model) -> tuple[dict[str, float], dict[str, float]]:
    """Return the inputs [SI] that a forecast states twice: by name, and by a name with the kind, such as
    ``left.pressure``. The forecast's `pressure_unit` is that of pressures alone.
    """
    kinds = dict(zip(model.actuation.names, model.actuation.kinds, strict=True))
    pascal = pascal_per(entry.pressure_unit)
    kind_of = {name: kinds.get(name, "pressure") for name in entry.pressures}
    driven = {n: p * (pascal if kind_of[n] == "pressure" else 1.0) for n, p in entry.pressures.items()}
    return driven, {f"{name}.{kind_of[name]}": p for name, p in driven.items()}


def case_of(name: str, entry: ForecastEntry, template: Experiment, driven: Mapping[str, float]) -> Experiment:
    """Return the experiment of a forecast: the recording `template` with other loads, another pressure level or the
    inputs `driven` [SI].
    """
    level = template.level if entry.level is None else entry.level * pascal_per(entry.pressure_unit)
    case = replace(template, name=name, level=level, known={**template.known, **entry.known})
    return other_pressures(case, driven) if driven else case


def tip_lacks(
    result: FitResult, case: Experiment, values: Mapping[str, float], training: Sequence[Experiment], time_step: float,
) -> np.ndarray:
    """Return the standard deviation of the model's additional error where inputs or speed go beyond those in training,
    for the last station over T frames: (T, axes) in m, or in rad for angles alone.
    """
    prediction = predict(result.model, case, values, time_step)
    lacks = discrepancy(result.model, case, values, prediction["compared"], prediction["pressure"], training)
    return np.hypot(lacks, np.sqrt(beyond_inputs(result, case, values, training, time_step)))[:, -1]


def other_pressures(template: Experiment, highest: Mapping[str, float]) -> Experiment:
    """Return the experiment with other pressures: each chamber named in `highest` rises to the pressure stated there
    [Pa], all others stay constant.

    The time series of each driven chamber is that of the most driven chamber of the template, scaled so that its first
    value is 0 and its highest is 1.
    """
    drives, lead = template.drives, template.pressure
    if lead is None:
        raise InputError(f"forecast {template.name}: the recording named by `like` has no measured pressure: name one "
                         "that has")
    course = (lead.pressure - lead.pressure[0]) / (lead.peak - lead.pressure[0])

    def driven(first: float, chamber: str, time: np.ndarray = lead.time) -> Trace:
        return Trace(time, first + (highest.get(chamber, first) - first) * course)

    if not drives:
        (chamber,) = highest
        return replace(template, pressure=driven(float(lead.pressure[0]), chamber))
    first = {**dict.fromkeys(highest, 0.0), **{c: float(t.pressure[0]) for c, t in drives.items()}}
    return replace(template, drives={c: driven(p, c) for c, p in first.items()})


def extrapolations(
    case: Experiment, result: FitResult, training: Sequence[Experiment], known: Mapping[str, float],
) -> tuple[str, ...]:
    """Return a phrase for each input, combination of two inputs and load of a forecast that lies beyond its training
    recordings.

    Parameters
    ----------
    case : Experiment
        The experiment that is predicted.
    result : FitResult
    training : sequence of Experiment
        The training recordings of the fit.
    known : mapping
        Loads and other values (SI) that the forecast states, by parameter name.
    """
    units = dict(zip(result.model.actuation.names, result.model.actuation.units, strict=True))
    stated, driven = inputs_of(case), [inputs_of(e) for e in training]
    ranges = {name: range_of([s[name] for s in driven if name in s]) for name in stated}
    phrases = [p for name, values in stated.items() if (p := level_phrase(name, values, ranges[name], units))]
    highest = {name: max(abs(low), abs(high)) for name, (low, high) in ranges.items()}
    phrases += [
        f"{first} together with {second}, which no training recording drives together"
        for first, second in combinations([n for n in stated if highest[n] > 0], 2)
        if is_new_pair(first, second, stated, driven, highest)
    ]
    phrases += [p for name, value in known.items() if (p := load_phrase(name, value, result, training))]
    return tuple(phrases)


def inputs_of(exp: Experiment) -> dict[str, Array]:
    """Return the values (T,) of each input of an experiment by name, at its T times; the level alone (1,) of a pulse or
    step. The name of the only input is "".
    """
    if exp.drives:
        return {name: np.asarray(trace(exp.time)) for name, trace in exp.drives.items()}
    if exp.pressure is not None:
        return {"": np.asarray(exp.pressure(exp.time))}
    return {"": np.array([exp.level])} if exp.nominal else {}


def range_of(rows: Sequence[Array]) -> tuple[float, float]:
    """Return the least and the highest value of an input in training, 0 included."""
    values = np.concatenate([np.zeros(1), *rows])
    return float(values.min()), float(values.max())


def level_phrase(name: str, values: Array, limits: tuple[float, float], units: Mapping[str, str]) -> str:
    """Return a phrase if the values (T,) of an input leave its range in training; '' otherwise."""
    unit = units.get(name) or next(iter(units.values()), "Pa")
    low, high = limits
    margin = MARGIN * (high - low)
    over, under = float(values.max()), float(values.min())
    what = name or "the input"
    if high == low and max(over, -under) > 0:
        return f"{what}, which no training recording drives"
    if over > high + margin:
        return f"{what} at {in_words(over, unit)} (in training at most {in_words(high, unit)})"
    if under < low - margin:
        return f"{what} at {in_words(under, unit)} (in training at least {in_words(low, unit)})"
    return ""


def is_new_pair(
    first: str, second: str, stated: Mapping[str, Array], shown: Sequence[Mapping[str, Array]],
    highest: Mapping[str, float],
) -> bool:
    """Return whether a forecast drives two inputs together as no training recording does. The smaller of both counts,
    each as a fraction of its highest value in training.
    """

    def together(rows: Mapping[str, Array]) -> float:
        if first not in rows or second not in rows:
            return 0.0
        fractions = [np.abs(rows[n]) / highest[n] for n in (first, second)]
        return float(np.max(np.minimum(*fractions)))

    most = together(stated)
    return most > TOGETHER and max((together(rows) for rows in shown), default=0.0) < AS_MUCH * min(most, 1.0)


def load_phrase(name: str, value: float, result: FitResult, training: Sequence[Experiment]) -> str:
    """Return a phrase if a stated load or other parameter lies beyond its values in training; '' otherwise."""
    usual = result.values.get(name, of_model(result.model, name))
    values = [v for e in training if (v := e.known.get(name, usual)) is not None]
    unit = known_unit(name)
    margin = MARGIN * max(map(abs, (*values, value)))
    if values and min(values) - margin <= value <= max(values) + margin:
        return ""
    said = join_words(sorted({f"{v:.3g} {unit}".strip() for v in values}))
    return f"{name} {value:.3g} {unit}".rstrip() + (f" (in training {said})" if said else "")


def of_model(model: Model, name: str) -> float | None:
    """Return the value of a parameter of the whole body, such as ``tip_mass``; None for others."""
    value = getattr(model, name, None)
    return float(value) if isinstance(value, int | float) else None
