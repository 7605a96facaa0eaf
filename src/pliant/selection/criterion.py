"""What decides whether a term joins: the error of each part of the training recordings as predicted from the other
parts, and whether the recordings determine its value. An undetermined one has no place in a model without a prior.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pliant.errors import PliantError
from pliant.identification.experiment import Experiment
from pliant.identification.problem import Problem
from pliant.identification.residuals import correlated_frames
from pliant.identification.result import FitResult
from pliant.model import Model
from pliant.selection.fitted import FARTHER, FittedModel, Linearised
from pliant.selection.terms import Term, terms_for
from pliant.shapes import Float

Array = np.ndarray
RECORDINGS = 4  # from this number on, whole recordings are left out, else blocks of each
MOST_BLOCKS, FEWEST_BLOCKS = 8, 4  # of each recording
CORRELATION_TIMES = 3.0  # length of a block at least, in correlation times of the residual
MATERIAL = 0.03  # of the criterion: a smaller gain does not earn a term its place
STIFFEST = 1e-10  # relative eigenvalue below which what is left of a block does not move
# by which a polynomial of fourth degree, one above the laws of the search, grows at most beyond a symmetrical range
# (Chebyshev); walls that give way as measured ones do reach 18, friction that hardly slips 43 and more
MOST_GROWTH = 8.0 * FARTHER**4 - 8.0 * FARTHER**2 + 1.0
DETERMINED = 0.5  # standard error over value above which a parameter is not determined: its 95 % interval holds zero


class Parts(NamedTuple):
    """Parts of N residuals that are left out one after another.

    Attributes
    ----------
    groups : array (N,)
        Number of the part of each residual.
    whole : bool
        Whether each part is a whole recording.
    """

    groups: Array
    whole: bool


def parts_of(fit: FittedModel) -> Parts:
    """Return the parts of the residuals of a fit.

    They are whole recordings if there are at least `RECORDINGS`, unless one begins where the body was left: its level
    comes from what happened before, and no other recording shows that. Otherwise they are blocks of each recording, at
    most eight and at least four, as long as three correlation times of the residual where the recording allows.
    """
    problem = fit.problem
    alike = all(o.exp.start.from_rest or o.exp.poses for o in problem.observed)
    if len(problem.observed) >= RECORDINGS and alike:
        counts = [o.count for o in problem.observed]
        return Parts(np.repeat(np.arange(len(counts)), counts), whole=True)
    groups, first = [], 0
    for o, part in problem.parted(fit.residual):
        frames = np.unique(o.rows).size
        blocks = int(np.clip(frames / (CORRELATION_TIMES * correlated_frames(o, part)), FEWEST_BLOCKS, MOST_BLOCKS))
        edges = np.linspace(o.exp.time[0], o.exp.time[-1], blocks + 1)[1:-1]
        groups.append(first + np.searchsorted(edges, o.exp.time[o.rows]))
        first += blocks
    return Parts(np.concatenate(groups), whole=False)


def left_out(linear: Linearised, groups: Float[Array, " N"], noise: float) -> Float[Array, " N"]:
    """Return the residuals (N,) of each group as predicted by the parameters that fit the other groups best.

    The optimum without a group follows from one linear step: d = (H - J_k^T J_k)^-1 J_k^T r_k for the residuals r_k and
    derivatives J_k of the group, with H of all recordings and priors (the infinitesimal jackknife: Giordano et al.,
    AISTATS 2019; exact for a linear model). The step is held by a weak prior, whose standard deviation is the typical
    size of each parameter: along combinations that the rest does not determine, a linear step would go astray. `noise`
    is the variance of the residuals (see `noise_of`).
    """
    r = linear.residual
    H = linear.information + noise * np.eye(linear.jacobian.shape[1])  # parameters are in units of their typical size
    size = np.sqrt(np.maximum(np.diag(H), 1e-300))
    predicted = r.copy()
    for group in np.unique(groups):
        mine = groups == group
        J = linear.jacobian[mine] / size
        rest = H / np.outer(size, size) - J.T @ J
        moves = np.linalg.lstsq(rest, J.T @ r[mine], rcond=STIFFEST)[0]
        predicted[mine] += J @ moves
    return predicted


def noise_of(fit: FittedModel) -> float:
    """Return the variance of the residuals of a fit per independent one."""
    return float(fit.residual @ fit.residual) / effective_numbers(fit.problem, fit.residual)


def criterion(problem: Problem, predicted: Float[Array, " N"], parts: Parts) -> float:
    """Return the sum of squares of the residuals (N,) of `parts` as predicted by `left_out`, the smaller the better.

    With whole recordings left out, it is the geometric mean of the recordings' sums: a recording far beyond the others,
    which no model predicts from them, does not outweigh the rest. It has no say as long as a body that stands still
    would predict it better: its sum is then no error that a term lowers, but how far a linear step leads astray.
    """
    sums = np.bincount(parts.groups, predicted**2)
    if not parts.whole:
        return float(sums.sum())
    most = np.array([o.motion for o in problem.observed])
    sums = np.minimum(sums, most) if (sums < most).any() else sums
    return float(np.exp(np.mean(np.log(np.maximum(sums, 1e-300)))))


def score_of(fit: FittedModel, parts: Parts) -> float:
    """Return the criterion of a fit, from the residuals of each part as predicted from the other parts."""
    return criterion(fit.problem, left_out(fit.linear, parts.groups, noise_of(fit)), parts)


def by_percent(score: float, other: float) -> str:
    """Return by what the error of left-out parts of a criterion `score` differs from that of another, as text."""
    return f"{100 * (np.sqrt(score / other) - 1):+.2g} %"


def effective_numbers(problem: Problem, residual: Array) -> float:
    """Return the effective number of independent residuals, of correlated ones (N,)."""
    return float(sum(part.size / correlated_frames(o, part) for o, part in problem.parted(residual)))


def undetermined(values: Mapping[str, float], errors: Mapping[str, float | None], term: Term) -> dict[str, str]:
    """Return the parameters of a term that the recordings do not determine, each with its value and error as text.

    The standard error is compared with the distance from the value without effect. Parameters of single joints, which
    shrink to their mean, and those with a prior rest on that.

    Parameters
    ----------
    values : mapping
        Fitted values (SI) by name.
    errors : mapping
        Standard errors (SI) of the free parameters by name; None for one that has no effect.
    """
    vague = {}
    for name in (p.name for p in term.adds if p.name in errors and not p.shrink and not p.prior_std):
        error, value = errors[name], values[name]
        if error is None:
            vague[name] = "no effect of it"
        elif error > DETERMINED * abs(value - term.null.get(name, 0.0)):
            vague[name] = f"{value:.3g} +- {error:.2g}"
    return vague


def undetermined_terms(result: FitResult, train: Sequence[Experiment], model: Model) -> dict[str, str]:
    """Return the parameters of all terms of a fit that the training recordings do not determine, each with its value
    and error as text. `model` is that from which the fit begins.
    """
    free = {p.name: p.std for p in result.parameters if p.free and not p.prior_std and not p.shrink}
    try:
        terms = terms_for(model, train)
    except PliantError:  # inputs that never move have no terms
        return {}
    return {n: text for t in terms for n, text in undetermined(result.values, free, t).items() if n in t.null}


def at_bounds(fit: FittedModel, term: Term) -> list[str]:
    """Return the free parameters of a term that end at a bound, unless it is the value without effect or an upper one
    that stands for all higher values.
    """
    values = fit.values
    return [p.name for p in fit.problem.free if p.name in {a.name for a in term.adds} and not p.shrink
            and values[p.name] in (p.lower, *(() if p.name in term.limits else (p.upper,)))
            and values[p.name] != term.null.get(p.name)]  # fmt: skip


def strays(fit: FittedModel, parent: FittedModel) -> str:
    """Return why a fit with other terms than its parent is not to be trusted beyond the inputs of the recordings; '' if
    nothing speaks against it.

    A law that the recordings show only in part may follow them and predict nonsense beyond: friction that hardly slips
    under any recorded input passes for stiffness, and slips under a higher one. Under higher inputs, the motions of fit
    and parent may differ more than under the recorded ones, but not by more than if the difference were a polynomial of
    fourth degree, or by more than the parent's residual. A model without a motion there, such as a wall that bursts, is
    not judged: it cannot predict nonsense.
    """
    usual, far = parent.residual_beyond, fit.residual_beyond
    if usual is None or far is None:
        return ""
    within, apart = (float(np.linalg.norm(r)) for r in (fit.residual - parent.residual, far - usual))
    if apart <= max(MOST_GROWTH * within, float(np.linalg.norm(parent.residual))):
        return ""
    return (f"under {FARTHER:g} times the inputs, it changes the motion {min(apart / max(within, 1e-300), 1e3):.0f} "
            "times as much as under these")  # fmt: skip


def cost_without(fit: FittedModel, term: Term) -> float:
    """Return the cost that the linearised model leaves with the parameters of a term at their null values."""
    names = {p.name for p in term.adds}
    mine = [k for k, name in enumerate(fit.free) if name in term.null]
    keep = [k for k, name in enumerate(fit.free) if name not in names]
    away = np.array([term.null[fit.free[k]] for k in mine]) / fit.problem.scale[mine] - fit.x[mine]
    residual, jacobian = fit.linear.whole
    moved = residual + jacobian[:, mine] @ away
    basis = np.linalg.qr(jacobian[:, keep])[0]
    left = moved - basis @ (basis.T @ moved)
    return 0.5 * float(left @ left)
