"""The rest of a chain under a load, by Newton's method: in a plane; in space `equations.poses` has it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pliant.equations.poses import Settling
from pliant.errors import SimulationError

Array = np.ndarray
GROWING = (0.25, 0.5, 0.75, 1.0)  # parts in which a load grows, so that a long fall stays on its branch
BUCKLES = "the chain finds no stable rest under its load: it buckles; raise the stiffness or lower the load"
NEAR = 1e-6  # rad and strains: where a rest under part of a load is near enough to go on from


def loaded_rest(residual: Callable[[Array, float], tuple[Array, Array]], q: Array, stiffest: float) -> Array:
    """Return the rest under a load that grows from nothing, from the rest q without it, by Newton's method.

    Raises
    ------
    SimulationError
        When no stable rest is found: the load buckles the chain.
    """
    for share in GROWING:
        for _ in range(50):
            r, K = residual(q, share)
            move = np.linalg.lstsq(K, r)[0]  # at the very load that buckles, K is singular
            size = np.abs(move).max()
            q = q + move * min(1.0, 0.5 / max(size, 1e-300))
            if size < (1e-13 if share == 1.0 else NEAR):
                break
    r, K = residual(q, 1.0)
    if not np.isfinite(q).all() or np.abs(r).max() > 1e-9 * stiffest or np.linalg.eigvalsh(K).min() <= 0:
        raise SimulationError(BUCKLES)
    return q


def settling(poses: int, size: int, inputs: int, load: Array) -> Settling:
    """Return arrays for so many poses of a chain in space of `size` coordinates, at rest in its unloaded shape first.

    `inputs` counts the torques of coordinates and the commands of tendons; `load` is that of forces on the links.
    """
    at, last, push, move = np.zeros((4, size), dtype=complex)
    K = np.zeros((poses + 1, size, size))
    return Settling(np.zeros((poses + 1, size)), K, at, last, np.zeros(inputs, complex), push, move, load + 0.0j)
