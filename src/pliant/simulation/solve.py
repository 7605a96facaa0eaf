"""The function `simulate`, which computes the motion of a model under pressure inputs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import xarray as xr

from pliant.errors import InputError, SimulationError
from pliant.mechanics import mechanics_of
from pliant.mechanics.reaction import BaseTwist, accelerations
from pliant.model import Model
from pliant.shapes import Float
from pliant.simulation import state
from pliant.simulation.balance import BASE_MOVES, Defects, energies, energy_defects, warn_of_defects
from pliant.simulation.base_motion import BaseMotion, inward
from pliant.simulation.drive import LONGEST, Drive
from pliant.simulation.extrapolation import march_accurate, march_extrapolated
from pliant.simulation.forces import PointForce, at_time, link_loads, station_of
from pliant.simulation.initial_value import InitialValueProblem, Marched, Solution, posed
from pliant.simulation.inputs import Input
from pliant.simulation.reference import METHODS, Start, solve_reference
from pliant.simulation.result import Motion, trajectory
from pliant.simulation.time_step import EVERY, LIMIT, nice, resolving_step, step_for, tip_error

Array = np.ndarray
STEPS_PER_PERIOD = 8  # of the first mode: fewer steps do not resolve its oscillation
OWN_METHODS = ("midpoint", "extrapolated", "accurate")
WITH_FORCES = ("midpoint", "accurate")
REFINEMENTS = 8  # of the automatic step, at most
SHORTER = 0.15  # of the first automatic step: shorter ones are not tried after a failure
MOST_STEPS = 500_000  # with the automatic step, at most


Entry = tuple[tuple[str, ...], Array]


def base_variables(problem: InitialValueProblem, marched: Marched, plan: Drive) -> dict[str, Entry]:
    """Return pose, force and moment of a moving base at T output times as dataset variables; {} for a base at rest.

    The force acts on the body, the moment about the base frame's origin, both in the axes of the moved base. They
    follow from the accelerations of the links under the inputs, whose value at an output time is the mean of the steps
    before and after it.
    """
    if problem.base is None:
        return {}
    chain, (x, v, _, states) = mechanics_of(problem.model), marched
    pose = problem.base.at(problem.times)
    twist = BaseTwist(
        inward(pose.axes, problem.model.gravity), inward(pose.axes, pose.velocity),
        inward(pose.axes, pose.acceleration), *((pose.rate, pose.turning) if chain.dimension == 2 else
                                                (inward(pose.axes, pose.rate), inward(pose.axes, pose.turning))),
    )  # fmt: skip
    torque = torques_at(plan, len(x))
    torque[:, : chain.remembering] -= state.memory_torques(problem.model, x, states)
    pulls = [at_time(force, problem.times) for force in problem.forces]
    if pulls:
        loads = link_loads(problem.model, problem.forces, np.stack(pulls, axis=1))
        pushed = np.array([chain.load_forces(*pair) for pair in zip(x, loads, strict=True)])
        torque[:, : chain.size] += pushed @ chain.from_joints
    force, moment = chain.reaction(x, v, accelerations(chain, x, v, torque, twist), twist)
    for pull, load in zip(pulls, problem.forces, strict=True):
        point = mechanics_of(problem.model.with_(stations=(station_of(problem.model, load),))).stations(x)[0][:, 0]
        turned = np.cross(in_space(point), in_space(pull))[:, -moment.shape[1] :]
        force, moment = force - pull, moment - turned
    turn: dict[str, Entry] = {"base_angle": (("time",), pose.angle)} if chain.dimension == 2 else {
        "base_axes": (("time", "axis", "base_axis"), pose.axes)}  # fmt: skip
    return {
        "base_position": (("time", "axis"), pose.position), **turn, "base_force": (("time", "axis"), force),
        "base_moment": (("time",), moment[:, 0]) if chain.dimension == 2 else (("time", "axis"), moment),
    }


def in_space(vectors: Array) -> Array:
    """Return vectors (T, 2 or 3) as vectors in space (T, 3)."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def torques_at(plan: Drive, rows: int) -> Array:
    """Return the torques of joints and inputs of tendons (T, N + R) at T output times: the mean of the steps before and
    after each.
    """
    mean = plan.joint_torque
    ends = np.append(-1, np.flatnonzero(plan.keep >= 0))[:rows]
    last = len(mean) - 1
    return np.asarray(0.5 * (mean[np.maximum(ends, 0)] + mean[np.minimum(ends + 1, last)]))


