"""Error of a simulated tip position, estimated by repeating the simulation with a different time step.

A second-order rule with the step 2h has four times the error of the step h, so that the difference of the two is three
times the error of h (Richardson; Hairer, Norsett and Wanner I, Sec. II.4). If this difference is small, the simulation
is accepted. Otherwise it is also repeated with h/2. Where the two differences are not in the ratio of 4, the steps are
too long for this law, and the larger of two estimates is used.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pliant.errors import SimulationError

Array = np.ndarray
LIMIT = 0.01  # of the length: a larger error of the tip is reported
CLEARED = 0.3 * LIMIT  # of the length: a smaller difference to the motion with twice the step is accepted
ORDERS = (3.0, 4.0)  # bounds of the ratio of the two differences
MARGIN = 1.1
Again = Callable[[float], tuple[Array, Array]]


class AccuracyWarning(UserWarning):
    """Warning that the time step of a simulation is too long for the motion."""


def tip_error(again: Again) -> float:
    """Return an upper estimate of the largest error of a simulated tip position, as a fraction of the body's length.

    Parameters
    ----------
    again : callable
        ``again(factor)`` repeats the motion with `factor` times its step, 2 or 1/2, and returns positions (T, ..., d)
        of the motion and of its repetition at equal times, over the length of the body. It may raise SimulationError.
    """
    coarse = difference(again, 2.0)
    if 0.0 < coarse <= CLEARED:  # a difference of 0 may mean that both had the same steps
        return coarse
    fine = difference(again, 0.5)
    if not (np.isfinite(coarse) and fine > 0.0):
        return MARGIN * 4.0 / 3.0 * fine
    ratio = float(np.clip(coarse / fine, *ORDERS))
    by_half, by_both = fine * ratio / (ratio - 1.0), np.sqrt(coarse / 3.0 * fine * 4.0 / 3.0)
    return MARGIN * float(max(by_half, by_both))


def difference(again: Again, factor: float) -> float:
    """Return the largest distance between the tip positions of a motion and of its repetition with other time steps, as
    a fraction of the body's length. It is infinite if the repetition fails.
    """
    try:
        return distance(*again(factor))
    except SimulationError:
        return np.inf


def distance(one: Array, other: Array) -> float:
    """Return the largest distance between corresponding points of two arrays of positions, whose last axis holds the
    components.
    """
    return float(np.sqrt(np.sum((one - other) ** 2, axis=-1).max(initial=0.0)))


def step_for(error: float) -> float:
    """Return the factor, 0.1 to 0.7, by which to shorten a time step so that the tip error falls to half the limit of 1
    % of the body's length. `error` is the present one, as a fraction of the length.
    """
    return float(np.clip(np.sqrt(0.5 * LIMIT / error), 0.1, 0.7))
