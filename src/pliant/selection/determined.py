"""The rule of determinacy: a term whose value the recordings do not show has no place in a model without a prior."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pliant.errors import PliantError
from pliant.identification.experiment import Experiment
from pliant.identification.result import FitResult
from pliant.model import Model
from pliant.selection.fitted import FittedModel
from pliant.selection.terms import Term, terms_for

DETERMINED = 0.5  # standard error over value above which a parameter is not determined: its 95 % interval holds zero


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
