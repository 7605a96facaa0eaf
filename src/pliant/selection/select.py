"""`select_model`: the terms that the training recordings ask for."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from typing import TypedDict, Unpack

import numpy as np

from pliant.errors import InputError
from pliant.identification.experiment import Experiment
from pliant.identification.fit import check_choices
from pliant.model import Model
from pliant.options import with_defaults
from pliant.selection.first_model import Entry, determined, name_of, scale_of
from pliant.selection.fitted import FitSetting, fitted
from pliant.selection.result import ModelSelection
from pliant.selection.running import RESERVE, Notify
from pliant.selection.saved import SearchFile
from pliant.selection.search import Search
from pliant.selection.start import first_model
from pliant.selection.statics import in_order
from pliant.selection.terms import Term, terms_for

MINUTES = 5.0


class SearchOptions(TypedDict, total=False):
    """Keyword options of `select_model`, where they are documented."""

    terms: Sequence[Term] | None
    minutes: float
    time_step: float | None
    weighting: str
    loss: str
    rng: np.random.Generator | int | None
    file: SearchFile | None


SEARCH_OPTIONS: SearchOptions = {
    "terms": None, "minutes": MINUTES, "time_step": None, "weighting": "travel", "loss": "linear", "rng": 0,
    "file": None,
}  # fmt: skip


def select_model(
    train: Sequence[Experiment], model: Model, *, common: Sequence[Entry] = (), progress: Notify | None = None,
    **options: Unpack[SearchOptions],
) -> ModelSelection:
    """Choose the terms of a model from training recordings alone, and fit the chosen model.

    The search begins with stiffness, damping and a torque proportional to each input. In each step, a screen predicts
    from one Jacobian what every further term would lower the cost by; the three best are fitted roughly from the
    parent's optimum. The term that predicts parts of the recordings best from the other parts (see
    `pliant.selection.criterion`) joins the model if its converged fit, from each row of its grid, lowers their sum of
    squares by 3 %. When none does, a term is fitted anew after another one that explains the same residual. At the end,
    terms without which the prediction is as good, and terms that the recordings do not determine (standard error above
    half the value, errors of the model's form included), are dropped again. Of a term that is needed, an undetermined
    time or angle is held at its value, and another undetermined parameter rests on a prior: no effect, give or take the
    size that the fit shows. The reason of the result names them.

    A stiffness that the recordings do not show to the first model is held, and is free again, under the name
    "stiffness", as soon as this counts as a term that joins: whatever `terms` lists, unless `common` states it.

    Parameters
    ----------
    train : sequence of Experiment
        Training recordings. No other recording is looked at.
    model : Model
        Geometry, and the values of everything that is not fitted.
    common : sequence of Parameter or str
        Parameters that are free in every model, such as the position of a marker. They take precedence over the
        stiffness, damping and torque with which the search begins.
    terms : sequence of Term, optional
        Terms that may be added; default: `terms_for` of the model and recordings.
    minutes : float
        Time limit. When it is reached, or at an interrupt (Ctrl-C), the best model so far is the result, and its reason
        says so.
    time_step : float, s
        As in `fit`.
    weighting, loss, rng
        As in `fit`.
    file : SearchFile, optional
        File in which the search keeps its state after each step, and from which it goes on.
    progress : callable, optional
        Called with one line of text after each fit.

    Returns
    -------
    ModelSelection

    Raises
    ------
    FitError, InputError
        As `fit`, for the model with which the search begins.
    TypeError
        For an unknown keyword.
    """
    how = with_defaults(select_model, options, SEARCH_OPTIONS)
    check_options(how)
    began, notify = clock.monotonic(), progress or (lambda _line: None)
    deadline = began + 60 * how["minutes"]
    first_fits = deadline - RESERVE * (deadline - began)
    names = frozenset(map(name_of, common))
    file, state = how["file"], None if how["file"] is None else how["file"].load()
    terms = terms_for(model, train) if how["terms"] is None else how["terms"]
    if state is None:
        setting, parent, chosen, stopped = first_model(train, model, common, terms, how, first_fits, notify)
        start = model.with_(stations=parent.model.stations)
        chosen = [t.on(start) for t in chosen]
        terms = in_order([t.on(start) for t in terms], chosen)
        best, added = determined(parent, setting), {p.name for t in chosen for p in t.adds}
        first = [p for p in best.parameters if p.name not in added]
        return Search(setting, start, best, terms, began, deadline, notify, file, chosen, stated=names,
                      first=first).run(stopped=stopped)
    stated = how["time_step"] is not None
    setting = FitSetting(tuple(train), state.time_step, how["weighting"], how["loss"], stated_step=stated,
                         deadline=first_fits)  # fmt: skip
    longer = model
    for term in (t for name in state.terms for t in terms if t.name == name):
        longer = term.model(longer)
    best = fitted(setting, longer, state.parameters, prior_weight=state.prior_weight, evaluations=0)
    start = model.with_(stations=best.model.stations)
    terms = [t.on(start) for t in terms]
    chosen = [t for name in state.terms for t in (*terms, *scale_of(state.first, names)) if t.name == name]
    notify(f"goes on from a run that was stopped: {', '.join(t.title for t in chosen) or 'no term'} so far")
    return Search(setting, start, best, terms, began - state.seconds, deadline, notify, file, chosen,
                  list(state.steps), stated=names, first=state.first,
                  dropped={s.name for s in state.steps if s.change == "leaves"}).run()


def check_options(how: SearchOptions) -> None:
    """Raise InputError for an unknown weighting or loss, or a time limit that is not positive."""
    check_choices(how["loss"], how["weighting"])
    if not how["minutes"] > 0:
        raise InputError(f"minutes must be positive, got {how['minutes']}: give the time that the search may take")