class Settings(NamedTuple):
    """Solver settings of `simulate`: method, time step, tolerances, and whether to check the accuracy."""

    time_step: float | None
    method: str
    rtol: float
    tolerance: float
    check: bool


def simulate(
    model: Model,
    pressure: Input | Sequence[Input],
    *,
    duration: float | None = None,
    times: Float[Array, " T"] | None = None,
    time_step: float | None = None,
    method: str = "midpoint",
    initial_angle: Float[Array, " N"] | None = None,
    initial_rate: Float[Array, " N"] | None = None,
    initial_memory: Float[Array, "N M"] | None = None,
    forces: Sequence[PointForce] = (),
    base: BaseMotion | None = None,
    rtol: float = 1e-8,
    tolerance: float = 1e-4,
    check: bool = True,
    graded: bool = False,
) -> xr.Dataset:
    """Simulate a model under pressure inputs and return its motion as a dataset.

    Paper: Eq. (5) [eq:eom], solver D14.

    Parameters
    ----------
    model : Model
    pressure : Input, or one for each chamber in their order
        Commanded pressure, Pa gauge: `Pulse`, `Trace`, `Chirp`, ... or any object with the interface `Input`.
    duration : float
        Duration from time 0, s, with output every `time_step` (default: every millisecond). Alternatively give `times`.
    times : array (T,)
        Output times, s, strictly increasing; the first is the start.
    time_step : float, optional
        Longest time step, s. Steps end at every output time and at every jump of the pressure. Default: that of
        `pliant.simulation.time_step.resolving_step`, at most 1 ms, shortened until the estimated error of the tip is
        below 1 % of the length and less than 1 % of the energy appears or disappears.
    method : {"midpoint", "extrapolated", "accurate", "LSODA", "BDF", "Radau"}
        "midpoint": the linearly implicit midpoint rule (second order, stable, fixed cost). "extrapolated": two such
        simulations extrapolated to fourth order, for errors below a hundredth of a millimetre. "accurate": steps halved
        until the error of the tip is below `tolerance`. Others: a SciPy solver as a reference, with the compiled
        right-hand side and Jacobian, and the relative tolerance `rtol` in each step.
    initial_angle, initial_rate : array (n,)
        Initial joint angles and rates, rad and rad/s; default: equilibrium under gravity and the pressure just before
        the first time, so that a step at the first time moves the chain. For a body that lengthens (n + S,), with the
        strains of its segments, or their rates, behind.
    initial_memory : array (n, memory)
        Initial hysteresis states, rad, in the order of ``memory_state``; default: equilibrium, with creep relaxed and
        slip elements and Bouc-Wen unstretched.
    forces : sequence of `pliant.simulation.forces.PointForce`
        Forces at points of the body, N in the base frame. Their mean over each step acts at the mid-step angles, and
        their work is part of the input work. Only with ``method="midpoint"`` or ``"accurate"``.
    base : pliant.simulation.BaseMotion, optional
        Prescribed motion of the base. Angles and positions of the result are relative to the moved base. The default
        start is the equilibrium on a base at rest in its first pose. Only with ``method="midpoint"`` or ``"accurate"``.
    rtol : float
        Relative tolerance of the SciPy solvers.
    tolerance : float
        For ``method="accurate"``: largest error of the tip, as a fraction of the length.
    check : bool
        Whether to estimate the error of the tip, and to warn of it and of missing energy. This takes half as many steps
        again, and twice as many more if the first estimate is not small.
    graded : bool
        Whether the first two steps, and the first two after each jump of a pressure, are divided, the first into six
        with the shortest 1/32 of it, the second into two. Stiff or strongly damped bodies that are released or driven
        suddenly then need far fewer steps for the same accuracy. Not for the SciPy solvers, which choose their steps.

    Returns
    -------
    xarray.Dataset
        joint_angle, joint_rate (time, joint); tip_position (time, link, axis); station_position (time, station,
        axis), station_angle; pressure (time, input), also for one input, or actuation (time, input) unless all inputs
        are pressures; kinetic, elastic and gravitational energy, input work, dissipated energy (time).
        With hysteresis also memory_state (time, joint, memory), memory_torque (time, joint), memory_energy,
        memory_dissipation (time). Where segments lengthen also axial_strain, axial_strain_rate and extension [m]
        (time, segment). With `base` also base_position, base_angle or base_axes, and the force and moment that the base
        exerts on the body, base_force and base_moment, in the axes of the base; the energies are then those of the
        motion relative to the base, do not balance, and are not judged. The change of kinetic + elastic +
        gravitational + hysteresis energy equals input work less both losses. Attributes: method, step_s and graded (0
        or 1); energy_gain and energy_loss, the energy which the computed motion gains without a source and loses
        without dissipation, as fractions of the largest change of any form of energy; tip_error, an upper estimate of
        the largest error of the tip, m (not with `check` = False or a SciPy solver).

    Raises
    ------
    InputError
        When times, time_step or method are not usable, the step is too long for the model's first mode, or `graded` is
        set for a SciPy solver.
    SimulationError
        When a value is not finite, there is no equilibrium to start from, or `tolerance` cannot be reached.

    Warns
    -----
    AccuracyWarning
        When the estimated error of the tip is more than 1 % of the length.
    EnergyWarning
        When energy appears or disappears by more than 1 % of the largest change of any form of energy.

    Examples
    --------
    >>> import pliant
    >>> from pliant.actuators import chen2018
    >>> motion = pliant.simulate(chen2018.model(), pliant.Pulse(level=50e3, start=0.1, width=1.0), duration=0.5)
    >>> dict(motion.tip_position.sizes)["link"]
    5
    """
    check_step(model, time_step, method)
    how = Settings(time_step, method, rtol, tolerance, check)
    problem = posed(model, pressure, output_times(duration, times, time_step), forces, base)._replace(graded=graded)
    model = problem.model
    problem = problem.started(initial_angle, initial_rate, initial_memory)
    solution = solved(problem, how)
    phi, w, _, states = solution.marched
    if lost := state.first_given_way(model, problem.times, phi):
        raise SimulationError(lost)
    extra = state.memory_outputs(model, phi, states)
    if solution.stretch is not None:
        extra["hoop_stretch"] = (("time", "input"), solution.stretch)
    if base is not None:
        extra |= base_variables(problem, solution.marched, problem.plan(solution.time_step))
    balance = solution.energies or energies(model, solution.marched)
    motion = trajectory(
        model, Motion(problem.times, solution.pressure, phi, w), balance, extra,
        method=method, time_step=solution.time_step,
    )
    motion.attrs["graded"] = int(graded)  # netCDF has no Booleans
    if base is not None:
        motion.attrs["history"] = base.summary()
    return judged(motion, solution, how, model.length)


