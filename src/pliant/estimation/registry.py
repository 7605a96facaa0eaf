"""Which estimators there are: the built-in ones, and those of other packages (entry points ``pliant.estimators``)."""

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
    """All known estimators by name."""
    return offered(GROUP, BUILT_IN, EstimatorKind)


def estimator_kind(name: str) -> EstimatorKind:
    """The estimator of a name; InputError names the known ones."""
    return chosen(GROUP, BUILT_IN, EstimatorKind, name)
