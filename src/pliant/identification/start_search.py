"""Search for start values of a fit in space without a given stiffness, by trying several stiffnesses.

Few recordings in space contain a free decay, and a stiffness that is wrong by a factor of ten leads a fit into another
optimum. Each stiffness that is tried gets the torques that fit the recordings best by linear least squares. A short fit
from each of the best few then decides. Only the beginnings of the recordings are used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pliant.errors import InputError, PliantError
from pliant.identification.chamber_parameters import GAINS
from pliant.identification.edges import displacement
from pliant.identification.experiment import Experiment
from pliant.identification.initial_guess import prepare, ring_start
from pliant.identification.names import stem_of
from pliant.identification.optimise import solve
from pliant.identification.parameters import Parameter, apply, each_joint, shared_name, values_of
from pliant.identification.problem import Problem
from pliant.model import Model
from pliant.simulation import modes

Array = np.ndarray
FACTORS = tuple(4.0**k for k in range(-4, 5))  # on the stiffness of the estimate
RATIOS = (0.2, 0.05, 0.6)  # damping ratios of the first mode; the first one is tried with every stiffness
KEPT = 2  # candidates that get a short fit
TRIAL = 6  # evaluations of a short fit
DURATION, SHORTEST = 2.0, 0.5  # s after the motion begins: of all recordings together, and of each at least
MOVING = 0.05  # of the peak displacement: beginning of the motion


def searched(
    experiments: Sequence[Experiment], model: Model, parameters: Sequence[Parameter | str], time_step: float,
    weighting: str,
) -> tuple[Model, list[Parameter]]:
    """Return the model and parameters with start values for a fit, the best of several joint stiffnesses.

    For a planar chain, or one whose stiffness is given or fixed, the estimate of `prepare` is returned.
    """
    listed = each_joint((Parameter(p) if isinstance(p, str) else p for p in parameters), model.n)
    unknown = any(p.value is None and shared_name(p.name) == "stiffness" for p in listed)
    if model.space is None or not unknown:
        return prepare(experiments, model, parameters)
    start_model = apply(model, values_of(listed))
    middle = ring_start(start_model, experiments, {"stiffness"})["stiffness"]
    beginnings = [beginning(e, max(DURATION / len(experiments), SHORTEST)) for e in experiments]

    def tried(stiffness: float, ratio: float) -> TrialStart | None:
        return candidate(beginnings, model, stated(listed, model, stiffness, ratio), stiffness, time_step, weighting)

    candidates = [c for factor in FACTORS if (c := tried(middle * factor, RATIOS[0]))]
    candidates += [c for best in best_of(candidates) for ratio in RATIOS[1:] if (c := tried(best.stiffness, ratio))]
    ends = [short_fit(c, time_step, weighting, beginnings) for c in best_of(candidates)]
    if not ends:  # it says what is wrong
        return prepare(experiments, model, parameters)
    values = min(ends, key=lambda end: end[0])[1]
    known = {p.name for p in listed if p.value is None and values[p.name] != 0.0}  # 0: of an input that acts later
    return prepare(experiments, model, [
        p.with_(value=float(np.clip(values[p.name], p.lower, p.upper)), source="estimated") if p.name in known else p
        for p in listed
    ])  # fmt: skip


def independent_start(
    problem: Problem, model: Model, parameters: Sequence[Parameter | str], time_step: float,
    weighting: str,
) -> Array | None:
    """Return scaled start values (P,) of P parameters of a fit in space, found without the given stiffness and torques;
    None if no such search is needed or it fails.

    A second start there checks that the given one leads to the best optimum. None for a planar chain, if no start value
    of the stiffness is given, or if the search fails.
    """
    listed = each_joint((Parameter(p) if isinstance(p, str) else p for p in parameters), model.n)
    forgotten = {p.name for p in listed if p.free and p.value is not None and not p.prior_std and is_sought(p.name)}
    if model.space is None or "stiffness" not in {shared_name(name) for name in forgotten}:
        return None
    unstated = [p.with_(value=None) if p.name in forgotten else p for p in listed]
    try:
        values = {p.name: p.value for p in searched(problem.experiments, model, unstated, time_step, weighting)[1]}
    except PliantError:
        return None
    x = np.array([values[p.name] for p in problem.free], dtype=float) / problem.scale
    return np.asarray(np.clip(x, *problem.bounds))


def is_sought(name: str) -> bool:
    """Return whether the search over stiffnesses determines the start value of the parameter `name`."""
    return shared_name(name) in ("stiffness", "damping") or stem_of(name) in ("torque", *GAINS)


class TrialStart(NamedTuple):
    """Start values of a fit that can be simulated, with cost, stiffness, model and parameters."""

    cost: float
    stiffness: float
    model: Model
    parameters: list[Parameter]


def best_of(candidates: Sequence[TrialStart]) -> list[TrialStart]:
    """Return the trial starts of least cost, at most `KEPT`."""
    return sorted(candidates, key=lambda c: c.cost)[:KEPT]


def beginning(exp: Experiment, duration: float) -> Experiment:
    """Return an experiment cut to `duration` [s] after its motion begins; one of static poses is returned unchanged."""
    if exp.excitation != "trace" or exp.poses:
        return exp
    moving = exp.time[int(np.argmax(displacement(exp) > MOVING * exp.travel))]
    keep = exp.time <= moving + duration
    cut: dict[str, Any] = {name: None if (value := getattr(exp, name)) is None else value[keep]
           for name in ("time", "position", "angle", "orientation")}  # fmt: skip
    cut["further"] = {name: rows._replace(values=rows.values[keep]) for name, rows in exp.further.items()}
    try:
        return replace(exp, **cut)
    except InputError:  # a station is seen too late
        return exp


def stated(listed: Sequence[Parameter], model: Model, stiffness: float, ratio: float) -> list[Parameter]:
    """Return the parameters with start values for joint stiffness and damping where none was given: the `stiffness` [N
    m/rad], and the damping that gives the first mode the damping ratio `ratio`.
    """
    omega = 2 * np.pi * float(modes(model.with_(stiffness=stiffness, gravity=0 * model.gravity))[0][0])
    trial_values = {"stiffness": stiffness, "damping": 2 * ratio * stiffness / omega}
    return [
        p if p.value is not None or (kind := shared_name(p.name)) not in trial_values
        else p.with_(value=float(np.clip(trial_values[kind], p.lower, p.upper)))
        for p in listed
    ]  # fmt: skip


def candidate(
    experiments: Sequence[Experiment], model: Model, listed: Sequence[Parameter], stiffness: float, time_step: float,
    weighting: str,
) -> TrialStart | None:
    """Return a trial start at the given joint stiffness, with the torques or gains that fit a linearised motion best.
    None if it cannot be simulated.

    The motion is linearised about zero torque. The estimated torques are kept if they fit better. None if neither can
    be simulated.
    """
    try:
        placed, filled = prepare(experiments, model, listed)
        torques = linear_torques(placed, listed)
        fixed = [p.with_(free=p.name in torques) for p in filled]
        problem = Problem(list(experiments), placed, fixed, time_step, weighting)
        solutions = [problem.start]
        if torques:
            still = np.clip(0.0 * problem.start, *problem.bounds)
            r = problem.residual(still)
            if not problem.broken:
                moves = np.linalg.lstsq(problem.jacobian(still), -r, rcond=1e-6)[0]
                solutions.append(np.clip(still + moves, *problem.bounds))
        costs = [problem.cost(x) for x in solutions]
    except PliantError:
        return None
    values = problem.values(solutions[int(np.argmin(costs))])
    if not np.isfinite(min(costs)):
        return None
    return TrialStart(min(costs), stiffness, placed, [p.with_(value=values[p.name]) for p in filled])


def short_fit(
    start: TrialStart, time_step: float, weighting: str, experiments: Sequence[Experiment],
) -> tuple[float, dict[str, float]]:
    """Run a fit of a few evaluations from a trial start; return its cost and parameter values by name."""
    problem = Problem(list(experiments), start.model, start.parameters, time_step, weighting)
    end = solve(problem, problem.start, "linear", TRIAL)
    return float(end.cost), problem.values(end.x)


def linear_torques(model: Model, listed: Sequence[Parameter]) -> set[str]:
    """Return the names of free parameters without start value that scale the torques: law coefficients or, if none,
    gains.
    """
    tendons = {c.name for c in model.chambers if c.signs}
    names = [p.name for p in listed if p.value is None and p.free and p.name.partition(".")[0] not in tendons]
    laws = {name for name in names if stem_of(name) == "torque"}
    return laws or {name for name in names if stem_of(name) in GAINS}
