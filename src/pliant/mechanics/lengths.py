"""Check of the lengths of arrays before they enter a compiled kernel, which does not check them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError

if TYPE_CHECKING:
    from pliant.mechanics.contract import Mechanics


def input_length(chain: Mechanics) -> int:
    """Return the length N + R of a kernel's inputs: torques at N coordinates, then forces of R tendons."""
    return chain.size + len(chain.model.actuation.levers)


def check_lengths(chain: Mechanics, *, x: Any = None, v: Any = None, torque: Any = None) -> None:
    """Raise InputError unless the last axis of coordinates `x` and rates `v` has the length N, and that of the inputs
    `torque` the length N + R.
    """
    wanted = (("coordinates", x, chain.size), ("rates", v, chain.size), ("inputs", torque, input_length(chain)))
    for noun, values, length in wanted:
        if values is not None and np.shape(values)[-1:] != (length,):
            more = f" ({chain.size} of the coordinates, {length - chain.size} of tendons)" * (length > chain.size)
            raise InputError(
                f"{noun} of model {chain.model.name!r} must be {length} numbers{more}, got shape {np.shape(values)}"
            )
