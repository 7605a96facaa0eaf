"""Screens: what a term would lower the cost by, from one Jacobian at the parent's optimum, without a fit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pliant.errors import PliantError, SimulationError
from pliant.identification.parameters import Parameter
from pliant.model import Model
from pliant.selection.fitted import FitSetting, FittedModel
from pliant.selection.terms import Term

Array = np.ndarray
LEAST_STEP = 1e-6  # of the largest singular value: directions below do not move in a proposal
LEAST_PART = 0.1  # of its effect that a law without derivative must have to be tried
FARTHEST = 3.0  # factor by which a proposal changes a positive parameter at most


class TermProposal(NamedTuple):
    """A term with the cost that a screen predicts, and the values (SI) that its parameters would take."""

    term: Term
    row: Mapping[str, float]  # of the term's grid
    cost: float
    null: Mapping[str, float]  # values without effect
    values: Mapping[str, float]  # proposed values, within the parameters' bounds
    sense: bool  # whether the optimum lies inside the bounds, as seen from the null values

    def starts(self) -> list[Mapping[str, float]]:
        """Return the start values (SI) of a refit: as proposed, and almost without effect."""
        almost = {name: 0.9 * value + 0.1 * self.values[name] for name, value in self.null.items()}
        return [self.values, almost]


class TermRefusal(NamedTuple):
    """A term that cannot be screened, with the reason."""

    term: Term
    reason: str


def screened(
    parent: FittedModel, model: Model, terms: Iterable[Term], setting: FitSetting,
) -> tuple[list[TermProposal], list[TermRefusal]]:
    """Return what each term would lower the cost of `parent` by, the best row of its grid first, and the terms that
    cannot be screened. `model` is that of the parent without the values of any term.

    The cost is that of the linear problem with the parent's parameters free (Rao's efficient score): the part of the
    residual that the term's derivatives explain beyond those of the parent.
    """
    proposals, refusals = [], []
    every = list(terms)
    for panel in panels(t for t in every if t.null):
        try:
            proposals += screened_together(parent, model, panel, setting)
        except PliantError:  # find out which one
            for pair in panel:
                try:
                    proposals += screened_together(parent, model, [pair], setting)
                except PliantError as error:
                    refusals.append(TermRefusal(pair[0], str(error)))
    for term, row in ((t, row) for t in every if not t.null for row in t.grid):
        try:
            proposals.append(tried_out(parent, model, term, row, setting))
        except PliantError as error:
            refusals.append(TermRefusal(term, str(error)))
    return sorted(proposals, key=lambda p: p.cost), refusals


def panels(terms: Iterable[Term]) -> list[list[tuple[Term, Mapping[str, float]]]]:
    """Return the terms, with each row of their grids, in groups that one model can hold at their null values."""
    groups: list[list[tuple[Term, Mapping[str, float]]]] = []
    for term in terms:
        for row in term.grid:
            for group in groups:
                if all(fit_together(term, other) for other, _ in group):
                    group.append((term, row))
                    break
            else:
                groups.append([(term, row)])
    return groups


def fit_together(one: Term, other: Term) -> bool:
    """Return whether one model can hold both terms at their null values."""
    names = {p.name for p in one.adds} & {p.name for p in other.adds}
    return not names and one.extension == other.extension and not (one.replaces and other.replaces)


def screened_together(
    parent: FittedModel, model: Model, panel: Sequence[tuple[Term, Mapping[str, float]]], setting: FitSetting,
) -> list[TermProposal]:
    """Return the proposals of terms that one model can hold at their null values, from one Jacobian."""
    values = parent.values
    added = [p.with_(shrink=0.0) for term, row in panel for p in term.at_null(row, values)]
    problem = setting.problem(panel[0][0].model(model), [*held_parent(parent, added), *added])
    columns = problem.data_jacobian(problem.start)
    place = {p.name: k for k, p in enumerate(problem.free)}
    proposals = []
    for term, row in panel:
        mine = [place[p.name] for p in term.adds if p.name in place]
        scale = problem.scale[mine]
        cost, moves = explained(parent, term.replaces, columns[:, mine])
        at_null = {problem.free[k].name: float(problem.start[k] * problem.scale[k]) for k in mine}
        target = dict(zip(at_null, (np.array(list(at_null.values())) + moves * scale).tolist(), strict=True))
        parameters = {p.name: p for p in term.adds}
        part = min((within(parameters[n], at_null[n], target[n]) for n in at_null), default=1.0)
        reached = {n: at_null[n] + part * (target[n] - at_null[n]) for n in at_null}
        proposals.append(TermProposal(term, row, cost, at_null, reached, part > LEAST_STEP))
    return proposals


def held_parent(parent: FittedModel, added: Iterable[Parameter]) -> list[Parameter]:
    """Return the parameters of the parent, held at their values, without those that are `added` to them."""
    names = {p.name for p in added}
    return [p.with_(free=False, prior=None, prior_std=None, shrink=0.0) for p in parent.parameters
            if p.name not in names]


def tried_out(
    parent: FittedModel, model: Model, term: Term, row: Mapping[str, float], setting: FitSetting,
) -> TermProposal:
    """Return the proposal of a term that has no derivative where it has no effect, from one simulation: its effect at
    one row of its grid counts as the column of a parameter between 0 and 1.
    """
    mine = [p.with_(free=False) for p in term.begun(row, {})]
    problem = setting.problem(term.model(model), [*held_parent(parent, mine), *mine])
    moved = problem.data_residual(problem.start)
    if problem.broken:
        raise SimulationError(problem.broken)
    cost, (part,) = explained(parent, term.replaces, (moved - parent.residual)[:, None])
    return TermProposal(term, row, cost, dict(row), dict(row), bool(part > LEAST_PART))


def explained(parent: FittedModel, replaced: Sequence[str], columns: Array) -> tuple[float, Array]:
    """Return the cost that is left when k further columns (N, k) of derivatives join those of the parent's parameters,
    of which `replaced` are left out, and the changes (k,) of the further parameters.
    """
    keep = [k for k, name in enumerate(parent.free) if name not in replaced]
    basis = np.linalg.qr(parent.jacobian[:, keep])[0]
    residual = parent.residual - basis @ (basis.T @ parent.residual)
    rest = columns - basis @ (basis.T @ columns)
    length = np.linalg.norm(rest, axis=0)
    length[length == 0] = 1.0
    moves = np.linalg.lstsq(rest / length, -residual, rcond=LEAST_STEP)[0]
    left = residual + rest @ (moves / length)
    return 0.5 * float(left @ left), moves / length


def within(p: Parameter, begin: float, end: float) -> float:
    """Return the fraction of the way from `begin` to `end` that stays within a parameter's bounds and, for a positive
    one, within a factor of `FARTHEST`.
    """
    lower, upper = p.lower, p.upper
    if p.lower > 0 and begin > 0:
        lower, upper = max(lower, begin / FARTHEST), min(upper, begin * FARTHEST)
    if end < lower:
        return max((lower - begin) / (end - begin), 0.0)
    return max((upper - begin) / (end - begin), 0.0) if end > upper else 1.0
