"""The fitted model with which a search begins: settled shapes come first for a body that moves slowly."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from pliant.errors import FitError, PliantError
from pliant.identification.drives import findings_of_chambers
from pliant.identification.experiment import Experiment
from pliant.identification.fit import fit
from pliant.identification.result import FitResult
from pliant.model import Model
from pliant.selection.first_model import Entry, beginning
from pliant.selection.fitted import FitSetting, FittedModel, fitted, tried_step
from pliant.selection.settled import fit_from_settled_shapes, follows_at_once
from pliant.selection.slow import SlowBody, slow_body
from pliant.selection.terms import Term

Notify = Callable[[str], None]
Begun = tuple[FitSetting, FittedModel, list[Term]]


def first_model(
    train: Sequence[Experiment], model: Model, common: Sequence[Entry], terms: Sequence[Term], how: Mapping[str, Any],
    notify: Notify,
) -> Begun:
    """Return the setting of all fits of a search, the fitted model with which it begins, and the terms that this model
    has already.
    """
    stated = how["time_step"] is not None
    setting = FitSetting(tuple(train), 0.0, how["weighting"], how["loss"], stated_step=stated)
    slow = slow_body(setting, model)
    if slow is not None:
        notify(slow.sentence)
        if begun := slow_start(slow, model, common, terms, how["time_step"], notify):
            if together := findings_of_chambers(begun[1].free, model, train):
                notify(f"warning: {together}")
            return begun
    if begun := quick_start(setting, setting, model, common, how["time_step"], notify):
        return begun
    best = first_fit(train, model, beginning(model, train, common), how, notify)
    setting = replace(setting, time_step=best.time_step)
    first = fitted(setting, best.model, [replace(p, std=None) for p in best.parameters], evaluations=0)
    step = best.time_step if stated else tried_step(first, best.time_step)
    if step > best.time_step:
        setting = replace(setting, time_step=step)
        first = fitted(setting, first.model, first.parameters, evaluations=0)
    return setting, first, []


def quick_start(
    whole: FitSetting, setting: FitSetting, model: Model, common: Sequence[Entry], time_step: float | None,
    notify: Notify,
) -> Begun | None:
    """Return what `first_model` returns for a body in space that follows its inputs at once in the recordings of
    `whole`, fitted to those of `setting`; None if it does not, or with a warning if that start cannot be simulated.
    """
    if model.space is None or not follows_at_once(whole.experiments, model):
        return None
    notify("the body follows its inputs at once: settled shapes come first")
    try:
        return (*fit_from_settled_shapes(setting, model, common, time_step), [])
    except PliantError as error:
        notify(f"warning: the search does not begin with settled shapes: {error}")
        return None


def slow_start(
    slow: SlowBody, model: Model, common: Sequence[Entry], terms: Sequence[Term], time_step: float | None,
    notify: Notify,
) -> Begun | None:
    """Return what `first_model` returns for a slow body; None, with a warning, if that start cannot be simulated."""
    lengthening = next((t for t in terms if t.extension), None)
    try:
        return slow.first_model(model, common, lengthening, time_step)
    except PliantError as error:
        notify(f"warning: the search does not begin with a slow body: {error}")
        return None


def first_fit(
    train: Sequence[Experiment], model: Model, parameters: Sequence[Entry], how: Mapping[str, Any], notify: Notify,
) -> FitResult:
    """Return the fit with which a search begins. Parameters of several inputs that the recordings do not determine are
    named and stay near their start values.
    """
    options: dict[str, Any] = {"starts": 2, "max_evaluations": 100, "time_step": how["time_step"],
                               "weighting": how["weighting"], "loss": how["loss"], "rng": how["rng"]}  # fmt: skip
    try:
        return fit(train, model, parameters, **options)
    except FitError as error:
        if len(model.chambers) < 2:
            raise
        first = fit(train, model, parameters, regularise=True, **options)
        notify(f"warning: {error}")
        return first
