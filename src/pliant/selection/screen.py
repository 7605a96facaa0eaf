"""Screens: what a term would lower the cost by, from one Jacobian at the parent's optimum, without a fit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pliant.errors import PliantError, SimulationError
from pliant.identification.parameters import Parameter
from pliant.model import Model
from pliant.selection.criterion import Parts, criterion, left_out, noise_of
from pliant.selection.fitted import FitSetting, FittedModel, Linearised
from pliant.selection.terms import Term

Array = np.ndarray
LEAST_STEP = 1e-6  # of the largest singular value: directions below do not move in a proposal
LEAST_PART = 0.1  # of its effect that a law without derivative must have to be tried
PARTS = (1.0, 0.3, 0.1, 0.02)  # of the way to a proposal, at which a refit may start
FARTHEST = 3.0  # factor by which a proposal changes a positive parameter at most


class TermProposal(NamedTuple):
    """A term with the cost that a screen predicts, and the values (SI) that its parameters would take."""

    term: Term
    row: Mapping[str, float]  # of the term's grid
    cost: float
    score: float  # the criterion, of the linear problem
    null: Mapping[str, float]  # values without effect
    values: Mapping[str, float]  # proposed values, within the parameters' bounds
    sense: bool  # whether the optimum lies inside the bounds, as seen from the null values

    def starts(self) -> list[dict[str, float]]:
        """Return possible start values (SI) of a refit: as proposed, and nearer to the values without effect."""
        return [{name: value + part * (self.values[name] - value) for name, value in self.null.items()}
                for part in PARTS]


class TermRefusal(NamedTuple):
    """A term that cannot be screened, with the reason."""

    term: Term
    reason: str


def screened(
    parent: FittedModel, model: Model, terms: Iterable[Term], setting: FitSetting, parts: Parts,
) -> tuple[list[TermProposal], list[TermRefusal]]:
    """Return what each term would lower the cost of `parent` by, the best row of its grid first by the criterion of
    `parts`, and the terms that cannot be screened. `model` is that of the parent without the values of any term.

    The cost is that of the linear problem with the parent's parameters free (Rao's efficient score): the part of the
    residual that the term's derivatives explain beyond those of the parent.
    """
    proposals, refusals = [], []
    every, noise = list(terms), noise_of(parent)
    for panel in panels(t for t in every if t.null):
        try:
            proposals += screened_together(parent, model, panel, setting, parts, noise)
        except PliantError:  # find out which one
            for pair in panel:
                try:
                    proposals += screened_together(parent, model, [pair], setting, parts, noise)
                except PliantError as error:
                    refusals.append(TermRefusal(pair[0], str(error)))
    for term, row in ((t, row) for t in every if not t.null for row in t.grid):
        try:
            proposals.append(tried_out(parent, model, term, row, setting, parts, noise))
        except PliantError as error:
            refusals.append(TermRefusal(term, str(error)))
    return sorted(proposals, key=lambda p: p.score), refusals


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
    (mine, theirs) = ({*t.replaces, *(p.name for p in t.adds)} for t in (one, other))
    return not mine & theirs and one.segments == other.segments


def screened_together(
    parent: FittedModel, model: Model, panel: Sequence[tuple[Term, Mapping[str, float]]], setting: FitSetting,
    parts: Parts, noise: float,
) -> list[TermProposal]:
    """Return the proposals of terms that one model can hold at their null values, from one Jacobian."""
    values = parent.values
    added = [p.with_(shrink=0.0) for term, row in panel for p in term.at_null(row, values)]
    problem = setting.problem(panel[0][0].model(model), [*held_parent(parent, added), *added])
    few = condensed(parent.linear, problem.data_jacobian(problem.start), parts)
    column = {p.name: k for k, p in enumerate(problem.free)}
    proposals = []
    for term, row in panel:
        mine = [column[p.name] for p in term.adds if p.name in column]
        scale = problem.scale[mine]
        linear, moves = joined(few.linear, replaced(parent, term), few.columns[:, mine])
        at_null = {problem.free[k].name: float(problem.start[k] * problem.scale[k]) for k in mine}
        target = dict(zip(at_null, (np.array(list(at_null.values())) + moves * scale).tolist(), strict=True))
        parameters = {p.name: p for p in term.adds}
        part = min((within(parameters[n], at_null[n], target[n]) for n in at_null), default=1.0)
        reached = {n: at_null[n] + part * (target[n] - at_null[n]) for n in at_null}
        score = criterion(parent.problem, left_out(linear, few.parts.groups, noise), few.parts)
        proposals.append(TermProposal(term, row, linear.cost, score, at_null, reached, part > LEAST_STEP))
    return proposals


def held_parent(parent: FittedModel, added: Iterable[Parameter]) -> list[Parameter]:
    """Return the parameters of the parent, held at their values, without those that are `added` to them."""
    names = {p.name for p in added}
    return [p.with_(free=False, prior=None, prior_std=None, shrink=0.0) for p in parent.parameters
            if p.name not in names]


def tried_out(
    parent: FittedModel, model: Model, term: Term, row: Mapping[str, float], setting: FitSetting, parts: Parts,
    noise: float,
) -> TermProposal:
    """Return the proposal of a term that has no derivative where it has no effect, from one simulation: its effect at
    one row of its grid counts as the column of a parameter between 0 and 1.
    """
    mine = [p.with_(free=False) for p in term.begun(row, {})]
    problem = setting.problem(term.model(model), [*held_parent(parent, mine), *mine])
    moved = problem.data_residual(problem.start)
    if problem.broken:
        raise SimulationError(problem.broken)
    few = condensed(parent.linear, (moved - parent.residual)[:, None], parts)
    linear, (part,) = joined(few.linear, replaced(parent, term), few.columns)
    score = criterion(parent.problem, left_out(linear, few.parts.groups, noise), few.parts)
    return TermProposal(term, row, linear.cost, score, dict(row), dict(row), bool(part > LEAST_PART))


class CondensedProblem(NamedTuple):
    """A linear problem and K further columns (M, K) in M rows, no more for each group than it has columns."""

    linear: Linearised
    columns: Array
    parts: Parts  # of the M rows


def condensed(linear: Linearised, columns: Array, parts: Parts) -> CondensedProblem:
    """Return the problem and K further columns of derivatives (N, K) with the rows of each part rotated into few.

    A rotation (QR decomposition) changes no sum over the rows of a part of products of two columns, and these are all
    that a screen needs.
    """
    whole = np.hstack([linear.jacobian, columns, linear.residual[:, None]])
    blocks = [np.linalg.qr(whole[parts.groups == group], mode="r") for group in np.unique(parts.groups)]
    rows, free = np.concatenate(blocks), linear.jacobian.shape[1]
    groups = np.repeat(np.unique(parts.groups), [len(block) for block in blocks])
    few = linear._replace(jacobian=rows[:, :free], residual=rows[:, -1])
    return CondensedProblem(few, rows[:, free:-1], parts._replace(groups=groups))


def replaced(parent: FittedModel, term: Term) -> list[int]:
    """Return the indices of the free parameters of the parent that a term replaces."""
    return [k for k, name in enumerate(parent.free) if name in term.replaces]


def joined(linear: Linearised, gone: Sequence[int], columns: Array) -> tuple[Linearised, Array]:
    """Return the linear problem at its optimum in which k further columns (N, k) of derivatives join those of the
    parent's parameters, of which those with the indices `gone` are left out, and the changes (k,) of the further
    parameters. The parent's priors are kept.
    """
    linear = linear.without(gone)
    priors = np.zeros((len(linear.prior_residual), columns.shape[1]))
    linear = linear._replace(jacobian=np.hstack([linear.jacobian, columns]),
                             prior_jacobian=np.hstack([linear.prior_jacobian, priors]))
    residual, jacobian = linear.whole
    length = np.linalg.norm(jacobian, axis=0)
    length[length == 0] = 1.0
    move = np.linalg.lstsq(jacobian / length, -residual, rcond=LEAST_STEP)[0] / length
    return linear.moved(move), move[len(move) - columns.shape[1] :]


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
