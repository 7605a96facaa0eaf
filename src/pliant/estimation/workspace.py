"""Allocation of the scratch and output arrays of the compiled loops of estimation."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.estimation.symbols import FilterOutput, FilterWorkspace, ObserverWorkspace
from pliant.mechanics import mechanics_of, planar
from pliant.model import Model

Array = np.ndarray


def make_workspace(model: Model, states: int, rows: int) -> FilterWorkspace:
    """Return the scratch arrays of the Kalman filter for a model, with this number of states and measured rows."""
    n, chain = model.size, mechanics_of(model)
    slopes = chain.slopes()
    J = slopes if isinstance(slopes, np.ndarray) else slopes.J
    shapes = [(states, states), (n,), (n,), (2 * n,), (states,), (states,), (rows,), (rows, n)]
    scratch: list[Any] = [*map(np.zeros, shapes), chain.observed()[1]]
    return FilterWorkspace(chain.workspace(), chain.held(), J, slopes, *scratch)


def make_observer_workspace(model: Model) -> ObserverWorkspace:
    """Return the scratch arrays of the adaptive observer for a model."""
    n, springs = model.n, mechanics_of(model).joints._replace(theta0=np.zeros(model.n))
    return ObserverWorkspace(
        mechanics_of(model).held(), planar.workspace(n), springs, np.zeros_like(model.actuation.gain), np.zeros(3 * n),
        np.zeros(3 * n),
    )


def make_output(frames: int, states: int, rows: int) -> FilterOutput:
    """Return zeroed output arrays of the Kalman filter for this number of frames, states and measured rows."""
    N = states
    shapes = [(N,), (N, N), (N,), (N, N), (N, N), (rows,), (4,)]
    return FilterOutput(*(np.zeros((frames, *shape)) for shape in shapes))
