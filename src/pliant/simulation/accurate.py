"""Simulation with `method="accurate"`: the steps are halved until the tip position has a given accuracy.

Smooth motions are extrapolated at each stage (`pliant.simulation.extrapolated`). The difference of two stages estimates
the error of the coarser one, and the finer one is returned. This controls the error of the whole motion, not of each
step.
"""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError, SimulationError
from pliant.simulation.accuracy import distance
from pliant.simulation.extrapolated import even_steps, extrapolated, smooth
from pliant.simulation.initial_value import InitialValueProblem, Marched, Solution

Array = np.ndarray
MOST_STEPS = 4_000_000  # of one stage
STAGES = 16


def march_accurate(problem: InitialValueProblem, step: float, tolerance: float) -> Solution:
    """Return the motion whose tip error is at most `tolerance` times the length, starting with steps of `step` [s].

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
        plan = even_steps(problem, step, 2**k)
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
            recorded = problem.plan(step)
            return Solution(recorded.pressure, now, float(plan.h.max()), recorded.stretch, error)
        before, best = fine, now
    if best is None and failed is not None:
        raise failed
    raise SimulationError(
        f"the motion cannot be computed to {100 * tolerance:.3g} % of the length with {MOST_STEPS:.3g} steps, because "
        "it is too sensitive to its initial state: simulate a shorter time, or raise the tolerance"
    )
