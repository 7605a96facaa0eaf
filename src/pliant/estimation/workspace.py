"""Arrays that the compiled loops of estimation work in and write to, owned by the caller."""

from __future__ import annotations

from typing import Any

import numpy as np

from pliant.estimation.symbols import FilterOutput, FilterWorkspace, ObserverWorkspace
from pliant.mechanics import mechanics_of, planar
from pliant.model import Model

Array = np.ndarray


def make_workspace(model: Model, states: int, rows: int) -> FilterWorkspace:
    """Workspace of the filter for a model, so many states and rows."""
    n, chain = model.size, mechanics_of(model)
    slopes = chain.slopes()
    J = slopes if isinstance(slopes, np.ndarray) else slopes.J
    shapes = [(states, states), (n,), (n,), (2 * n,), (states,), (states,), (rows,), (rows, n)]
    scratch: list[Any] = [*map(np.zeros, shapes), chain.observed()[1]]
    return FilterWorkspace(chain.workspace(), chain.held(), J, slopes, *scratch)


def make_observer_workspace(model: Model) -> ObserverWorkspace:
    """Workspace of the adaptive observer."""
    n, springs = model.n, mechanics_of(model).joints._replace(theta0=np.zeros(model.n))
    return ObserverWorkspace(
        mechanics_of(model).held(), planar.workspace(n), springs, np.zeros_like(model.actuation.gain), np.zeros(3 * n),
        np.zeros(3 * n),
    )


def make_output(frames: int, states: int, rows: int) -> FilterOutput:
    """Room for so many frames."""
    N = states
    shapes = [(N,), (N, N), (N,), (N, N), (N, N), (rows,), (4,)]
    return FilterOutput(*(np.zeros((frames, *shape)) for shape in shapes))
