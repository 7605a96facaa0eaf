"""The default time step of fits and predictions, from the modes of the model at its starting parameter values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pliant.identification.experiment import Experiment
from pliant.identification.parameters import apply
from pliant.model import Model
from pliant.simulation.time_step import rings, shared_step

LONGEST = 2e-3  # s
LONGEST_OVER_DAMPED = 1e-2  # s
LONGEST_SLOW = 5e-2  # s
STEPS_A_FRAME = 4
SLOW = 0.1  # s between frames


def fit_step(model: Model, values: Mapping[str, float], experiments: Sequence[Experiment] = ()) -> float:
    """Return the longest time step [s] that resolves the modes of a model with the parameter `values` (SI): at most 2
    ms or, if no mode that noticeably moves the tip rings, 10 ms; in that case a quarter of the time between frames and
    at most 50 ms, if the frames of all `experiments` are 0.1 s apart or more (the median of their times). Parameters
    that no model has, such as those of a recording, have no effect.
    """
    applied = apply(model, values)
    apart = [float(np.median(np.diff(e.time))) for e in experiments if e.time.size > 1] or [0.0]
    slow = min(np.median(apart) / STEPS_A_FRAME, LONGEST_SLOW) if min(apart) >= SLOW else LONGEST_OVER_DAMPED
    return shared_step([applied], LONGEST if rings(applied) else slow)
