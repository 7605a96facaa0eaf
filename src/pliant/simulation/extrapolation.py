"""Simulation of higher order by extrapolation (`method="extrapolated"`), and to a tolerance (`method="accurate"`).

The error of the midpoint rule is even in the step, so that (4 y(h/2) - y(h)) / 3 leaves an error of fourth order
(Richardson; Hairer, Norsett and Wanner I, Sec. II.9). It costs three times a simple simulation, and is worth it for
errors far below a hundredth of a millimetre, as for a reference or for derivatives by differences.
"""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError, SimulationError
from pliant.model.features import HYSTERESIS, RESTING, Consumer
from pliant.simulation.drive import Drive, drive, grade, merge, subdivide
from pliant.simulation.initial_value import InitialValueProblem, Marched, Solution
from pliant.simulation.time_step import distance

MOST_STEPS = 4_000_000  # of one stage
STAGES = 16
NOT_SMOOTH = HYSTERESIS - {"creep"}
EXTRAPOLATED = Consumer(
    "method='extrapolated'", RESTING - NOT_SMOOTH, remedy=dict.fromkeys(NOT_SMOOTH, "use method='midpoint'")
)


def march_extrapolated(problem: InitialValueProblem, time_step: float) -> Solution:
    """Return the motion extrapolated from two simulations, with steps of at most `time_step` [s] and with half of them.

    The change of the tip by the extrapolation is its estimated error.

    Raises
    ------
    InputError
        When the model has slip elements or Bouc-Wen, because their laws are not smooth.
    """
    EXTRAPOLATED.check(problem.model)
    if not smooth(problem):
        raise InputError("method='extrapolated' does not support known forces and slip of segments: use "
                         "method='midpoint'")  # fmt: skip
    rows = problem.times.size
    coarse, fine = (problem.marched(even_steps(problem, time_step, parts), rows) for parts in (1, 2))
    marched, plan = extrapolated(coarse, fine), problem.plan(time_step)
    error = distance(problem.tips(marched[0]), problem.tips(fine[0]))
    return Solution(plan.pressure, marched, time_step, plan.stretch, error)


def extrapolated(coarse: Marched, fine: Marched) -> Marched:
    """Return a motion of fourth-order accuracy from two of second order: one with a step, one with half this step."""
    phi, w, work, states = ((4.0 * b - a) / 3.0 for a, b in zip(coarse, fine, strict=True))
    return phi, w, work, states


def smooth(problem: InitialValueProblem) -> bool:
    """Return whether the simulation's error is a power series in the square of the step, so that
    extrapolation works.
    """
    memory = problem.model.memory
    return not (memory.slip_share or memory.boucwen_share or memory.axial_slip_share or problem.forces)


def even_steps(problem: InitialValueProblem, time_step: float, parts: int) -> Drive:
    """Return time steps that end at all output times and breakpoints of the inputs. Steps of at most `time_step`
    between these are each divided into `parts` equal ones.
    """
    model, times = problem.model, problem.times
    pairs = list(zip(problem.pressure, model.chambers, strict=True))
    bends = np.concatenate([np.concatenate([p.jumps, p.breakpoints]) + c.valve.dead_time for p, c in pairs])
    same = max(1e-9 * time_step, 16.0 * float(np.spacing(np.abs(times).max())))
    nodes = subdivide(merge(times, bends, same), time_step)
    if problem.graded:
        nodes = grade(nodes, np.concatenate([p.jumps + c.valve.dead_time for p, c in pairs]), same)
    inner = nodes[:-1, None] + np.diff(nodes)[:, None] * np.arange(parts) / parts
    nodes = np.append(inner.ravel(), nodes[-1])
    plan = drive(model, problem.pressure, nodes, time_step)
    rows = np.searchsorted(nodes, times)
    keep = np.full(plan.h.size, -1)
    keep[rows[1:] - 1] = np.arange(1, times.size)
    return problem.loaded(plan._replace(keep=keep))


def march_accurate(problem: InitialValueProblem, time_step: float, tolerance: float) -> Solution:
    """Return a motion whose tip error is at most `tolerance` times the length; steps start at `time_step` and shrink.

    Raises
    ------
    InputError
        When the tolerance is not a positive number.
    SimulationError
        When no stage reaches the tolerance, or all stages fail.
    """
    if not (np.isfinite(tolerance) and tolerance > 0):
        raise InputError(f"the tolerance must be a positive fraction of the length, got {tolerance}")
    before: Marched | None = None
    best: Marched | None = None
    failed: SimulationError | None = None
    for k in range(STAGES):
        plan = even_steps(problem, time_step, 2**k)
        if plan.h.size > MOST_STEPS:
            break
        try:
            fine = problem.marched(plan, problem.times.size)
        except SimulationError as failure:
            failed, before, best = failure, None, None
            continue
        now = extrapolated(before, fine) if before is not None and smooth(problem) else fine
        error = np.inf if best is None else distance(problem.tips(now[0]), problem.tips(best[0]))
        if error <= tolerance:
            recorded = problem.plan(time_step)
            return Solution(recorded.pressure, now, float(plan.h.max()), recorded.stretch, error)
        before, best = fine, now
    if best is None and failed is not None:
        raise failed
    raise SimulationError(
        f"the motion cannot be computed to {100 * tolerance:.3g} % of the length with {MOST_STEPS:.3g} steps, because "
        "it is too sensitive to its initial state: simulate a shorter time, or raise the tolerance"
    )
