"""`select_model`: the terms that the training recordings ask for, found by screens and a few refits."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypedDict, Unpack

import numpy as np

from pliant.errors import InputError, PliantError
from pliant.identification.chamber_parameters import has_effect, prefixes
from pliant.identification.experiment import Experiment
from pliant.identification.fit import check_choices, finished, fit
from pliant.identification.optimise import solve
from pliant.identification.parameters import Parameter, shared_name
from pliant.identification.result import FitResult
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.options import with_defaults
from pliant.selection.criterion import effective_numbers, groups_of, left_out
from pliant.selection.fitted import FitSetting, FittedModel, fitted
from pliant.selection.result import ModelSelection, SelectionStep, TriedTerm
from pliant.selection.screen import TermProposal, screened
from pliant.selection.terms import Term, terms_for

Array = np.ndarray
Notify = Callable[[str], None]
Entry = Parameter | str
MUCH = 0.1  # of the criterion: a smaller gain does not keep a term that is not determined
MATERIAL = 0.03  # of the criterion: a smaller gain does not earn a term its place
REFITS = 3  # terms that are fitted in each step, those with the best screens
DETERMINED = 0.5  # standard error over value above which a parameter is not determined: its 95 % interval holds zero
SAME = 1e-3  # of the parent's cost: a child's optimum above it has not converged
MINUTES = 5.0
RESERVE = 0.15  # of the time: kept for the last fit
LAST_EVALUATIONS = 60
OUT_OF_TIME = "the time limit was reached: raise minutes to go on"
NO_BETTER = "no further term lowers the squared error of left-out parts by 3 %"


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
    `pliant.selection.criterion`) joins the model if it improves its sum of squares by 3 %. At the end, terms without
    which the prediction is as good, and terms that the recordings do not determine (standard error above half the
    value), are dropped again. An undetermined time or angle of a term that is needed is held at its value.

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
    setting = FitSetting(tuple(train), first.time_step, how["weighting"], how["loss"])
    parent = anchored(fitted(setting, first.model, [replace(p, std=None) for p in first.parameters], evaluations=0),
                      setting)
    given = model.with_(stations=parent.model.stations)
    terms = terms_for(model, train) if how["terms"] is None else how["terms"]
    return Search(setting, given, parent, terms, began, began + 60 * how["minutes"], progress or ignore).run()


def anchored(parent: FittedModel, setting: FitSetting) -> FittedModel:
    """Return a fit of the first model in which the stiffness is held, if the recordings do not determine it.

    Stiffness, damping and torque then have a common scale that no recording of this body shows, and the other
    parameters are determined relative to the stiffness.
    """
    error, value = parent.standard_errors.get("stiffness", 0.0), parent.values.get("stiffness", 0.0)
    if error is not None and error <= DETERMINED * value:
        return parent
    why = f"held: the recordings show only {value:.3g}" + ("" if error is None else f" +- {error:.2g}")
    held = [replace(p, free=False, source=why) if p.name == "stiffness" else p for p in parent.parameters]
    return fitted(setting, parent.model, held)


def ignore(_line: str) -> None:
    """Ignore a line of progress."""


def check_options(how: SearchOptions) -> None:
    """Raise InputError for an unknown weighting or loss, or a time limit that is not positive."""
    check_choices(how["loss"], how["weighting"])
    if not how["minutes"] > 0:
        raise InputError(f"minutes must be positive, got {how['minutes']}: give the time that the search may take")


def beginning(model: Model, train: Sequence[Experiment], common: Sequence[Entry]) -> list[Entry]:
    """Return the parameters with which a search begins: those in `common`, and unless these replace them stiffness,
    damping and a torque proportional to each input; of a body that lengthens also axial damping and the axial force of
    each chamber. Its axial stiffness is stated: only the ratio of the forces to it shows.
    """
    stated = {e if isinstance(e, str) else e.name for e in common}
    kinds = {shared_name(name.removesuffix("_*")) for name in stated}
    names = [n for n in ("stiffness", "damping") if n not in kinds and "body_stiffness" not in kinds]
    if any(e.excitation != "release" for e in train):
        names += [n for n in torque_names(model) if n not in stated]
    if mechanics_of(model).lengthens and not model.chambers[0].signs:
        names += [n for n in ("axial_damping",) if n not in kinds]
        names += [f"{start}axial_gain" for start, chamber in zip(prefixes(model), model.chambers, strict=True)
                  if chamber.uses("axial_gain") and f"{start}axial_gain" not in stated]  # fmt: skip
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
class Search:
    """A search under way: the best model so far, the terms that it has, and what was tried.

    Attributes
    ----------
    given : Model
        Model without the values of any term, with the stations of the first fit.
    began, deadline : float
        Times on the monotonic clock, s.
    """

    setting: FitSetting
    given: Model
    best: FittedModel
    terms: Sequence[Term]
    began: float
    deadline: float
    notify: Notify
    chosen: list[Term] = field(default_factory=list)
    steps: list[SelectionStep] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.groups = groups_of(self.best)
        self.score = self.scored(self.best)
        self.record("", "stiffness, damping and torque")

    def run(self) -> ModelSelection:
        """Add terms until none helps, drop those that are not needed, and return the selection."""
        stop = ""
        try:
            while not stop:
                stop = self.add_term()
            while self.drop_term() or self.hold_parameter():
                pass
        except KeyboardInterrupt:
            stop = "it was interrupted, and this is the best model so far"
            self.notify("interrupted: the best model so far is fitted and judged; press Ctrl-C again to stop at once")
        result = self.final_fit()
        names = tuple(term.name for term in self.chosen)
        return ModelSelection(tuple(self.steps), names, self.reason(stop), result, clock.monotonic() - self.began)

    def model(self, *more: Term) -> Model:
        """Return the given model with the segments that the chosen terms and `more` need."""
        model = self.given
        for term in (*self.chosen, *more):
            model = term.model(model)
        return model

    def scored(self, fit: FittedModel) -> float:
        """Return the criterion: the sum of squares of the residuals as predicted from other parts of the recordings."""
        predicted = left_out(fit, self.groups)
        return float(predicted @ predicted)

    def record(self, name: str, title: str) -> None:
        """Record the model as it is now, after the term `name` joined it or left it."""
        predicted = left_out(self.best, self.groups)
        errors = self.best.percent(self.best.residual), self.best.percent(predicted)
        self.steps.append(SelectionStep(name, title, self.best.free, self.best.cost, *errors))
        left = max(self.deadline - clock.monotonic(), 0.0)
        self.notify(
            f"{title}: error of left-out parts {self.steps[-1].left_out_percent:.3g} % of the peak displacement, "
            f"{len(self.best.free)} parameters ({clock.monotonic() - self.began:.0f} s; at most {left:.0f} s more)"
        )

    @property
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

    def ranked(self) -> tuple[list[TermProposal], list[TriedTerm]]:
        """Return the best proposal of each open term, the most promising first, and the terms that cannot be
        screened or whose screen ends at a bound.

        The rank is the information criterion of the cost that the screen predicts.
        """
        proposals, refused = screened(self.best, self.model(), self.open_terms(), self.setting)
        trials = [TriedTerm(r.term.name, r.term.title, reason=f"cannot be screened: {r.reason}") for r in refused]
        numbers = effective_numbers(self.best.problem, self.best.residual)
        best: dict[str, TermProposal] = {}
        for p in proposals:  # the lowest cost of each term comes first
            if p.sense:
                best.setdefault(p.term.name, p)
        beyond = {p.term.name: p.term for p in proposals if p.term.name not in best}
        trials += [TriedTerm(t.name, t.title, reason="its value would lie beyond its bounds") for t in beyond.values()]

        def rank(p: TermProposal) -> float:
            return float(numbers * np.log(max(p.cost, 1e-300)) + np.log(numbers) * extra_parameters(p.term))

        return sorted(best.values(), key=rank), trials

    def add_term(self) -> str:
        """Add the best term to the model. Return why the search ends, or '' if a term was added."""
        if self.late:
            return OUT_OF_TIME
        proposals, trials = self.ranked()
        children: list[tuple[float, FittedModel, Term]] = []
        tries = 0
        for proposal in proposals[:REFITS]:
            if children and min(child.cost for _, child, _ in children) < proposal.cost:
                break  # already better than the screen promises of this one
            if self.late:
                break
            tries += 1
            better, trial = self.child(proposal)
            trials.append(trial)
            if better is not None:
                children.append((*better, proposal.term))
        trials += [TriedTerm(p.term.name, p.term.title, p.cost, reason="other terms promise more")
                   for p in proposals[tries:]]
        self.steps[-1] = replace(self.steps[-1], tried=tuple(trials))
        if not children:
            return OUT_OF_TIME if self.late else NO_BETTER
        self.score, self.best, term = min(children, key=lambda c: c[0])
        self.chosen.append(term)
        self.record(term.name, term.title)
        return ""

    def child(self, proposal: TermProposal) -> tuple[tuple[float, FittedModel] | None, TriedTerm]:
        """Fit the model with one more term. Return the criterion and the fit, or None if the term is refused, and what
        was tried.
        """
        term, trial = proposal.term, TriedTerm(proposal.term.name, proposal.term.title, proposal.cost)
        gone = {*term.replaces, *(p.name for p in term.adds)}
        others = [p for p in self.best.parameters if p.name not in gone]
        best: FittedModel | None = None
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
        by = f"{100 * (np.sqrt(score / self.score) - 1):+.2g} %"
        if score > (1 - MATERIAL) * self.score:
            return None, trial._replace(reason=f"left-out parts are predicted no better (error {by})")
        return (score, best), trial._replace(reason=f"left-out parts are predicted better (error {by})")

    def drop_term(self) -> bool:
        """Drop the term without which left-out parts are predicted best, if the model does not need it. Return whether
        a term was dropped.
        """
        needed = {t.needs for t in self.chosen} | {t.name for t in self.chosen[-1:]}
        smaller = [s for t in self.chosen if t.name not in needed and not t.extension and not t.replaces
                   and not self.late and (s := self.without(t)) is not None]  # fmt: skip
        if not smaller:
            return False
        self.score, self.best, term = min(smaller, key=lambda s: s[0])
        self.chosen.remove(term)
        self.record(f"-{term.name}", f"without {term.title}")
        return True

    def without(self, term: Term) -> tuple[float, FittedModel, Term] | None:
        """Return criterion and fit of the model without a term; None if the model needs the term.

        A term is needed if left-out parts are predicted worse without it: by 3 % in the sum of squares or, if the
        recordings do not determine the term, by 10 %. A term whose loss, by linearisation, raises the cost beyond doubt
        is not fitted.
        """
        vague = undetermined(self.best, term)
        if not vague and cost_without(self.best, term) > (1 + 2 * MATERIAL) * self.best.cost:
            return None
        gone = {p.name for p in term.adds}
        try:
            end = fitted(self.setting, self.model(), [p for p in self.best.parameters if p.name not in gone],
                         prior_weight=self.best.prior_weight)
        except PliantError:
            return None
        score = self.scored(end)
        return (score, end, term) if score < (1 + (MUCH if vague else MATERIAL)) * self.score else None

    def hold_parameter(self) -> bool:
        """Hold an undetermined time, angle or limit of a term constant at its value; return whether there was one.

        The value is stated with its source, and the other parameters of the term are determined relative to it.
        """
        vague = {name: text for t in self.chosen for name, text in undetermined(self.best, t).items()
                 if name not in t.null}  # fmt: skip
        if not vague or self.late:
            return False
        name = next(iter(vague))
        held = [replace(p, free=False, source=f"held: the recordings show only {vague[name]}") if p.name == name else p
                for p in self.best.parameters]
        try:
            self.best = fitted(self.setting, self.model(), held, prior_weight=self.best.prior_weight)
        except PliantError:
            return False
        self.score = self.scored(self.best)
        self.record(f"={name}", f"{name} held at {self.best.values[name]:.3g}")
        return True

    def final_fit(self) -> FitResult:
        """Return the chosen model, fitted until it converges."""
        problem, began = self.best.problem, clock.perf_counter()
        best = solve(problem, self.best.x, self.setting.loss, LAST_EVALUATIONS)
        for _ in range(2 if problem.learns else 0):
            problem.learn_sizes(best.x)
            best = solve(problem, best.x, self.setting.loss, LAST_EVALUATIONS)
        return finished(problem, best, self.setting.loss, None, clock.perf_counter() - began, "")

    def reason(self, stop: str) -> str:
        """Return a sentence on the model that was chosen and why the search ended."""
        names = ", ".join(t.title for t in self.chosen) or "no further term"
        first, last = self.steps[0].left_out_percent, self.steps[-1].left_out_percent
        vague = {n: v for t in self.chosen for n, v in undetermined(self.best, t).items()}
        stop += "".join(f"; not determined, but needed: {n} ({v})" for n, v in vague.items())
        return (f"{names}: left-out parts of the training recordings are predicted with {last:.3g} % of the peak "
                f"displacement ({first:.3g} % without these terms); {stop}")


def extra_parameters(term: Term) -> int:
    """Return by how many a term raises the number of free parameters."""
    return sum(p.free for p in term.adds) - len(term.replaces)


def undetermined(fit: FittedModel, term: Term) -> dict[str, str]:
    """Return the parameters of a term that the recordings do not determine, each with its value and error as text.

    The standard error is compared with the distance from the value without effect. Parameters of single joints, which
    shrink to their mean, and those with a prior rest on that.
    """
    errors, values, vague = fit.standard_errors, fit.values, {}
    for name in (p.name for p in term.adds if p.name in errors and not p.shrink and not p.prior_std):
        error, value = errors[name], values[name]
        without_effect = term.null.get(name, 0.0)
        if error is None:
            vague[name] = "no effect of it"
        elif error > DETERMINED * abs(value - without_effect):
            vague[name] = f"{value:.3g} +- {error:.2g}"
    return vague


def cost_without(fit: FittedModel, term: Term) -> float:
    """Return the cost that the linearised model leaves with the parameters of a term at their null values."""
    names = {p.name for p in term.adds}
    mine = [k for k, name in enumerate(fit.free) if name in term.null]
    keep = [k for k, name in enumerate(fit.free) if name not in names]
    away = np.array([term.null[fit.free[k]] for k in mine]) / fit.problem.scale[mine] - fit.x[mine]
    moved = fit.residual + fit.jacobian[:, mine] @ away
    basis = np.linalg.qr(fit.jacobian[:, keep])[0]
    left = moved - basis @ (basis.T @ moved)
    return 0.5 * float(left @ left)
