"""The search for the terms that the training recordings ask for, by screens and a few refits."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from pliant.errors import PliantError
from pliant.identification.fit import finished
from pliant.identification.optimise import solve
from pliant.identification.parameters import Parameter
from pliant.identification.result import FitResult
from pliant.model import Model
from pliant.selection.criterion import (
    MATERIAL,
    at_bounds,
    by_percent,
    cost_without,
    left_out,
    noise_of,
    parts_of,
    score_of,
    undetermined,
)
from pliant.selection.fitted import (
    EVALUATIONS,
    TOLERANCE,
    FitSetting,
    FittedModel,
    fitted,
    rivals_among,
    with_checked_step,
)
from pliant.selection.result import ModelSelection, SelectionStep, TriedTerm
from pliant.selection.saved import SearchFile
from pliant.selection.screen import TermProposal, screened
from pliant.selection.terms import Term

Array = np.ndarray
Notify = Callable[[str], None]
MUCH = 0.1  # of the criterion: a smaller gain does not keep a term that is not determined
REFITS = 3  # terms that are fitted in each step, those with the best screens
MOST_REFITS = 6  # of them while none helps: a screen underestimates terms that act nonlinearly, such as friction
MOST_OTHERS = 8  # models that are kept during the search, of which some are rivals in the end
ROUGH, ROUGH_EVALUATIONS = 1e-3, 12  # relative change of the cost, and evaluations, at which a trial of a term stops
SAME = 1e-3  # of the parent's cost: a child's optimum above it has not converged
RESERVE = 0.15  # of the time: kept for the last fit
LAST_EVALUATIONS = 60
FEWEST_EVALUATIONS = 3  # of a fit, however little time is left
OUT_OF_TIME = "the time limit was reached: raise minutes to go on"
NO_BETTER = "no further term lowers the squared error of left-out parts by 3 %"


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
    file: SearchFile | None = None
    chosen: list[Term] = field(default_factory=list)
    steps: list[SelectionStep] = field(default_factory=list)
    others: list[tuple[float, str, FittedModel]] = field(default_factory=list)  # criterion, difference, fit
    pace: float = 0.0  # s per evaluation of the last fit

    def __post_init__(self) -> None:
        self.allowed = self.deadline - clock.monotonic()
        self.parts = parts_of(self.best)
        self.score = self.scored(self.best)
        if not self.steps:
            self.record("", ", ".join(["stiffness, damping and torque", *(t.title for t in self.chosen)]))

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
        return ModelSelection(tuple(self.steps), names, self.reason(stop), result, clock.monotonic() - self.began,
                              stop == NO_BETTER, rivals_among(self.others, self.score, self.best, self.setting.loss))

    def model(self, *more: Term) -> Model:
        """Return the given model with the segments that the chosen terms and `more` need."""
        model = self.given
        for term in (*self.chosen, *more):
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
        unless left-out parts are then predicted worse.
        """
        self.best, self.score = fit, score
        if not fit.problem.learns or self.late or abs(fit.prior_weight / fit.problem.size - 1.0) <= MATERIAL:
            return
        with suppress(PliantError):
            weighted = self.converged(fit, fit.prior_weight)
            if (other := self.scored(weighted)) < (1 + MATERIAL) * score:
                self.best, self.score = weighted, other

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

    def record(self, name: str, title: str) -> None:
        """Record the model as it is now, after the term `name` joined it or left it."""
        predicted = self.predicted(self.best)
        errors = self.best.percent(self.best.residual), self.best.percent(predicted)
        self.steps.append(SelectionStep(name, title, self.best.free, self.best.cost, *errors))
        if self.file is not None:
            self.file.save([t.name for t in self.chosen], self.steps, self.best, self.setting.time_step,
                           clock.monotonic() - self.began)
        left = max(self.deadline - clock.monotonic(), 0.0)
        self.notify(
            f"{title}: error of left-out parts {self.steps[-1].left_out_percent:.3g} % of the peak displacement, "
            f"{len(self.best.free)} parameters ({clock.monotonic() - self.began:.0f} s; at most {left:.0f} s more)"
        )

    def keep(self, score: float, title: str, fit: FittedModel) -> None:
        """Keep a model as a possible rival of the chosen one; those with the lowest criteria stay."""
        self.others = sorted([*self.others, (score, title, fit)], key=lambda c: c[0])[:MOST_OTHERS]

    def vague(self, term: Term) -> dict[str, str]:
        """Return the parameters of a term that neither the recordings nor a prior determine, each with its value and
        error.
        """
        prior = {p.name for p in self.best.problem.free if p.prior_std}
        vague = undetermined(self.best.values, self.best.standard_errors, term)
        return {name: text for name, text in vague.items() if name not in prior}

    @property
    def late(self) -> bool:
        """Return whether the time that is left is needed for the last fit."""
        return clock.monotonic() > self.deadline - RESERVE * self.allowed

    def open_terms(self) -> list[Term]:
        """Return the terms that may join the model as it is."""
        names = {name for t in self.chosen for name in (t.name, *t.includes)}
        groups = {t.group for t in self.chosen if t.group}
        parameters, free = {p.name for p in self.best.parameters}, set(self.best.free)
        return [
            t for t in self.terms
            if t.name not in names and t.group not in groups and (not t.needs or t.needs in names)
            and set(t.replaces) <= free and not any(p.name in parameters for p in t.adds if p.free)
        ]  # fmt: skip

    def ranked(self) -> tuple[list[TermProposal], list[TriedTerm]]:
        """Return the best proposal of each open term, the most promising first, and the terms that cannot be
        screened or whose screen ends at a bound.

        The rank is the criterion that the screen predicts.
        """
        proposals, refused = screened(self.best, self.model(), self.open_terms(), self.setting, self.parts)
        trials = {r.term.name: TriedTerm(r.term.name, r.term.title, reason=f"cannot be screened: {r.reason}")
                  for r in refused}
        best: dict[str, TermProposal] = {}
        for p in proposals:  # the best row of each term comes first
            if p.sense:
                best.setdefault(p.term.name, p)
        trials |= {p.term.name: TriedTerm(p.term.name, p.term.title, reason="its value would lie beyond its bounds")
                   for p in proposals if p.term.name not in best}
        return list(best.values()), list(trials.values())

    def add_term(self) -> str:
        """Add the best term to the model. Return why the search ends, or '' if a term was added.

        Terms are tried until three help, or six do not. The best of them joins, if it helps when its fit has converged;
        if none does, the terms that were passed over are tried too.
        """
        if self.late:
            return OUT_OF_TIME
        proposals, trials = self.ranked()
        tried: dict[str, TriedTerm] = {}
        children: list[tuple[float, FittedModel, Term]] = []
        joined: Term | None = None
        while joined is None and (proposal := self.next_proposal(proposals, tried, children)):
            better, tried[proposal.term.name] = self.child(proposal)
            if better is not None:
                children.append((*better, proposal.term))
            if self.next_proposal(proposals, tried, children) is None:
                best_first = sorted(children, key=lambda c: c[0])
                joined = next((t for _, fit, t in best_first if self.joins(fit, t, tried)), None)
                children = []
        passed = (p for p in proposals if p.term.name not in tried)
        trials += [*tried.values(), *(TriedTerm(p.term.name, p.term.title, p.cost, reason="other terms promise more")
                                      for p in passed)]  # fmt: skip
        self.steps[-1] = replace(self.steps[-1], tried=tuple(trials))
        if joined is None:
            return OUT_OF_TIME if self.late else NO_BETTER
        self.record(joined.name, joined.title)
        return ""

    def next_proposal(
        self, proposals: Sequence[TermProposal], tried: Mapping[str, TriedTerm],
        children: Sequence[tuple[float, FittedModel, Term]],
    ) -> TermProposal | None:
        """Return the next proposal to fit; None if enough terms were `tried`, if one of the `children` is better than
        the rest promise, or if the time is over.
        """
        if self.late or len(tried) >= (REFITS if children else MOST_REFITS):
            return None
        groups = {p.term.group for p in proposals if p.term.name in tried and p.term.group}
        left = (p for p in proposals if p.term.name not in tried and p.term.group not in groups)
        best = min((score for score, _, _ in children), default=np.inf)
        return next((p for p in left if p.score <= best), None)

    def joins(self, fit: FittedModel, term: Term, tried: dict[str, TriedTerm]) -> bool:
        """Adopt the fit with one more term, unless the converged one is refused: then its entry in `tried` says why.
        Return whether the term joined.
        """
        trial = tried[term.name]
        try:
            end = fit if self.late else self.converged(fit, fit.problem.size)
        except PliantError as error:
            tried[term.name] = trial._replace(reason=str(error))
            return False
        score = self.scored(end)
        helps, tried[term.name] = self.judged(end, score, term, trial)
        if helps:
            self.chosen.append(term)
            self.adopt(end, score)
        else:  # the rough fit promised too much
            title = f"with {term.title}"
            self.others = [other for other in self.others if other[1] != title]
            self.keep(score, title, end)
        return helps

    def affordable(self, most: int, *, last: bool = False) -> int:
        """Return how many evaluations a fit may take: at most `most`, and no more than the time left allows, of which a
        part is kept for the `last` fit.
        """
        left = self.deadline - clock.monotonic() - (0.0 if last else RESERVE * self.allowed)
        return most if self.pace == 0.0 else int(np.clip(left / self.pace, FEWEST_EVALUATIONS, most))

    def refitted(self, model: Model, parameters: Sequence[Parameter], *, roughly: bool = False) -> FittedModel:
        """Return the fit of a model from its start values; `roughly`, with the evaluations that a comparison needs."""
        limits = (ROUGH_EVALUATIONS, ROUGH) if roughly else (EVALUATIONS, TOLERANCE)
        return self.timed(model, parameters, self.best.problem.size, *limits)

    def child(self, proposal: TermProposal) -> tuple[tuple[float, FittedModel] | None, TriedTerm]:
        """Fit the model with one more term. Return the criterion and the fit, or None if the term is refused, and what
        was tried.
        """
        term, trial = proposal.term, TriedTerm(proposal.term.name, proposal.term.title, proposal.cost)
        gone = {*term.replaces, *(p.name for p in term.adds)}
        others, model = [p for p in self.best.parameters if p.name not in gone], self.model(term)
        starts = [[*others, *term.begun(proposal.row, values)] for values in proposal.starts()]
        try:
            start = self.setting.cheapest(model, starts, self.best.problem.size)
            best = self.refitted(model, start, roughly=True)
            if best.cost > (1 + SAME) * self.best.cost:
                again = self.refitted(model, starts[-1], roughly=True)
                best = min(best, again, key=lambda end: end.cost)
        except PliantError as error:
            return None, trial._replace(reason=str(error))
        score = self.scored(best)
        self.keep(score, f"with {term.title}", best)
        helps, trial = self.judged(best, score, term, trial)
        return (score, best) if helps else None, trial

    def judged(self, fit: FittedModel, score: float, term: Term, trial: TriedTerm) -> tuple[bool, TriedTerm]:
        """Return whether a fit with one more term, of the criterion `score`, predicts left-out parts better and stays
        inside its bounds, and the trial with the reason.
        """
        by, trial = by_percent(score, self.score), trial._replace(cost=fit.cost, left_out=score)
        if fit.cost > (1 + SAME) * self.best.cost:
            return False, trial._replace(reason="its fit has not converged: the cost is above that without the term")
        if ends := at_bounds(fit, term):
            return False, trial._replace(reason=f"its fit ends at a bound: {', '.join(ends)}")
        helps = score <= (1 - MATERIAL) * self.score
        return helps, trial._replace(
            reason=f"left-out parts are predicted {'better' if helps else 'no better'} (error {by})")

    def drop_term(self) -> bool:
        """Drop the term without which left-out parts are predicted best, if the model does not need it. Return whether
        a term was dropped.
        """
        needed = {t.needs for t in self.chosen} | {t.name for t in self.chosen[-1:]}
        smaller = [s for t in self.chosen if not needed & {t.name, *t.includes} and not t.extension and not t.replaces
                   and not self.late and (s := self.without(t)) is not None]  # fmt: skip
        if not smaller:
            return False
        score, best, term = min(smaller, key=lambda s: s[0])
        self.chosen.remove(term)
        self.adopt(best, score)
        self.record(f"-{term.name}", f"without {term.title}")
        return True

    def without(self, term: Term) -> tuple[float, FittedModel, Term] | None:
        """Return criterion and fit of the model without a term; None if the model needs the term.

        A term is needed if left-out parts are predicted worse without it: by 3 % in the sum of squares or, if the
        recordings do not determine the term, by 10 %. A term whose loss, by linearisation, raises the cost beyond doubt
        is not fitted.
        """
        vague = self.vague(term)
        if not vague and cost_without(self.best, term) > (1 + 2 * MATERIAL) * self.best.cost:
            return None
        gone = {p.name for p in term.adds}
        try:
            end = self.refitted(self.model(), [p for p in self.best.parameters if p.name not in gone])
        except PliantError:
            return None
        score = self.scored(end)
        self.keep(score, f"without {term.title}", end)
        return (score, end, term) if score < (1 + (MUCH if vague else MATERIAL)) * self.score else None

    def hold_parameter(self) -> bool:
        """Hold an undetermined time, angle or limit of a term constant at its value; return whether there was one.

        The value is stated with its source, and the other parameters of the term are determined relative to it.
        """
        vague = {name: text for t in self.chosen for name, text in self.vague(t).items()
                 if name not in t.null}  # fmt: skip
        upper = {p.name: p.upper for p in self.best.problem.free}
        vague |= {name: "that it is as long as they are, or longer" for t in self.chosen for name in t.limits
                  if self.best.values[name] >= (1.0 - 1e-6) * upper.get(name, np.inf)}  # fmt: skip
        if not vague or self.late:
            return False
        name = next(iter(vague))
        named = [replace(p, free=False, source=f"held: the recordings show only {vague[name]}") if p.name == name else p
                for p in self.best.parameters]
        try:
            self.best = self.refitted(self.model(), named)
        except PliantError:
            return False
        self.score = self.scored(self.best)
        self.record(f"={name}", f"{name} held at {self.best.values[name]:.3g}")
        return True

    def final_fit(self) -> FitResult:
        """Return the chosen model, fitted until it converges."""
        problem, began = with_checked_step(self.best, self.setting), clock.perf_counter()
        evaluations = self.affordable(LAST_EVALUATIONS, last=True)
        best = solve(problem, self.best.x, self.setting.loss, evaluations)
        for _ in range(2 if problem.learns else 0):
            problem.learn_sizes(best.x)
            evaluations = self.affordable(LAST_EVALUATIONS, last=True)
            best = solve(problem, best.x, self.setting.loss, evaluations)
        late = best.status == 0 and evaluations < LAST_EVALUATIONS
        failure = "stopped at the time limit before it converged: raise minutes" if late else ""
        return finished(problem, best, self.setting.loss, None, clock.perf_counter() - began, failure)

    def reason(self, stop: str) -> str:
        """Return a sentence on the model that was chosen and why the search ended."""
        names = ", ".join(t.title for t in self.chosen) or "no further term"
        first, last = self.steps[0].left_out_percent, self.steps[-1].left_out_percent
        vague = {n: v for t in self.chosen for n, v in self.vague(t).items()}
        stop += "".join(f"; not determined, but needed: {n} ({v})" for n, v in vague.items())
        return (f"{names}: left-out parts of the training recordings are predicted with {last:.3g} % of the peak "
                f"displacement ({first:.3g} % without these terms); {stop}")
