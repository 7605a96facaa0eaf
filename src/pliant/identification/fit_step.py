"""The default time step of fits and predictions, from the modes of the model at its starting parameter values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress

from pliant.errors import PliantError
from pliant.identification.experiment import Experiment
from pliant.identification.initial_guess import prepare
from pliant.identification.parameters import Parameter, apply, values_of
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


def starting_step(experiments: Sequence[Experiment], model: Model, parameters: Sequence[Parameter | str]) -> float:
    """Return the `fit_step` [s] of a fit's starting model. It is 2 ms if the start values cannot be estimated."""
    with suppress(PliantError):
        model, filled = prepare(experiments, model, parameters)
        return fit_step(model, values_of(filled))
    return LONGEST
