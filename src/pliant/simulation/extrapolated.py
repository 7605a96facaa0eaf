"""Fourth order from the second: the same march with every step halved, extrapolated at the output times.

The error of the midpoint rule is even in the step, so that (4 y(h/2) - y(h)) / 3 leaves an error of fourth order
(Richardson; Hairer, Norsett and Wanner I, Sec. II.9). It costs three marches and pays where errors far below a
hundredth of a millimetre are wanted, as for a reference or for a derivative by differences.
"""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError
from pliant.simulation.accuracy import distance
from pliant.simulation.drive import Drive, drive, merge, subdivide
from pliant.simulation.initial_value import InitialValueProblem, Marched, Solution

Array = np.ndarray


def march_extrapolated(problem: InitialValueProblem, step: float) -> Solution:
    """The motion by steps of at most `step` [s], extrapolated; its error is estimated by what that changes.

    Raises
    ------
    InputError
        When the model has slip elements or Bouc-Wen, whose corners leave nothing to extrapolate.
    """
    if not smooth(problem):
        raise InputError("extrapolation follows creep, not slip or Bouc-Wen, which have corners: use method='midpoint'")
    rows = problem.times.size
    coarse, fine = (problem.marched(even_steps(problem, step, parts), rows) for parts in (1, 2))
    marched, plan = extrapolated(coarse, fine), problem.plan(step)
    error = distance(problem.tips(marched[0]), problem.tips(fine[0]))
    return Solution(plan.pressure, marched, step, plan.stretch, error)


def extrapolated(coarse: Marched, fine: Marched) -> Marched:
    """Return the march of fourth order from two of second, of which the finer has half the step of the other."""
    phi, w, work, states = ((4.0 * b - a) / 3.0 for a, b in zip(coarse, fine, strict=True))
    return phi, w, work, states


def smooth(problem: InitialValueProblem) -> bool:
    """Whether the error of a march is a series in the square of its step."""
    memory = problem.model.memory
    return not (memory.slip_share or memory.boucwen_share or memory.axial_slip_share or problem.forces)


def even_steps(problem: InitialValueProblem, step: float, parts: int) -> Drive:
    """Same as `drive`, with steps that end at every bend of the pressure too, each cut into `parts` equal ones."""
    model, times = problem.model, problem.times
    pairs = zip(problem.pressure, model.chambers, strict=True)
    bends = np.concatenate([np.concatenate([p.jumps, p.breakpoints]) + c.valve.dead_time for p, c in pairs])
    same = max(1e-9 * step, 16.0 * float(np.spacing(np.abs(times).max())))
    nodes = subdivide(merge(times, bends, same), step)
    inner = nodes[:-1, None] + np.diff(nodes)[:, None] * np.arange(parts) / parts
    nodes = np.append(inner.ravel(), nodes[-1])
    plan = drive(model, problem.pressure, nodes, step)
    rows = np.searchsorted(nodes, times)
    keep = np.full(plan.h.size, -1)
    keep[rows[1:] - 1] = np.arange(1, times.size)
    return problem.loaded(plan._replace(keep=keep))
