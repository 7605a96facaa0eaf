"""The default time step of fits and predictions, from the modes of the model at its starting parameter values."""

from __future__ import annotations

from collections.abc import Mapping

from pliant.identification.parameters import apply
from pliant.model import Model
from pliant.simulation.time_step import rings, shared_step

LONGEST = 2e-3  # s
LONGEST_OVER_DAMPED = 1e-2  # s


def fit_step(model: Model, values: Mapping[str, float]) -> float:
    """Return the longest time step [s] that resolves the modes of a model with the parameter `values` (SI): at most 2
    ms, or 10 ms if no mode that noticeably moves the tip rings. Parameters that no model has, such as those of a
    recording, have no effect.
    """
    applied = apply(model, values)
    return shared_step([applied], LONGEST if rings(applied) else LONGEST_OVER_DAMPED)