def judged(motion: xr.Dataset, solution: Solution, how: Settings, length: float) -> xr.Dataset:
    """Return the motion with its tip error and energy imbalance as attributes; warn if either is too large."""
    gain, loss = energy_defects(motion)
    if BASE_MOVES not in motion:
        motion.attrs |= {"energy_gain": gain, "energy_loss": loss}  # `assign_attrs` would copy the whole
    if np.isfinite(solution.error):
        motion.attrs["tip_error"] = solution.error * length
    if how.check:
        advice = "use method='accurate' or simulate a shorter time"
        if how.method in OWN_METHODS and (how.time_step is not None or how.method != "midpoint"):
            worst = np.fmax(solution.error, max(gain, loss, LIMIT))  # the error may be NaN: not estimated
            shorter = nice(solution.time_step * step_for(worst))
            advice = f"use time_step={shorter:g}"
            if how.method == "midpoint":
                advice += " or leave it out"
        warn_of_defects(Defects(solution.error, length, gain, loss), solution.time_step, advice)
    return motion


def solved(problem: InitialValueProblem, how: Settings) -> Solution:
    """Integrate an initial value problem by the method in the settings `how`; return the motion."""
    time_step = how.time_step or EVERY
    if problem.forces and how.method not in WITH_FORCES:
        raise InputError(f"forces need method='midpoint' or method='accurate', got {how.method!r}")
    if how.method in METHODS:
        if problem.graded:
            raise InputError(f"method={how.method!r} chooses its own steps: leave out graded=True")
        plan = problem.plan(time_step)
        start = Start(*problem.start, problem.initial, problem.states)
        phi, w, work, states, stretch = solve_reference(
            problem.model, problem.pressure, problem.times, start, how.method, how.rtol
        )
        return Solution(plan.pressure, (phi, w, work, states), time_step, None if plan.stretch is None else stretch)
    if how.method == "accurate":
        return march_accurate(problem, first_step(problem, how), how.tolerance)
    if how.method == "extrapolated":
        return march_extrapolated(problem, first_step(problem, how))
    return by_midpoint(problem, how)


