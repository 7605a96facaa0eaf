"""Error of a simulated tip, estimated by repeating the motion.

A rule of second order with the step 2h has four times the error of the step h, so that their difference is three times
the error of h (Richardson; Hairer, Norsett and Wanner I, Sec. II.4). A small difference clears a motion; otherwise it
is repeated with h/2 too. Where the two differences are not in the ratio of 4, the steps are too long for this law, and
the larger of two estimates counts. `benchmarks/energy.py` counts what this misses and what it reports in vain.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pliant.errors import SimulationError

Array = np.ndarray
LIMIT = 0.01  # of the length: a larger error of the tip is reported
CLEARED = 0.3 * LIMIT  # difference to the motion of twice the step, of the length, that needs no second look
ORDERS = (3.0, 4.0)  # ratio of two differences that is trusted
MARGIN = 1.1
Again = Callable[[float], tuple[Array, Array]]


class AccuracyWarning(UserWarning):
    """The step of a simulation is too long for the motion that it computes."""


def tip_error(again: Again) -> float:
    """Return an upper estimate of the largest error of a motion's positions, in the unit of `again`.

    Parameters
    ----------
    again : callable
        ``again(factor)`` repeats the motion with `factor` times its step, 2 or 1/2, and returns positions (T, ..., d)
        of the motion and of its repetition at equal times, over the length of the body. It may raise SimulationError.
    """
    coarse = difference(again, 2.0)
    if 0.0 < coarse <= CLEARED:  # without any difference, other times may have ended the same steps
        return coarse
    fine = difference(again, 0.5)
    if not (np.isfinite(coarse) and fine > 0.0):
        return MARGIN * 4.0 / 3.0 * fine
    ratio = float(np.clip(coarse / fine, *ORDERS))
    by_half, by_both = fine * ratio / (ratio - 1.0), np.sqrt(coarse / 3.0 * fine * 4.0 / 3.0)
    return MARGIN * float(max(by_half, by_both))


def difference(again: Again, factor: float) -> float:
    """Largest distance between a motion and its repetition; infinite where the repetition fails."""
    try:
        return distance(*again(factor))
    except SimulationError:
        return np.inf


def distance(one: Array, other: Array) -> float:
    """Largest distance between two positions (..., d) of the same time."""
    return float(np.sqrt(np.sum((one - other) ** 2, axis=-1).max(initial=0.0)))


def step_for(error: float) -> float:
    """Factor, 0.1 to 0.7, on a step that brings a relative `error` of second order to half the limit."""
    return float(np.clip(np.sqrt(0.5 * LIMIT / error), 0.1, 0.7))
