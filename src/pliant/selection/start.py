"""The fitted model with which a search begins: settled shapes come first for a body that moves slowly, and for a body
in space that follows its inputs nearly at once.

Where the inputs of a frame alone explain half of its pose or more, a few frames taken as settled shapes determine
gains, directions and the places of markers in seconds. A fit of the motion from there begins near its optimum, and
takes few evaluations of a long recording.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple

from pliant.errors import FitError, PliantError
from pliant.identification.drives import findings_of_chambers
from pliant.identification.experiment import Experiment
from pliant.identification.fit import fit
from pliant.identification.parameters import shared_name
from pliant.identification.prediction import STEPS_A_FRAME, fit_step
from pliant.identification.result import FitResult
from pliant.model import Model
from pliant.selection.first_model import Entry, beginning, edge_limits, edge_times, name_of
from pliant.selection.fitted import TOLERANCE, FitSetting, FittedModel, fitted, frame_spacing, tried_step
from pliant.selection.search import INTERRUPTED
from pliant.selection.slow import (
    FRAMES,
    SlowBody,
    first_parameters,
    left_by,
    moved_and_inputs,
    of_inputs_alone,
    settled,
    slow_body,
)
from pliant.selection.statics import with_static_terms
from pliant.selection.terms import TERMS, Term, terms_for

Notify = Callable[[str], None]
EXPLAINED = 0.5  # of the variance of the motion that inputs of the same frames explain, for a start from settled shapes
SETTLED = 0.8  # of it, from which settled shapes also choose terms
STATIC_EVALUATIONS = 30
SHAPES = 160  # settled shapes of all recordings, at least, from which terms are chosen
MANY, ALMOST = 20, 1e-3  # free parameters, above which a fit of the motion stops at a coarser change of its cost
STATIC_PART = 0.4  # of the time of a search, at most, for the terms that settled shapes show
OF_MOTION = ("damping", "axial_damping")  # parameters that settled shapes do not show


class Begun(NamedTuple):
    """The beginning of a search: the setting of all its fits, the first model, fitted, the terms that this has already,
    and whether an interrupt (Ctrl-C) stopped the search before it had all of them.
    """

    setting: FitSetting
    fit: FittedModel
    terms: list[Term]
    stopped: bool = False


def first_model(
    train: Sequence[Experiment], model: Model, common: Sequence[Entry], terms: Sequence[Term], how: Mapping[str, Any],
    deadline: float, notify: Notify,
) -> Begun:
    """Return the beginning of a search, whose fits stop at the `deadline`."""
    stated = how["time_step"] is not None
    setting = FitSetting(tuple(train), 0.0, how["weighting"], how["loss"], stated_step=stated, deadline=deadline)
    slow = slow_body(setting, model)
    if slow is not None:
        notify(slow.sentence)
        if begun := slow_start(slow, model, common, terms, how["time_step"], notify):
            if together := findings_of_chambers(begun.fit.free, model, train):
                notify(f"warning: {together}")
            return begun
    if begun := quick_start(setting, setting, model, common, how["time_step"], notify, terms, how["minutes"]):
        return begun
    stated_names = {*map(name_of, common)}
    wide = {p.name: p for e in train for p in edge_limits(e) if p.name not in stated_names}
    near = {p.name: p for e in train for p in edge_times(e) if p.name in wide}
    entries = [near.get(name_of(e), e) for e in beginning(model, train, common)]
    best = first_fit(train, model, entries, how, notify)
    setting = replace(setting, time_step=best.time_step)
    bounds = {p.name: wide.get(p.name, p) for p in best.parameters}
    parameters = [replace(p, std=None, lower=bounds[p.name].lower, upper=bounds[p.name].upper) for p in best.parameters]
    first = fitted(setting, best.model, parameters, evaluations=0)
    step = best.time_step if stated else tried_step(first, best.time_step)
    if step > best.time_step:
        setting = replace(setting, time_step=step)
        first = fitted(setting, first.model, first.parameters, evaluations=0)
    return Begun(setting, first, [])


def quick_start(
    whole: FitSetting, setting: FitSetting, model: Model, common: Sequence[Entry], time_step: float | None,
    notify: Notify, terms: Sequence[Term] = (), minutes: float = 0.0,
) -> Begun | None:
    """Return what `first_model` returns for a body in space that nearly follows its inputs in the recordings of
    `whole`, fitted to those of `setting`, with those of the `terms` that settled shapes show in a part of the `minutes`
    of the search, if it follows at once; None if it does not, or with a warning if that start cannot be simulated.
    """
    share = 0.0 if model.space is None else explained_at_once(whole.experiments, model)
    if share < EXPLAINED:
        return None
    terms = terms if share >= SETTLED else ()
    notify(f"the inputs of each frame explain {100 * share:.0f} % of its pose: settled shapes come first")
    try:
        seconds = STATIC_PART * 60.0 * minutes
        still, chosen, stopped = fit_of_settled_shapes(setting, model, common, terms, seconds, notify)
        if not stopped:
            try:
                return Begun(*fit_begun_at(still, setting, model, common, time_step), chosen)
            except KeyboardInterrupt:
                notify(INTERRUPTED)
        unmoved = replace(setting, evaluations=0)
        return Begun(*fit_begun_at(still, unmoved, model, common, time_step), chosen, stopped=True)
    except PliantError as error:
        notify(f"warning: the search does not begin with settled shapes: {error}")
        return None


def slow_start(
    slow: SlowBody, model: Model, common: Sequence[Entry], terms: Sequence[Term], time_step: float | None,
    notify: Notify,
) -> Begun | None:
    """Return what `first_model` returns for a slow body; None, with a warning, if that start cannot be simulated."""
    lengthening = next((t for t in terms if t.name == "lengthening"), None)
    try:
        return Begun(*slow.first_model(model, common, lengthening, time_step))
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
    if all(e.poses for e in train):  # which terms join a search from motions depends on how far its first fit goes
        options["tolerance"] = TOLERANCE
    try:
        return fit(train, model, parameters, **options)
    except FitError as error:
        if len(model.chambers) < 2:
            raise
        first = fit(train, model, parameters, regularise=True, **options)
        notify(f"warning: {error}")
        return first


def explained_at_once(train: Sequence[Experiment], model: Model) -> float:
    """Return the fraction of the variance of the last station's motion that the inputs of each frame alone explain, in
    recordings of positions under measured inputs; 0 for others.
    """
    if not of_inputs_alone(train):
        return 0.0
    moved, now, _ = moved_and_inputs(train, model.actuation.names, ())
    return 1.0 - left_by([now], moved) / max(float(((moved - moved.mean(axis=0)) ** 2).sum()), 1e-300)


def fit_of_settled_shapes(
    setting: FitSetting, model: Model, common: Sequence[Entry], terms: Sequence[Term], seconds: float, notify: Notify,
) -> tuple[FittedModel, list[Term], bool]:
    """Return the fit of the first model to settled shapes of the recordings, with those of the `terms` that these show
    within some `seconds`, these terms, and whether an interrupt ended their choice.
    """
    train = setting.experiments
    most = max(SHAPES // len(train), FRAMES) if terms else FRAMES
    shapes = replace(setting, experiments=tuple(settled(e, most=most) for e in train))
    static = [p for p in first_parameters(model, train, common) if shared_name(p.name) not in OF_MOTION]
    still = fitted(shapes, model, static, evaluations=STATIC_EVALUATIONS)
    if not terms:
        return still, [], False
    usual, stated = terms_for(model, train, only=tuple(TERMS)), frozenset(map(name_of, common))
    names, others = {t.name for t in terms if t in usual}, [t for t in terms if t not in usual]
    return with_static_terms(still, shapes, names, others, stated, seconds, notify)


def fit_begun_at(
    still: FittedModel, setting: FitSetting, model: Model, common: Sequence[Entry], time_step: float | None,
) -> tuple[FitSetting, FittedModel]:
    """Return the setting of all fits of a search, and the fit of the first model to the motion, begun at the fit
    `still` of settled shapes. What these do not show, such as damping, begins at its first guess.
    """
    train, fitted_names = setting.experiments, {p.name for p in still.problem.free}
    many = len(still.problem.free) > MANY
    listed = first_parameters(model, train, common)
    names = {p.name for p in listed}
    begun = [*(p.with_(value=still.values[p.name]) if p.name in fitted_names else p for p in listed),
             *(p for p in still.parameters if p.name not in names)]  # fmt: skip
    values = {p.name: p.value for p in begun if p.value is not None}
    setting = replace(setting, time_step=time_step or fit_step(still.model, values, train))
    if time_step is None:
        with suppress(PliantError):
            moving = [p.with_(free=p.free and p.name not in fitted_names) for p in begun] if many else begun
            first = fitted(replace(setting, time_step=frame_spacing(train) / STEPS_A_FRAME), still.model, moving)
            setting = replace(setting, time_step=tried_step(first, setting.time_step))
            begun = [p.with_(value=first.values[p.name]) for p in begun]
    return setting, fitted(setting, still.model, begun, tolerance=ALMOST if many else TOLERANCE)