def first_step(problem: InitialValueProblem, how: Settings) -> float:
    """Return the time step [s] in the settings `how` or, if none is set, the step that the model needs."""
    if how.time_step is not None:
        return how.time_step
    model, duration = problem.model, float(np.ptp(problem.times))
    moved = mechanics_of(model).joint_coordinates(problem.start[0]) - state.equilibrium(model)
    return resolving_step(model, moved, duration)


def by_midpoint(problem: InitialValueProblem, how: Settings) -> Solution:
    """Integrate by the midpoint rule; an automatic step is shortened until the tip position is accurate and the energy
    is balanced.

    If the motion is too fast for the first automatic step, shorter ones are tried, and SimulationError is raised if
    none makes the tip accurate.
    """
    time_step = first = first_step(problem, how)
    refused: SimulationError | None = None
    error = np.nan
    for _ in range(REFINEMENTS):
        try:
            plan = problem.plan(time_step)
            marched = problem.marched(plan)
        except SimulationError as failure:
            if how.time_step is not None or time_step < SHORTER * first:
                raise refused or failure from None
            refused, time_step = refused or failure, nice(0.5 * time_step)
            continue
        energy = energies(problem.model, marched)
        error = tip_error(partial(problem.repeated, plan, marched[0])) if how.check else np.nan
        missing = energy_defects(energy) if problem.base is None else ()
        worst = max((error, *missing)) if how.check else np.nan
        if how.time_step is not None or not worst > LIMIT or plan.h.size > MOST_STEPS * step_for(worst):
            break
        time_step = nice(time_step * step_for(worst))
    if refused is not None and error > LIMIT:
        raise refused
    return Solution(plan.pressure, marched, time_step, plan.stretch, error, energy)


def output_times(duration: float | None, times: Array | None, time_step: float | None) -> Array:
    """Return the output times [s]: `times` if given, else every `time_step` (default 1 ms) for the `duration`."""
    time_step = EVERY if time_step is None else time_step
    if (duration is None) == (times is None):
        raise InputError("give either duration (s) or times (s), not both")
    if times is not None:
        return np.asarray(times, dtype=float)
    if duration is None or not (np.isfinite(duration) and duration > 0):
        raise InputError(f"the duration must be a positive time in seconds, got {duration}")
    if duration / time_step > LONGEST:
        raise InputError(f"{duration:.6g} s in steps of {time_step:.3g} s are too many steps: use a longer step")
    return np.linspace(0.0, duration, max(2, round(duration / time_step) + 1))


def longest_allowed_step(model: Model) -> float:
    """Return the longest step [s] that resolves the first mode of vibration of a model."""
    return float(1.0 / (STEPS_PER_PERIOD * state.modes(model)[0][0]))


def check_step(model: Model, time_step: float | None, method: str) -> None:
    """Raise InputError for an unknown method, or for a step [s] that is not positive or too long for the model's first
    mode of vibration.
    """
    if time_step is not None and not (np.isfinite(time_step) and time_step > 0):
        raise InputError(f"time_step must be a positive time in seconds, got {time_step}")
    if method in METHODS:
        return
    if method not in OWN_METHODS:
        raise InputError(f"unknown method {method!r}: use {', '.join((*OWN_METHODS, *METHODS))}")
    if time_step is None:
        return
    longest = longest_allowed_step(model)
    if time_step > longest:
        first = 1.0 / (STEPS_PER_PERIOD * longest)
        raise InputError(
            f"a step of {time_step * 1e3:.3g} ms is too long: the first mode rings at {first:.3g} Hz and needs at "
            f"least {STEPS_PER_PERIOD} steps a period; use a step of {longest * 1e3:.3g} ms or less"
        )
