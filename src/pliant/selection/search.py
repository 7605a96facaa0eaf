"""The search for the terms that the training recordings ask for, by screens and a few refits."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pliant.errors import PliantError
from pliant.identification.fit import finished
from pliant.identification.optimise import solve
from pliant.identification.result import FitResult
from pliant.selection.criterion import (
    MATERIAL,
    at_bounds,
    by_percent,
    cost_without,
    strays,
)
from pliant.selection.fitted import (
    TOLERANCE,
    FittedModel,
    rivals_among,
    with_checked_step,
)
from pliant.selection.restart import exchanged, from_each_row, rescaled, restarted
from pliant.selection.result import ModelSelection, TriedTerm
from pliant.selection.running import FIRST, SAME, RunningSearch
from pliant.selection.screen import TermProposal
from pliant.selection.terms import Term

Array = np.ndarray
MUCH = 0.1  # of the criterion: a smaller gain does not keep a term that is not determined
REFITS = 3  # terms that are fitted in each step, those with the best screens
MOST_REFITS = 6  # of them while none helps: a screen underestimates terms that act nonlinearly, such as friction
LAST_EVALUATIONS = 60
EARLY = 0.05  # of the time left: what the alternatives of a term that has just joined may take
INTERRUPTED = "interrupted: the best model so far is fitted and judged; press Ctrl-C again to stop at once"
OUT_OF_TIME = "the time limit was reached: raise minutes to go on"
NO_BETTER = "no further term lowers the squared error of left-out parts by 3 %"


class Search(RunningSearch):
    """A search under way: it adds terms, begins fits anew, and drops terms until none of these helps."""

    def run(self, *, stopped: bool = False) -> ModelSelection:
        """Add terms until none helps, drop those that are not needed, and return the selection; of a search that was
        `stopped` by an interrupt before, with the model as it is.
        """
        stop = "it was interrupted, and this is the best model so far"
        try:
            if not stopped:
                ended = self.choose()
                self.drop_terms()
                stop = ended
        except KeyboardInterrupt:
            self.notify(INTERRUPTED)
        result = self.final_fit()
        names = tuple(term.name for term in self.chosen)
        rivals = rivals_among(self.others, self.score, self.best, self.setting.loss)
        return ModelSelection(tuple(self.steps), names, self.reason(stop), result,
                              clock.monotonic() - self.began, stop == NO_BETTER, rivals)

    def choose(self) -> str:
        """Add terms, begin fits anew and drop terms until none of these helps. Return why this ended."""
        stop = ""
        while not stop:
            stop = self.add_term()
            if stop == NO_BETTER and (self.restart_terms() or self.drop_terms()):
                stop = ""
        return stop

    def add_term(self) -> str:
        """Add the best term to the model. Return why the search ends, or '' if a term was added.

        Terms are tried until three help, or six do not. The best of them joins, if it helps when its fit has converged;
        if none does, the terms that were passed over are tried too.
        """
        if self.late:
            return OUT_OF_TIME
        proposals, trials = self.ranked(self.best, self.chosen)
        tried: dict[str, TriedTerm] = {}
        children: list[tuple[float, FittedModel, TermProposal]] = []
        joined: Term | None = None
        while joined is None and (proposal := self.next_proposal(proposals, tried, children)):
            better, tried[proposal.term.name] = self.child(proposal)
            if better is not None:
                children.append((*better, proposal))
            if self.next_proposal(proposals, tried, children) is None:
                best_first = sorted(children, key=lambda c: c[0])
                joined = next((p.term for _, fit, p in best_first if self.joins(fit, p, tried)), None)
                children = []
        passed = (p for p in proposals if p.term.name not in tried)
        trials += [*tried.values(), *(TriedTerm(p.term.name, p.term.title, p.cost, reason="other terms promise more")
                                      for p in passed)]  # fmt: skip
        self.steps[-1] = replace(self.steps[-1], tried=tuple(trials))
        if joined is None:
            return OUT_OF_TIME if self.late else NO_BETTER
        self.record(joined.name, joined.title)
        exchanged(self, joined, EARLY)
        rescaled(self, EARLY)
        return ""

    def next_proposal(
        self, proposals: Sequence[TermProposal], tried: Mapping[str, TriedTerm],
        children: Sequence[tuple[float, FittedModel, TermProposal]],
    ) -> TermProposal | None:
        """Return the next proposal to fit; None if enough terms were `tried`, if one of the `children` is better than
        the rest promise, or if the time is over. Terms on a held scale are tried if no other term helps.
        """
        if self.late or (children and len(tried) >= REFITS):
            return None
        groups = {p.term.group for p in proposals if p.term.name in tried and p.term.group}
        left = (p for p in proposals if p.term.name not in tried and p.term.group not in groups
                and (not children if p.term.on_held_scale else len(tried) < MOST_REFITS))  # fmt: skip
        best = min((score for score, _, _ in children), default=np.inf)
        return next((p for p in left if p.score <= best), None)

    def joins(self, fit: FittedModel, proposal: TermProposal, tried: dict[str, TriedTerm]) -> bool:
        """Adopt the fit with one more term, from the best row of its grid, unless the converged one is refused: then
        its entry in `tried` says why. Return whether the term joined.
        """
        term = proposal.term
        trial = tried[term.name]
        if len(term.grid) > 1 and self.has_time_for(2 * len(term.grid)):
            rows = from_each_row(self, self.best, term, without=proposal.row)
            fit = min([fit, *rows], key=lambda end: end.cost)
        try:
            end = fit if self.late else self.converged(fit, fit.problem.size)
        except PliantError as error:
            tried[term.name] = trial._replace(reason=str(error))
            return False
        score = self.scored(end)
        helps, tried[term.name] = self.judged(end, score, term, trial)
        if helps and (reason := self.taken(end, score, [*self.chosen, term])):
            helps, tried[term.name] = False, tried[term.name]._replace(reason=reason)
        if not helps:  # the rough fit promised too much
            title = f"with {term.title}"
            self.others = [other for other in self.others if other[1] != title]
            self.keep(score, title, end)
        return helps

    def child(self, proposal: TermProposal) -> tuple[tuple[float, FittedModel] | None, TriedTerm]:
        """Fit the model with one more term. Return the criterion and the fit, or None if the term is refused, and what
        was tried.
        """
        term, trial = proposal.term, TriedTerm(proposal.term.name, proposal.term.title, proposal.cost)
        try:
            best = self.joined_roughly(self.best, proposal)
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
        if helps and (reason := strays(fit, self.best)):
            return False, trial._replace(reason=reason)
        return helps, trial._replace(
            reason=f"left-out parts are predicted {'better' if helps else 'no better'} (error {by})")

    def restart_terms(self) -> bool:
        """Try the alternatives of each term, and fit terms with a grid anew, after other terms that explain the same
        residual. Return whether a model became better.
        """
        names = frozenset(t.name for t in self.chosen)
        if self.white or names in self.restarts:
            return False
        self.restarts.add(names)
        better = [rescaled(self, 0.5), *(exchanged(self, t, 0.5) for t in list(self.chosen))]
        terms = [t for t in self.chosen if len(t.grid) > 1]
        better += [restarted(self, t) for t in terms if not self.needed(t) and self.has_time_for(4 + len(t.grid))]
        return any(better)

    def drop_terms(self) -> bool:
        """Drop all terms that the model does not need. Return whether there was one."""
        count = len(self.chosen)
        while self.drop_term():
            pass
        return len(self.chosen) < count

    def drop_term(self) -> bool:
        """Drop the term without which left-out parts are predicted best, if the model does not need it. Return whether
        a term was dropped.
        """
        last = [step.name for step in self.steps[-1:]]  # it has just been judged
        smaller = [s for t in self.chosen if not self.needed(t) and t.name not in last and not self.lengthens_by(t)
                   and not self.late and (s := self.without(t)) is not None]  # fmt: skip
        if not smaller:
            return False
        score, best, term = min(smaller, key=lambda s: s[0])
        self.chosen.remove(term)
        self.dropped.add(term.name)
        self.adopt(best, score)
        self.record(term.name, f"without {term.title}", "leaves")
        return True

    def without(self, term: Term) -> tuple[float, FittedModel, Term] | None:
        """Return criterion and fit of the model without a term; None if the model needs the term.

        A term is needed if left-out parts are predicted worse without it: by 3 % in the sum of squares or, if the
        recordings do not determine the term, by 10 %. A term whose loss, by linearisation, raises the cost beyond doubt
        is not fitted.
        """
        vague = self.vague(term, self.best.standard_errors)
        beyond = not vague and not term.replaces and cost_without(self.best, term) > (1 + 2 * MATERIAL) * self.best.cost
        if beyond:
            return None
        try:
            end = self.refitted(self.model(without=term), self.parameters_without(term))
        except PliantError:
            return None
        score = self.scored(end)
        self.keep(score, f"without {term.title}", end)
        return (score, end, term) if score < (1 + (MUCH if vague else MATERIAL)) * self.score else None

    def settle_parameters(self) -> bool:
        """Hold each undetermined time, angle or limit of a term at its value, and let every other undetermined
        parameter of a term rest on a prior: no effect, give or take the size that the fit shows. Return whether there
        was one. The source of each says so; the other parameters of the term are determined relative to it.
        """
        count = len(self.steps)
        while entry := self.unsettled():
            name, text, null = entry
            value = self.best.values[name]
            p = next(p for p in self.best.parameters if p.name == name)
            if null is None or value == null:
                p = replace(p, free=False, source=f"held: the recordings show only {text}")
                title = f"{name} held at {value:.3g}"
            else:
                p = replace(p, prior=null, prior_std=abs(value - null),
                            source=f"a prior: the recordings show only {text}")  # fmt: skip
                title = f"{name} rests on a prior of {null:.3g} +- {abs(value - null):.3g}"
            named = [p if other.name == name else other for other in self.best.parameters]
            self.best = self.best.known_as(self.setting.problem(self.model(), named))
            self.score = self.scored(self.best)
            self.record(name, title, "settles")
        return len(self.steps) > count

    def unsettled(self) -> tuple[str, str, float | None] | None:
        """Return the name of a parameter of a term that neither the recordings nor a prior determine, what they show of
        it as text, and its value without effect; None for that of a time, an angle or a limit, which come first. None
        if all are determined.
        """
        vague = [(name, text, term.null.get(name)) for term in self.chosen
                 for name, text in self.vague(term, self.best.doubts).items()]  # fmt: skip
        upper = {p.name: p.upper for p in self.best.problem.free}
        vague += [(name, "that it is as long as they are, or longer", None) for term in self.chosen
                  for name in term.limits if self.best.values[name] >= (1.0 - 1e-6) * upper.get(name, np.inf)]
        return min(vague, key=lambda entry: entry[2] is not None, default=None)

    def final_fit(self) -> FitResult:
        """Return the chosen model, fitted until it converges, with every parameter of its terms determined, held or on
        a prior.
        """
        self.settle_parameters()
        result = self.last_fit()
        while self.settle_parameters():
            result = self.last_fit()
        return result

    def last_fit(self) -> FitResult:
        """Return the best model, fitted until it converges."""
        problem, began = with_checked_step(self.best, self.setting), clock.perf_counter()
        x = self.best.x
        for _ in range(2 if problem.learns else 0):
            x = solve(problem, x, self.setting.loss, self.affordable(LAST_EVALUATIONS, last=True),
                      tolerance=TOLERANCE, deadline=self.deadline).x  # fmt: skip
            problem.learn_sizes(x)
        evaluations = self.affordable(LAST_EVALUATIONS, last=True)
        best = solve(problem, x, self.setting.loss, evaluations, deadline=self.deadline)
        self.setting = replace(self.setting, time_step=problem.time_step)
        self.best = FittedModel(problem, best.x, problem.data_residual(best.x), problem.data_jacobian(best.x))
        late = best.status == 0 and (evaluations < LAST_EVALUATIONS or clock.monotonic() > self.deadline)
        failure = "stopped at the time limit before it converged: raise minutes" if late else ""
        return finished(problem, best, self.setting.loss, None, clock.perf_counter() - began, failure)

    def reason(self, stop: str) -> str:
        """Return a sentence on the model that was chosen, why the search ended, and what the model needs although the
        recordings do not determine it.
        """
        names = ", ".join(t.title for t in self.chosen) or "no further term"
        first, last = self.steps[0], self.steps[-1].left_out_percent
        without = f" ({first.left_out_percent:.3g} % without these terms)" if first.title == FIRST else ""
        there = {p.name for p in self.best.parameters}
        if settled := [step.title for step in self.steps if step.change == "settles" and step.name in there]:
            stop += f"; not determined, but needed: {', '.join(settled)}"
        return (f"{names}: left-out parts of the training recordings are predicted with {last:.3g} % of the peak "
                f"displacement{without}; {stop}")
