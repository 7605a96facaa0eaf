"""Fits of chosen terms that begin anew, after another term that explains the same residual.

Terms join one after another, each from the optimum of its parent. A term may take over the effect of one that is not in
the model yet, such as creep that of a lag of the valve, and no step of a fit leads back.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import suppress

from pliant.errors import InputError, PliantError
from pliant.identification.parameters import Parameter
from pliant.selection.criterion import DETERMINED, MATERIAL, at_bounds
from pliant.selection.first_model import on_scale, scale_of
from pliant.selection.fitted import FittedModel
from pliant.selection.running import RunningSearch
from pliant.selection.terms import LEVELS, Term, levels

SCALES = (0.1, 0.3, 3.0)  # factors on stiffness, damping and torques with which a fit begins anew


def restarted(search: RunningSearch, term: Term) -> bool:
    """Adopt the model in which another term takes the place of one that is chosen, whose effect it explains better, if
    left-out parts are then predicted better by 3 %. Return whether there is one.

    The term begins anew after the other one, from each row of its grid, or leaves the model.
    """
    parent = rough_parent(search, term)
    first = None if parent is None else first_choice(search, parent, term)
    if first is None:
        return False
    fit, other = first
    rows = [] if term.group and term.group == other.group else from_each_row(search, fit, term, other)
    ends = [(fit, False), *((end, True) for end in rows)]
    end, stays = min(ends, key=lambda e: search.scored(e[0]))
    return adopted(search, end, other, term, stays=stays)


def exchanged(search: RunningSearch, term: Term, share: float) -> bool:
    """Adopt the model in which an alternative of a chosen term, of the same group, takes its place, if left-out parts
    are then predicted better by 3 %, and the trials take less than a `share` of the time left. Return whether there is
    one.

    The screen of a law that acts nonlinearly, such as a hyperelastic wall, promises too little, and once another one
    has joined it is not tried again. Two levels do not show which law holds between them: then the screen decides.
    """
    if not term.group or search.needed(term) or levels(search.setting.experiments) < LEVELS:
        return False
    names = {n for t in search.chosen for n in (t.name, *t.includes)}
    others = [t for t in search.terms if t.group == term.group and t is not term and t.name not in search.dropped
              and (not t.needs or t.needs in names)]  # fmt: skip
    if not search.has_time_for(sum(len(t.grid) for t in others), share):
        return False
    kept, ends = search.parameters_without(term), list[tuple[FittedModel, Term]]()
    for other in others:
        fits = search.rough_fits(search.model(other), [[*kept, *other.begun(row, {})] for row in other.grid])
        ends += [(end, other) for end in fits if not at_bounds(end, other)]
    best = min(ends, key=lambda e: search.scored(e[0]), default=None)
    return best is not None and adopted(search, *best, term, stays=False)


def rescaled(search: RunningSearch, share: float) -> bool:
    """Free a held stiffness, begun softer or stiffer with damping and torques in the same ratio, if left-out parts are
    then predicted better by 3 %, the recordings determine it, and the trials take less than a `share` of the time left.
    Return whether it is free now.

    A first model that lacks the law of the torque may end over-damped, and no step of a fit leads from there to a
    stiffness at which the body rings.
    """
    scale, best = scale_of(search.best.parameters, search.stated), search.best
    if not scale or "stiffness" in search.dropped or not search.has_time_for(len(SCALES), share):
        return False
    starts = list[list[Parameter]]()
    for factor in SCALES:
        with suppress(InputError):  # beyond the bounds of a parameter
            starts.append([begun_at(p, factor, search.stated) for p in best.parameters])
    fits = search.rough_fits(search.model(), starts)
    try:
        end = min(fits, key=search.scored, default=best)
        end = end if search.late else search.converged(end, end.problem.size)
    except PliantError:
        return False
    error, score = end.standard_errors.get("stiffness"), search.scored(end)
    if error is None or error > DETERMINED * end.values["stiffness"] or score > (1 - MATERIAL) * search.score:
        return False
    search.chosen = [*search.chosen, *scale]
    search.adopt(end, score)
    search.record("stiffness", "free stiffness, begun softer or stiffer")
    return True


def begun_at(p: Parameter, factor: float, stated: Collection[str]) -> Parameter:
    """Return a parameter at a multiple of its value if it scales with the stiffness, and with the stiffness free. One
    that the study states and holds stays.
    """
    if p.name == "stiffness":
        return p.with_(value=factor * (p.value or 0.0), free=True, source="given")
    if not p.value or not on_scale(p) or (p.name in stated and not p.free):
        return p
    return p.with_(value=factor * p.value)


def adopted(search: RunningSearch, end: FittedModel, other: Term, term: Term, *, stays: bool) -> bool:
    """Adopt a rough fit in which the term `other` joined and a chosen one begins anew or, unless it `stays`, leaves, if
    it predicts left-out parts better by 3 % when it has converged. Return whether it does.
    """
    try:
        end = end if search.late else search.converged(end, end.problem.size)
    except PliantError:
        return False
    score = search.scored(end)
    if score > (1 - MATERIAL) * search.score or at_bounds(end, other):
        return False
    if search.taken(end, score, [*(t for t in search.chosen if stays or t is not term), other]):
        return False
    search.record(other.name, f"{other.title}, {term.title} {'begun anew' if stays else 'left out'}")
    return True


def rough_parent(search: RunningSearch, term: Term) -> FittedModel | None:
    """Return the rough fit of the best model without a term: from the present values or, where it is better, from those
    of the other parameters in the first model. None if it cannot be simulated.
    """
    others, first = search.parameters_without(term), {p.name: p.value for p in search.first}
    from_first = [p if p.name not in first else p.with_(value=first[p.name]) for p in others]
    start = search.setting.cheapest(search.model(), (others, from_first), search.best.problem.size)
    return next(iter(search.rough_fits(search.model(), [start])), None)


def first_choice(search: RunningSearch, parent: FittedModel, term: Term) -> tuple[FittedModel, Term] | None:
    """Return what a parent without `term` would take in its place: the rough fit with the term that its screen ranks
    first, and this term; None if that is `term` itself, or cannot be fitted.
    """
    chosen = [t for t in search.chosen if t is not term]
    best = next((p for p in search.ranked(parent, chosen)[0] if not p.term.segments), None)
    if best is None or best.term is term:
        return None
    try:
        return search.joined_roughly(parent, best), best.term
    except PliantError:
        return None


def from_each_row(
    search: RunningSearch, parent: FittedModel, term: Term, *more: Term, without: Mapping[str, float] | None = None,
) -> list[FittedModel]:
    """Return the rough fits of a parent, which has the terms `more`, with a term from each row of its grid but the one
    `without`, inside the bounds of the term. A screen does not always find the best row of a law that acts
    nonlinearly, such as friction.
    """
    starts = [[*parent.parameters, *term.begun(row, {})] for row in term.grid if row != without]
    return [fit for fit in search.rough_fits(search.model(*more, term), starts) if not at_bounds(fit, term)]
