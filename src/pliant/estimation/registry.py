"""Registry of the state estimators: built-in ones, and those that other packages add (entry points
``pliant.estimators``).
"""

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
    """Return all known estimators by name, each with its constructor and properties."""
    return offered(GROUP, BUILT_IN, EstimatorKind)


def estimator_kind(name: str) -> EstimatorKind:
    """Return the registered estimator called `name`; raise InputError with the known names if there is none."""
    return chosen(GROUP, BUILT_IN, EstimatorKind, name)
