"""`select_model`: which terms the training recordings ask for, found by screens and a few refits, within a time budget."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypedDict, Unpack

import numpy as np

from pliant.errors import FitError, InputError, PliantError
from pliant.identification.chamber_parameters import has_effect, prefixes
from pliant.identification.experiment import Experiment
from pliant.identification.fit import LOSSES, WEIGHTINGS, finished, fit
from pliant.identification.optimise import solve
from pliant.identification.parameters import Parameter, shared_name
from pliant.identification.result import FitResult
from pliant.model import Model
from pliant.options import with_defaults
from pliant.selection.criterion import effective_numbers, groups_of, left_out
from pliant.selection.fitted import Fitted, Setting, fitted
from pliant.selection.result import ModelSelection, Step, Trial
from pliant.selection.screen import Proposal, screened
from pliant.selection.terms import Term, terms_for

Array = np.ndarray
Notify = Callable[[str], None]
Entry = Parameter | str
MATERIAL = 0.03  # of the criterion: a smaller gain does not earn a term its place
REFITS = 3  # terms that are fitted in each step, those with the best screens
DETERMINED = 0.5  # standard error over value above which a parameter is not determined: its 95 % interval holds zero
SAME = 1e-3  # of the parent's cost: a child's optimum above it has not converged
MINUTES = 5.0
RESERVE = 0.15  # of the time: kept for the last fit


class SearchOptions(TypedDict, total=False):
    """Keyword options of `select_model`, where they are documented."""

    terms: Sequence[Term] | None
    minutes: float
    time_step: float | None
    weighting: str
    loss: str
    rng: np.random.Generator | int | None


SEARCH_OPTIONS: SearchOptions = {
    "terms": None, "minutes": MINUTES, "time_step": None, "weighting": "travel", "loss": "linear", "rng": 0,
}  # fmt: skip


def select_model(
    train: Sequence[Experiment], model: Model, *, common: Sequence[Entry] = (), progress: Notify | None = None,
    **options: Unpack[SearchOptions],
) -> ModelSelection:
    """Choose the terms of a model from training recordings alone, and fit the chosen model.

    The search begins with stiffness, damping and a torque proportional to each input. In each step, a screen predicts
    from one Jacobian what every further term would lower the cost by; the three best are fitted from the parent's
    optimum. The term that predicts parts of the recordings best from the other parts (see
    `pliant.selection.criterion`) joins the model if it improves this prediction by 3 % and the recordings determine
    its parameters (standard error at most half the value). At the end, terms that are no longer determined, or without
    which the prediction is as good, are dropped again.

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
        Time limit. When it is reached, the best model so far is the result, and its reason says so.
    time_step : float, s
        As in `fit`.
    weighting, loss, rng
        As in `fit`.
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
    began = clock.monotonic()
    first = fit(train, model, beginning(model, train, common), starts=2, time_step=how["time_step"],
                weighting=how["weighting"], loss=how["loss"], rng=how["rng"], max_evaluations=100)
    setting = Setting(tuple(train), first.time_step, how["weighting"], how["loss"])
    parent = fitted(setting, first.model, [replace(p, std=None) for p in first.parameters], evaluations=0)
    given = model.with_(stations=parent.model.stations)
    hunt = Hunt(setting, given, parent, terms_for(model, train) if how["terms"] is None else how["terms"],
                began + 60 * how["minutes"], progress or (lambda _line: None), began)
    return hunt.run()


def check_options(how: SearchOptions) -> None:
    """Raise InputError for an unknown weighting or loss, or a time limit that is not positive."""
    for what, value, known in (("loss", how["loss"], LOSSES), ("weighting", how["weighting"], WEIGHTINGS)):
        if value not in known:
            raise InputError(f"unknown {what} {value!r}: use one of {', '.join(known)}")
    if not how["minutes"] > 0:
        raise InputError(f"minutes must be positive, got {how['minutes']}: give the time that the search may take")


def beginning(model: Model, train: Sequence[Experiment], common: Sequence[Entry]) -> list[Entry]:
    """Return the parameters with which a search begins: those in `common`, and unless these replace them stiffness,
    damping and a torque proportional to each input.
    """
    stated = {e if isinstance(e, str) else e.name for e in common}
    kinds = {shared_name(name.removesuffix("_*")) for name in stated}
    names = [n for n in ("stiffness", "damping") if n not in kinds and "body_stiffness" not in kinds]
    if any(e.excitation != "release" for e in train):
        names += [n for n in torque_names(model) if n not in stated]
    return [*common, *names]


def torque_names(model: Model) -> list[str]:
    """Return the names of the parameters that scale the torque of each input: gains in space, coefficients in a plane.

    A chamber in the plane that has a torque law other than a linear one keeps it.
    """
    names = []
    for start, chamber in zip(prefixes(model), model.chambers, strict=True):
        if model.space is not None:
            names += [f"{start}gain_{axis}" for axis in "xy"] if start else []
        elif has_effect("torque_1", chamber) and not chamber.torque.any():
            names.append(f"{start}torque_1")
    return names


