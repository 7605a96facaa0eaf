"""Registry of estimators: the built-in ones, and those of other packages (entry points ``pliant.estimators``)."""

from __future__ import annotations

from pliant.estimation.contract import EstimatorKind
from pliant.plugins import chosen, offered

GROUP = "pliant.estimators"
BUILT_IN = {
    "observer": "pliant.estimation.adaptive_observer:ESTIMATOR",
    "filter": "pliant.estimation.kalman:ESTIMATOR",
    "differences": "pliant.estimation.differences:ESTIMATOR",
}


def estimators() -> dict[str, EstimatorKind]:
    """Return all known kinds of estimators by name."""
    return offered(GROUP, BUILT_IN, EstimatorKind)


def estimator_kind(name: str) -> EstimatorKind:
    """Return the kind of estimator called `name`; raise InputError with the known names otherwise."""
    return chosen(GROUP, BUILT_IN, EstimatorKind, name)
