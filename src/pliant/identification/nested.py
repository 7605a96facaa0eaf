"""Fits nested in larger ones: start values from the smaller fit's optimum, and a check that the larger fit is no worse.

A fit contains another if it frees all that the other frees and more, on the same recordings. At the smaller fit's
optimum, with each added term at the value at which it has no effect, the larger fit's cost is that of the smaller one.
A search from there cannot end above it; one that does has not found the optimum.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from pliant.identification.parameters import Parameter, shared_name
from pliant.identification.problem import Problem
from pliant.identification.result import FitResult
from pliant.model import Model

Array = np.ndarray
SWEEPS = 2  # over the added parameters
OFF_BOUND = 0.01  # in scales: distance of a start from a bound
ABOVE = 1e-3  # of the smaller fit's cost: excess that counts


def contains(larger: Sequence[Parameter], smaller: Sequence[Parameter]) -> bool:
    """Return whether a fit with the parameters `larger` frees all that one with the parameters `smaller` frees, and
    more. One value for each joint contains one for all joints.
    """
    more, less = ({p.name for p in listed if p.free} for listed in (larger, smaller))
    known = {p.name: p for p in larger}
    if not less < more | {common_name(name) for name in more} or more == less:
        return False
    return all(
        p.name in known and (known[p.name].free or known[p.name].value == p.value) for p in smaller if not p.free
    )


def common_name(name: str) -> str:
    """Return the name of the parameter for all joints, of one joint's parameter such as ``stiffness_2`` or of
    ``stiffness_*``.
    """
    return shared_name(name.removesuffix("_*"))


def parents(fits: Mapping[str, Sequence[Parameter]], same: Callable[[str, str], bool]) -> dict[str, tuple[str, ...]]:
    """Return for each fit the names of the largest fits that it contains, of those that free a parameter.

    Parameters
    ----------
    fits : mapping
        Parameters of each fit by its name.
    same : callable
        Whether two fits have the same recordings, model and weights.
    """
    begun = [name for name, parameters in fits.items() if any(p.free for p in parameters)]
    inside = {
        name: [other for other in begun if other != name and same(name, other) and contains(fits[name], fits[other])]
        for name in fits
    }
    return {
        name: tuple(o for o in smaller if not any(o in inside[other] for other in smaller))
        for name, smaller in inside.items()
    }


def warm_start(problem: Problem, smaller: FitResult) -> Array | None:
    """Return the scaled parameters (P,) of a fit at the optimum of a smaller one that it contains; None if the model
    cannot be simulated there.

    An added position or angle has its value in the smaller fit's model. Another added parameter is 0, where most terms
    have no effect, or has its start value, whichever costs less.
    """
    ended = {**stated_values(smaller.model), **smaller.values}
    fitted = [next((ended[n] for n in (p.name, common_name(p.name)) if n in ended), None) for p in problem.free]
    added = [k for k, value in enumerate(fitted) if value is None]
    values = problem.start * problem.scale
    x = np.array([k if v is None else v for v, k in zip(fitted, values, strict=True)]) / problem.scale
    lower, upper = problem.bounds
    absent = [k for k in added if lower[k] <= 0.0 <= upper[k]]
    best = np.clip(np.where(np.isin(np.arange(x.size), absent), 0.0, x), lower, upper)
    cost = problem.cost(best)
    for k in absent * SWEEPS:
        other = best.copy()
        other[k] = x[k] if best[k] == 0.0 else 0.0
        if (changed := problem.cost(other)) < cost:
            best, cost = other, changed
    return best if np.isfinite(cost) else None


def stated_values(model: Model) -> dict[str, float]:
    """Return the values (SI) of a model that are parameters of a fit under the same meaning, by parameter name."""
    axes = ("along", "across", "aside")
    points = {f"{p.name}.{axis}": float(getattr(p, axis)) for p in model.points for axis in axes}
    return {**points, "base_angle": model.base_angle, "mass": float(model.link_mass.sum()), "tip_mass": model.tip_mass}


def inside(problem: Problem, x: Array) -> Array:
    """Return the scaled parameters x (P,) moved off their bounds: a search that starts on a bound hardly moves."""
    lower, upper = problem.bounds
    margin = np.minimum(OFF_BOUND, 0.1 * (upper - lower))
    return np.clip(x, lower + margin, upper - margin)


def excess_phrase(excess: Mapping[str, float]) -> str:
    """Return a phrase on the smaller fits above whose cost a fit ends, from its excess as a fraction of their cost, by
    their names; '' if there is none.
    """
    worse = [f"{100 * part:.2g} % above that of the fit {name}" for name, part in excess.items() if part > ABOVE]
    if not worse:
        return ""
    return (f"did not converge: its cost is {' and '.join(worse)}, which frees fewer parameters; give start values, or "
            "more starts")  # fmt: skip
