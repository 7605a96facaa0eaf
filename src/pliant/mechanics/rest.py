"""Static equilibrium of a loaded chain, by Newton's method with a load that increases in steps.

It is for chains in a plane; `equations.poses` does this in space.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pliant.equations.poses import Settling
from pliant.errors import SimulationError

Array = np.ndarray
GROWING = (0.25, 0.5, 0.75, 1.0)  # parts in which a load grows, so that a large motion stays on its branch
BUCKLES = "the chain buckles under its load and has no stable equilibrium: raise the stiffness or lower the load"
NEAR = 1e-6  # rad and strains: tolerance of the equilibria under a part of the load


def loaded_rest(residual: Callable[[Array, float], tuple[Array, Array]], q: Array, stiffest: float) -> Array:
    """Return the equilibrium coordinates (N,) under a load, found in load steps from the equilibrium q (N,) without the
    load.

    ``residual(q, share)`` returns the net force (N,) and the stiffness (N, N) under the fraction `share` of the load.

    Raises
    ------
    SimulationError
        When no stable equilibrium is found, because the load buckles the chain.
    """
    for share in GROWING:
        for _ in range(50):
            r, K = residual(q, share)
            move = np.linalg.lstsq(K, r)[0]  # K is singular at the buckling load
            size = np.abs(move).max()
            q = q + move * min(1.0, 0.5 / max(size, 1e-300))
            if size < (1e-13 if share == 1.0 else NEAR):
                break
    r, K = residual(q, 1.0)
    if not np.isfinite(q).all() or np.abs(r).max() > 1e-9 * stiffest or np.linalg.eigvalsh(K).min() <= 0:
        raise SimulationError(BUCKLES)
    return q


def settling(
    poses: int, size: int, inputs: int, load: Array, slip: Sequence[Any] = ((), ()), turns: int = 0,
) -> Settling:
    """Return the arrays for a search of `poses` static poses of a chain in space, starting at rest in the unloaded
    shape.

    The chain has `size` coordinates.

    `inputs` counts the torques of coordinates and the commands of tendons; `load` is that of forces on the links;
    `slip` are the shares and limits [rad] of the joints' slip elements, which act on the first `turns`
    coordinates.
    """
    now, last, push, move = np.zeros((4, size), dtype=complex)
    run = np.zeros((inputs - size, len(load)), dtype=complex)
    K = np.zeros((poses + 1, size, size))
    share, limit = (np.array(part, dtype=complex) for part in slip)
    stretch = np.zeros((share.size, turns), dtype=complex)
    return Settling(np.zeros((poses + 1, size)), K, now, last, np.zeros(inputs, complex), push, move, run, load + 0.0j,
                    stretch, share, limit)