@dataclass
class Hunt:
    """A search under way: the best model so far, the terms that it has, and what was tried."""

    setting: Setting
    given: Model  # without the values of any term, with the stations of the first fit
    best: Fitted
    terms: Sequence[Term]
    deadline: float  # s, on the monotonic clock
    notify: Notify
    began: float

    def run(self) -> ModelSelection:
        """Add terms until none helps, drop those that are not needed, and return the selection."""
        self.chosen: list[Term] = []
        self.groups = groups_of(self.best)
        self.score = self.scored(self.best)
        self.steps = [self.step("", "stiffness, damping and torque", ())]
        stop = ""
        while not stop:
            stop = self.forward()
        self.backward()
        result = self.final()
        return ModelSelection(tuple(self.steps), tuple(t.name for t in self.chosen), self.reason(stop), result,
                              clock.monotonic() - self.began)

    def model(self, *more: Term) -> Model:
        """Return the given model with the segments that the chosen terms and `more` need."""
        model = self.given
        for term in (*self.chosen, *more):
            model = term.model(model)
        return model

    def scored(self, fit: Fitted) -> float:
        """Return the criterion: the sum of squares of the residuals as predicted from other parts of the recordings."""
        predicted = left_out(fit, self.groups)
        return float(predicted @ predicted)

    def step(self, name: str, title: str, trials: Sequence[Trial]) -> Step:
        """Return the record of the model as it is now, after the term `name` joined it or left it."""
        predicted = left_out(self.best, self.groups)
        return Step(name, title, self.best.free, self.best.cost, self.best.percent(self.best.residual),
                    self.best.percent(predicted), tuple(trials))

    def late(self) -> bool:
        """Return whether the time that is left is needed for the last fit."""
        return clock.monotonic() > self.deadline - RESERVE * (self.deadline - self.began)

    def open_terms(self) -> list[Term]:
        """Return the terms that may join the model as it is."""
        names, groups = {t.name for t in self.chosen}, {t.group for t in self.chosen if t.group}
        parameters, free = {p.name for p in self.best.parameters}, set(self.best.free)
        return [
            t for t in self.terms
            if t.name not in names and t.group not in groups and (not t.needs or t.needs in names)
            and set(t.replaces) <= free and not any(p.name in parameters for p in t.adds if p.free)
        ]  # fmt: skip

    def forward(self) -> str:
        """Add the best term to the model. Return why the search ends, or '' if a term was added."""
        if self.late():
            return "the time limit was reached"
        proposals, refused = screened(self.best, self.model(), self.open_terms(), self.setting)
        trials = [Trial(r.term.name, r.term.title, None, None, None, f"cannot be screened: {r.reason}")
                  for r in refused]
        numbers = effective_numbers(self.best.problem, self.best.residual)
        ranked = sorted(proposals, key=lambda p: numbers * np.log(max(p.cost, 1e-300)) + np.log(numbers) * added(p.term))
        names: list[str] = []
        taken: tuple[float, Fitted, Term] | None = None
        for proposal in ranked:
            term = proposal.term
            if term.name in names:
                continue
            names.append(term.name)
            if len(names) > REFITS or not proposal.sense:
                why = "" if proposal.sense else "the recordings ask for a value beyond its bounds"
                trials.append(Trial(term.name, term.title, proposal.cost, None, None, why or "others promise more"))
                continue
            if self.late():
                return "the time limit was reached"
            child, trial = self.child(proposal)
            trials.append(trial)
            if child is not None and (taken is None or trial.left_out < taken[0]):
                taken = (trial.left_out, child, term)
        if taken is None or taken[0] > (1 - MATERIAL) * self.score:
            self.steps[-1] = replace(self.steps[-1], tried=tuple(trials))
            return "no further term improves the prediction of left-out parts of the training recordings by 3 %"
        self.steps[-1] = replace(self.steps[-1], tried=tuple(trials))
        self.score, self.best, term = taken
        self.chosen.append(term)
        self.steps.append(self.step(term.name, term.title, ()))
        self.tell(f"added {term.title}")
        return ""

    def tell(self, what: str) -> None:
        """Report the state of the search in one line of text."""
        left = max(self.deadline - clock.monotonic(), 0.0)
        self.notify(f"{what}: error of left-out parts {self.steps[-1].left_out_percent:.3g} % of the peak displacement, "
                    f"{len(self.best.free)} parameters ({clock.monotonic() - self.began:.0f} s; at most {left:.0f} s more)")

    def child(self, proposal: Proposal) -> tuple[Fitted | None, Trial]:
        """Fit the model with one more term. Return the fit, or None if the term is refused, and what was tried."""
        term = proposal.term
        trial = Trial(term.name, term.title, proposal.cost, None, None, "")
        others = [p for p in self.best.parameters if p.name not in {*term.replaces, *(q.name for q in term.adds)}]
        best: Fitted | None = None
        for start in proposal.starts():
            try:
                end = fitted(self.setting, self.model(term), [*others, *term.begun(proposal.row, start)],
                             prior_weight=self.best.prior_weight)
            except PliantError as error:
                trial = trial._replace(reason=str(error))
                continue
            best = end if best is None or end.cost < best.cost else best
            if best.cost < (1 + SAME) * self.best.cost:
                break
        if best is None:
            return None, trial
        score = self.scored(best)
        trial = trial._replace(cost=best.cost, left_out=score, reason="")
        if best.cost > (1 + SAME) * self.best.cost:
            return None, trial._replace(reason="its fit has not converged: the cost is above that without the term")
        if loose := self.loose(best, term):
            return None, trial._replace(reason=f"not determined: {loose}")
        if score > (1 - MATERIAL) * self.score:
            return None, trial._replace(reason=f"left-out parts are predicted no better ({change(score, self.score)})")
        return best, trial._replace(reason=f"left-out parts are predicted better ({change(score, self.score)})")

    def loose(self, fit: Fitted, term: Term) -> str:
        """Return which parameters of a term the recordings do not determine, as text; '' if they determine all."""
        errors, values = fit.standard_errors(), fit.values
        names = [p.name for p in term.adds if p.free and not p.shrink and not p.prior_std]
        said = []
        for name in names:
            error = errors[name]
            null = term.null.get(name, 0.0)
            away = values[name] - (null if abs(null) > 1e-5 else 0.0)
            if error is None:
                said.append(f"{name} is not shown")
            elif error > DETERMINED * abs(away):
                said.append(f"{name} {values[name]:.3g} +- {error:.2g}")
        return ", ".join(said)

    def backward(self) -> None:
        """Drop the terms that are not determined, or without which left-out parts are predicted as well."""
        while len(self.chosen) > 1 and not self.late():
            worst = self.dispensable()
            if worst is None:
                return
            self.score, self.best, term = worst
            self.chosen.remove(term)
            self.steps.append(self.step(f"-{term.name}", f"without {term.title}", ()))
            self.tell(f"dropped {term.title}")

    def dispensable(self) -> tuple[float, Fitted, Term] | None:
        """Return the term that the model needs least, with the model without it; None if it needs all."""
        needed = {t.needs for t in self.chosen} | {self.chosen[-1].name}
        options = []
        for term in self.chosen:
            if term.name in needed or term.extension or term.replaces:
                continue
            loose = self.loose(self.best, term)
            if not loose and self.costs_without(term) > (1 + 2 * MATERIAL) * 2 * self.best.cost:
                continue
            gone = {p.name for p in term.adds}
            try:
                end = fitted(self.setting, self.model(), [p for p in self.best.parameters if p.name not in gone],
                             prior_weight=self.best.prior_weight)
            except PliantError:
                continue
            score = self.scored(end)
            if score < (1 + MATERIAL) * self.score:
                options.append((score, end, term))
        return min(options, key=lambda o: o[0]) if options else None

    def costs_without(self, term: Term) -> float:
        """Return the sum of squares that the linearised model leaves with a term at its null values."""
        fit = self.best
        mine = [k for k, name in enumerate(fit.free) if name in term.null]
        keep = [k for k in range(len(fit.free)) if fit.free[k] not in {p.name for p in term.adds}]
        away = np.array([term.null[fit.free[k]] for k in mine]) / fit.problem.scale[mine] - fit.x[mine]
        moved = fit.residual + fit.jacobian[:, mine] @ away
        basis = np.linalg.qr(fit.jacobian[:, keep])[0]
        left = moved - basis @ (basis.T @ moved)
        return float(left @ left)

    def final(self) -> FitResult:
        """Return the chosen model, fitted until it converges."""
        problem = self.best.problem
        began = clock.perf_counter()
        best = solve(problem, self.best.x, self.setting.loss, 60)
        for _ in range(2 if problem.learns else 0):
            problem.learn_sizes(best.x)
            best = solve(problem, best.x, self.setting.loss, 60)
        return finished(problem, best, self.setting.loss, None, clock.perf_counter() - began)

    def reason(self, stop: str) -> str:
        """Return a sentence on the model that was chosen and why the search ended."""
        names = ", ".join(t.title for t in self.chosen) or "no further term"
        first, last = self.steps[0].left_out_percent, self.steps[-1].left_out_percent
        return (f"{names}: left-out parts of the training recordings are predicted with {last:.3g} % of the peak "
                f"displacement ({first:.3g} % without these terms); {stop}")


def added(term: Term) -> int:
    """Return by how many a term raises the number of free parameters."""
    return sum(p.free for p in term.adds) - len(term.replaces)


def change(score: float, before: float) -> str:
    """Return the change of the root of a sum of squares as text, such as "-12 %"."""
    return f"{100 * (np.sqrt(score / before) - 1):+.2g} %"


__all__ = ["FitError", "ModelSelection", "select_model"]
