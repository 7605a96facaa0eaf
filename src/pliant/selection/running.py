"""The state of a search for terms, and what every step of it does: screen, fit, judge, record."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from pliant.errors import PliantError
from pliant.identification.parameters import Parameter
from pliant.model import Model
from pliant.selection.criterion import (
    MATERIAL,
    effective_numbers,
    left_out,
    noise_of,
    parts_of,
    score_of,
    strays,
    undetermined,
)
from pliant.selection.first_model import scale_of
from pliant.selection.fitted import EVALUATIONS, TOLERANCE, FitSetting, FittedModel, fitted
from pliant.selection.result import Change, SelectionStep, TriedTerm
from pliant.selection.saved import SearchFile
from pliant.selection.screen import TermProposal, screened
from pliant.selection.terms import Term

Array = np.ndarray
Notify = Callable[[str], None]
MOST_OTHERS = 8  # models that are kept during the search, of which some are rivals in the end
ROUGH, ROUGH_EVALUATIONS = 1e-3, 12  # relative change of the cost, and evaluations, at which a trial of a term stops
SAME = 1e-3  # of the parent's cost: a child's optimum above it has not converged
WHITE = 0.7  # of the number of residuals: as many independent ones show no error of the model
FIRST = "stiffness, damping and torque"  # title of the model without any term
RESERVE = 0.15  # of the time: kept for the last fit
FEWEST_EVALUATIONS = 3  # of a fit, however little time is left


@dataclass
class RunningSearch:
    """The state of a search: the best model so far, the terms that it has, what was tried, and the time that is left.

    Attributes
    ----------
    given : Model
        Model without the values of any term, with the stations of the first fit.
    began, deadline : float
        Times on the monotonic clock, s.
    stated : frozenset of str
        Names of parameters that are the same in every model.
    dropped : set of str
        Names of terms that left the model, and do not join again.
    restarts : set of frozensets of str
        Names of the terms of models whose fits were begun anew.
    """

    setting: FitSetting
    given: Model
    best: FittedModel
    terms: Sequence[Term]
    began: float
    deadline: float
    notify: Notify
    file: SearchFile | None = None
    chosen: list[Term] = field(default_factory=list)
    steps: list[SelectionStep] = field(default_factory=list)
    others: list[tuple[float, str, FittedModel]] = field(default_factory=list)  # criterion, difference, fit
    stated: frozenset[str] = frozenset()
    dropped: set[str] = field(default_factory=set)
    restarts: set[frozenset[str]] = field(default_factory=set)
    first: Sequence[Parameter] = ()  # those of the first model, at its values; default: of `best`
    pace: float = 0.0  # s per evaluation of the last fit
    interrupted: bool = False  # while the best model was not recorded yet

    def __post_init__(self) -> None:
        self.allowed = self.deadline - clock.monotonic()
        self.parts, self.first = parts_of(self.best), tuple(self.first) or tuple(self.best.parameters)
        self.score = self.scored(self.best)
        if not self.steps:
            self.record("", ", ".join([FIRST, *(t.title for t in self.chosen)]), "begins")

    def model(self, *more: Term, without: Term | None = None) -> Model:
        """Return the given model with the segments that the chosen terms, but one, and `more` need."""
        model = self.given
        for term in (*(t for t in self.chosen if t is not without), *more):
            model = term.model(model)
        return model

    def scored(self, fit: FittedModel) -> float:
        """Return the criterion of the residuals as predicted from other parts of the recordings (see `criterion`)."""
        return score_of(fit, self.parts)

    def predicted(self, fit: FittedModel) -> Array:
        """Return the residuals (N,) of each part of the recordings as predicted from the other parts."""
        return left_out(fit.linear, self.parts.groups, noise_of(fit))

    def adopt(self, fit: FittedModel, score: float) -> None:
        """Take a converged fit, of the criterion `score`, as the best model. Its priors are weighted by its residuals,
        unless left-out parts are then predicted worse. An interrupt (Ctrl-C) acts after the next `record`.
        """
        self.best, self.score = fit, score
        if not fit.problem.learns or self.late or abs(fit.prior_weight / fit.problem.size - 1.0) <= MATERIAL:
            return
        try:
            weighted = self.converged(fit, fit.prior_weight)
            if (other := self.scored(weighted)) < (1 + MATERIAL) * score:
                self.best, self.score = weighted, other
        except PliantError:
            return
        except KeyboardInterrupt:
            self.interrupted = True  # the model is recorded first, as it is without these weights

    def taken(self, fit: FittedModel, score: float, chosen: Sequence[Term]) -> str:
        """Adopt a converged fit with the terms `chosen`, unless it, or what it becomes with its priors weighted, is not
        to be trusted beyond the inputs of the recordings: then return why, and keep the model as it is.
        """
        before = self.best, self.score
        self.adopt(fit, score)
        if reason := strays(self.best, before[0]):
            self.best, self.score = before
            return reason
        self.chosen = list(chosen)
        return ""

    def converged(self, fit: FittedModel, prior_weight: float) -> FittedModel:
        """Return a fit continued until it converges, with another weight of its priors."""
        return self.timed(fit.model, fit.parameters, prior_weight, EVALUATIONS, 0.1 * ROUGH)

    def timed(
        self, model: Model, parameters: Sequence[Parameter], prior_weight: float, most: int, tolerance: float,
    ) -> FittedModel:
        """Return the fit of a model from its start values, with as many evaluations as the time left allows."""
        began = clock.monotonic()
        end = fitted(self.setting, model, parameters, prior_weight=prior_weight, evaluations=self.affordable(most),
                     tolerance=tolerance)  # fmt: skip
        self.pace = (clock.monotonic() - began) / max(end.problem.evaluations, 1)
        return end

    def record(self, name: str, title: str, change: Change = "joins") -> None:
        """Record the model as it is now, after the `change` of the term or parameter `name`."""
        predicted = self.predicted(self.best)
        errors = self.best.percent(self.best.residual), self.best.percent(predicted)
        self.steps.append(SelectionStep(name, title, change, self.best.free, self.best.cost, *errors))
        if self.file is not None:
            self.file.save([t.name for t in self.chosen], self.steps, self.best, self.first,
                           self.setting.time_step, clock.monotonic() - self.began)
        left = max(self.deadline - clock.monotonic(), 0.0)
        self.notify(
            f"{title}: error of left-out parts {self.steps[-1].left_out_percent:.3g} % of the peak displacement, "
            f"{len(self.best.free)} parameters ({clock.monotonic() - self.began:.0f} s; at most {left:.0f} s more)"
        )
        if self.interrupted:
            self.interrupted = False
            raise KeyboardInterrupt

    def keep(self, score: float, title: str, fit: FittedModel) -> None:
        """Keep a model as a possible rival of the chosen one, unless it is not to be trusted beyond the recordings.
        Those with the lowest criteria stay.
        """
        if len(fit.free) > len(self.best.free) and strays(fit, self.best):
            return
        self.others = sorted([*self.others, (score, title, fit)], key=lambda c: c[0])[:MOST_OTHERS]

    def vague(self, term: Term, errors: Mapping[str, float | None]) -> dict[str, str]:
        """Return the parameters of a term that neither a prior nor the recordings determine, as the standard `errors`
        (SI) say, each with its value and error.
        """
        prior = {p.name for p in self.best.problem.free if p.prior_std}
        vague = undetermined(self.best.values, errors, term)
        return {name: text for name, text in vague.items() if name not in prior}

    @property
    def late(self) -> bool:
        """Return whether the time that is left is needed for the last fit."""
        return self.time_left < 0.0

    @property
    def time_left(self) -> float:
        """Return the time [s] that is left until the last fit."""
        return self.deadline - RESERVE * self.allowed - clock.monotonic()

    def open_terms(self, parent: FittedModel, chosen: Sequence[Term]) -> list[Term]:
        """Return the terms that may join the fit `parent`, which has the terms `chosen`."""
        names = {name for t in chosen for name in (t.name, *t.includes)}
        groups = {t.group for t in chosen if t.group}
        parameters, free = {p.name for p in parent.parameters} - {"stiffness"}, set(parent.free)
        held = {p.name: p.value for p in parent.parameters if not p.free and p.value and p.name not in self.stated}
        return [
            t.about(held) for t in (*self.terms, *scale_of(parent.parameters, self.stated))
            if t.name not in names | self.dropped and t.group not in groups and (not t.needs or t.needs in names)
            and set(t.replaces) <= free | set(held) and not any(
                p.name in parameters if p.free else p.name in self.stated for p in t.adds)
        ]  # fmt: skip

    def ranked(self, parent: FittedModel, chosen: Sequence[Term]) -> tuple[list[TermProposal], list[TriedTerm]]:
        """Return the best proposal of each term that may join the fit `parent`, the most promising first, and the terms
        that cannot be screened or whose screen ends at a bound.

        The rank is the criterion that the screen predicts. Terms on a held scale come last: where the scale is far off,
        they stand for it.
        """
        proposals, refused = screened(parent, self.model(), self.open_terms(parent, chosen), self.setting, self.parts)
        trials = {r.term.name: TriedTerm(r.term.name, r.term.title, reason=f"cannot be screened: {r.reason}")
                  for r in refused}
        best: dict[str, TermProposal] = {}
        for p in proposals:  # the best row of each term comes first
            if p.sense:
                best.setdefault(p.term.name, p)
        trials |= {p.term.name: TriedTerm(p.term.name, p.term.title, reason="its value would lie beyond its bounds")
                   for p in proposals if p.term.name not in best}
        return sorted(best.values(), key=lambda p: p.term.on_held_scale), list(trials.values())

    def affordable(self, most: int, *, last: bool = False) -> int:
        """Return how many evaluations a fit may take: at most `most`, and no more than the time left allows, of which a
        part is kept for the `last` fit.
        """
        left = self.time_left + (RESERVE * self.allowed if last else 0.0)
        return most if self.pace == 0.0 else int(np.clip(left / self.pace, FEWEST_EVALUATIONS, most))

    def refitted(self, model: Model, parameters: Sequence[Parameter], *, roughly: bool = False) -> FittedModel:
        """Return the fit of a model from its start values; `roughly`, with the evaluations that a comparison needs."""
        limits = (ROUGH_EVALUATIONS, ROUGH) if roughly else (EVALUATIONS, TOLERANCE)
        return self.timed(model, parameters, self.best.problem.size, *limits)

    def joined_roughly(self, parent: FittedModel, proposal: TermProposal) -> FittedModel:
        """Return the rough fit of a parent with the term of a proposal, from the start value that costs least; if its
        cost stays above that of the parent, the better one of this and of a fit from values nearly without effect.
        """
        term = proposal.term
        gone = {*term.replaces, *(p.name for p in term.adds)}
        others, model = [p for p in parent.parameters if p.name not in gone], self.model(term)
        starts = [[*others, *term.begun(proposal.row, values)] for values in proposal.starts()]
        fit = self.refitted(model, self.setting.cheapest(model, starts, self.best.problem.size), roughly=True)
        if fit.cost <= (1 + SAME) * parent.cost:
            return fit
        return min(fit, self.refitted(model, starts[-1], roughly=True), key=lambda end: end.cost)

    def rough_fits(self, model: Model, starts: Iterable[Sequence[Parameter]]) -> list[FittedModel]:
        """Return the rough fits of a model from several start values; fewer if it cannot be simulated or the time is
        over.
        """
        fits = []
        for start in starts:
            with suppress(PliantError):
                if not self.late:
                    fits.append(self.refitted(model, start, roughly=True))
        return fits

    def has_time_for(self, fits: int, share: float = 0.5) -> bool:
        """Return whether a number of rough fits takes less than a `share` of the time that is left."""
        return fits * ROUGH_EVALUATIONS * self.pace < share * self.time_left

    @property
    def white(self) -> bool:
        """Return whether the residuals of successive frames are not correlated: there is then nothing left to find."""
        best = self.best
        return effective_numbers(best.problem, best.residual) >= WHITE * best.residual.size

    def needed(self, term: Term) -> bool:
        """Return whether another of the chosen terms has no meaning without this one."""
        names = {p.name for p in term.adds}
        return any(t.needs in (term.name, *term.includes) for t in self.chosen if t.needs) or any(
            names & set(t.replaces) for t in self.chosen)

    def lengthens_by(self, term: Term) -> bool:
        """Return whether the body would keep its length without one of the chosen terms."""
        return bool(term.segments) and not self.model(without=term).extensions

    def parameters_without(self, term: Term) -> list[Parameter]:
        """Return the parameters of the best model without a term, with those of the first model that it replaces."""
        gone = {p.name for p in term.adds}
        others = [p for p in self.best.parameters if p.name not in gone]
        names = (gone | set(term.replaces)) - {p.name for p in others}
        freed = {p.name for t in self.chosen if t is not term for p in t.adds if p.free}
        return [*others, *(replace(p, free=p.free or p.name in freed) for p in self.first if p.name in names)]
