"""Inputs behind first-order lags at the frames of recordings, exact for inputs of straight lines and jumps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pliant.numerics.ridge import lagged
from pliant.shapes import Float
from pliant.simulation.drive import commanded, merge
from pliant.simulation.inputs import Input

Array = np.ndarray
SAME_TIME = 1e-9  # s


def behind_lags(
    time: Float[Array, " T"], sources: Sequence[Input], time_constants: Sequence[complex],
) -> list[Float[Array, "T C"]]:
    """Return C inputs behind first-order lags at T frames, an array (T, C) for each time constant [s].

    The lags begin in equilibrium with the inputs of the first time. A complex time constant -1/p is that of one pole p
    of a damped oscillation, and gives complex values.
    """
    nodes, rows = instants(time, sources)
    pieces = np.stack([commanded(source, nodes, 0.0) for source in sources], axis=2)
    return [lagged(nodes, pieces[:, 0], pieces[:, 2], constant)[rows] for constant in time_constants]


def instants(time: Array, sources: Sequence[Input]) -> tuple[Array, Array]:
    """Return the times (N,) [s] of all frames and of the inputs' kinks until the last frame, and the indices (T,) of
    the T frames among them.
    """
    kinks = np.unique(np.concatenate([source.breakpoints for source in sources]))
    nodes = merge(np.concatenate([kinks[kinks < time[0] - SAME_TIME], time]), kinks, SAME_TIME)
    return nodes, np.searchsorted(nodes, time)
