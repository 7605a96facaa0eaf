"""What a forecast extrapolates: levels of inputs, combinations of inputs and loads that no training recording shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from pliant.identification import Experiment, FitResult
from pliant.identification.identifiability import join_words
from pliant.model import Model
from pliant.units import in_words
from pliant.view.rows import known_unit

Array = np.ndarray
MARGIN = 0.02  # of the range of an input in training: smaller excesses are not named
TOGETHER = 0.25  # of its highest value in training: an input below it counts as not driven
AS_MUCH = 0.5  # of a forecast's combination that a training recording must reach


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
    return {"": np.array([exp.level])} if exp.excitation in ("pulse", "step") else {}


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
