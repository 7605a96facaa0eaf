"""Fourth order from the second: the same march with every step halved, extrapolated at the output times.

The error of the midpoint rule is even in the step, so that (4 y(h/2) - y(h)) / 3 leaves an error of fourth order
(Richardson; Hairer, Norsett and Wanner I, Sec. II.9). It costs three marches and pays where errors far below a
hundredth of a millimetre are wanted, as for a reference or for a derivative by differences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pliant.errors import InputError
from pliant.model import Model
from pliant.simulation.drive import Drive, drive, inputs_of, merge, subdivide
from pliant.simulation.inputs import Input

Array = np.ndarray
Marched = tuple[Array, Array, Array, Array]  # angles, rates, work, states of the memory, at the output times


def march_extrapolated(
    model: Model, pressure: Input | Sequence[Input], times: Array, step: float, march: Callable[[Drive], Marched],
) -> Marched:
    """What `march` makes of steps of at most `step` [s], extrapolated.

    Raises
    ------
    InputError
        When the model has slip elements or Bouc-Wen, whose corners leave nothing to extrapolate.
    """
    if model.memory.slip_share or model.memory.boucwen_share:
        raise InputError("extrapolation follows creep, not slip or Bouc-Wen, which have corners: use method='midpoint'")
    coarse, fine = (march(even_steps(model, pressure, times, step, parts)) for parts in (1, 2))
    phi, w, work, states = ((4.0 * b - a) / 3.0 for a, b in zip(coarse, fine, strict=True))
    return phi, w, work, states


def even_steps(model: Model, pressure: Input | Sequence[Input], times: Array, step: float, parts: int) -> Drive:
    """As `drive`, with steps that end at every bend of the pressure too, each cut into `parts` equal ones."""
    pairs = zip(inputs_of(model, pressure), model.chambers, strict=True)
    bends = np.concatenate([np.concatenate([p.jumps, p.breakpoints]) + c.valve.dead_time for p, c in pairs])
    same = max(1e-9 * step, 16.0 * float(np.spacing(np.abs(times).max())))
    nodes = subdivide(merge(times, bends, same), step)
    inner = nodes[:-1, None] + np.diff(nodes)[:, None] * np.arange(parts) / parts
    nodes = np.append(inner.ravel(), nodes[-1])
    plan = drive(model, pressure, nodes, step)
    rows = np.searchsorted(nodes, times)
    keep = np.full(plan.h.size, -1)
    keep[rows[1:] - 1] = np.arange(1, times.size)
    return plan._replace(keep=keep)
