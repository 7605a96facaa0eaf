"""Fits of chosen terms that begin anew: what joined after a term may have been meant by it, or the other way round.

Terms join one after another, each from the optimum of its parent. A term may take over the effect of one that is not in
the model yet, such as creep that of a lag of the valve, and no step of a fit leads back.
"""

from __future__ import annotations

from contextlib import suppress

from pliant.errors import PliantError
from pliant.selection.criterion import MATERIAL, at_bounds
from pliant.selection.fitted import FittedModel
from pliant.selection.state import SearchState
from pliant.selection.terms import Term


def restarted(search: SearchState, term: Term) -> bool:
    """Adopt the best model in which one of the chosen terms begins anew, from each row of its grid, alone or after one
    more term, if left-out parts are then predicted better by 3 %. Return whether there is one.
    """
    try:
        parent = rough_parent(search, term)
    except PliantError:
        return False
    begun: list[tuple[FittedModel, tuple[Term, ...]]] = [(parent, ())]
    begun += [(fit, (more,)) for fit, more in first_choice(search, parent, term)]
    ends = [(end, more) for fit, more in begun for end in from_each_row(search, fit, term, *more)]
    if not ends:
        return False
    end, more = min(ends, key=lambda e: search.scored(e[0]))
    try:
        end = end if search.late else search.converged(end, end.problem.size)
    except PliantError:
        return False
    score = search.scored(end)
    if score > (1 - MATERIAL) * search.score or (not more and end.cost > (1 - MATERIAL) * search.best.cost):
        return False
    search.chosen.extend(more)
    search.adopt(end, score)
    title = " and ".join([*(f"{t.title}," for t in more), f"{term.title} begun anew"])
    search.record(more[0].name if more else f"~{term.name}", title)
    return True


def rough_parent(search: SearchState, term: Term) -> FittedModel:
    """Return the rough fit of the best model without a term: from the present values or, where it is better, from those
    of the other parameters in the first model.
    """
    others, first = search.parameters_without(term), search.first.values
    again = [p if p.name not in first else p.with_(value=first[p.name]) for p in others]
    fits = [search.refitted(search.model(), start, roughly=True) for start in (others, again)]
    return min(fits, key=lambda fit: fit.cost)


def first_choice(search: SearchState, parent: FittedModel, term: Term) -> list[tuple[FittedModel, Term]]:
    """Return the rough fit of a parent without `term` with the term that its screen ranks first, and this term; empty
    if there is none that can be fitted.
    """
    chosen = [t for t in search.chosen if t is not term]
    proposals = search.ranked(parent, chosen)[0]
    for p in (p for p in proposals if p.term.name != term.name and not p.term.extension):
        gone = {*p.term.replaces, *(a.name for a in p.term.adds)}
        others, model = [a for a in parent.parameters if a.name not in gone], search.model(p.term)
        try:
            starts = [[*others, *p.term.begun(p.row, values)] for values in p.starts()]
            start = search.setting.cheapest(model, starts, search.best.problem.size)
            return [(search.refitted(model, start, roughly=True), p.term)]
        except PliantError:
            return []
    return []


def from_each_row(search: SearchState, parent: FittedModel, term: Term, *more: Term) -> list[FittedModel]:
    """Return the rough fits of a parent, which has the terms `more`, with a term from each row of its grid, inside the
    bounds of the term. A screen finds the best row of a law that acts nonlinearly, such as friction, not always.
    """
    fits, model = [], search.model(*more, term)
    for row in term.grid:
        with suppress(PliantError):
            if not search.late:
                fits.append(search.refitted(model, [*parent.parameters, *term.begun(row, {})], roughly=True))
    return [fit for fit in fits if not at_bounds(fit, term)]
