"""Preparation of a fit's simulations: from a model and an experiment to the arrays for the compiled loops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pliant.equations.symbols import MemoryLaw
from pliant.identification.drives import inputs_to
from pliant.identification.following import REAL, initial_hysteresis
from pliant.identification.held_pose import beyond_reach, chain_of, pose_through
from pliant.identification.loop_inputs import ForwardProblem, Numbers
from pliant.identification.observation import between_frames, lags_of, repeated, with_axes
from pliant.identification.parameters import for_record
from pliant.identification.plans import ModelAt, Plans
from pliant.identification.poses import pose_inputs
from pliant.identification.starts import StartState
from pliant.mechanics import mechanics_of
from pliant.model import Model, Station
from pliant.simulation import Pulse, equilibrium
from pliant.simulation.base_motion import check_base
from pliant.simulation.drive import Drive, driven, laid_out
from pliant.simulation.drive import drive as drive_of
from pliant.simulation.forces import loads_at
from pliant.simulation.initial_value import loads_and_base, loads_before
from pliant.simulation.state import laws_of

if TYPE_CHECKING:
    from pliant.identification.experiment import Experiment

Array = np.ndarray


def forward_problem(
    model: Model, exp: Experiment, values: Mapping[str, float], time_step: float,
    plans: Plans | None = None, rest: Array | None = None, drive: Drive | None = None,
) -> ForwardProblem:
    """Return the simulation inputs of an experiment at parameter `values`: initial state, steps, torques, observed
    points.

    Parameters
    ----------
    time_step : float
        Integration step, s.
    plans : Plans, optional
        Cache of intermediate results, shared between calls for the same model.
    rest : array (n,), optional
        Known joint angles at the start, which spare a search for the equilibrium.
    drive : Drive, optional
        Precomputed steps and torques, used in place of those that follow from `values`. Not for a release.
    """
    params = {**for_record(values, exp.name), **exp.known}
    plans = Plans() if plans is None else plans
    if exp.base is not None and not model.moving_base:
        check_base(model, exp.base)
        model = model.with_(moving_base=True)
    model_at = plans.at(model, params)
    m = model_at.model
    times, between = output_times(exp, params)
    if exp.excitation == "release":
        return release_problem(model_at, exp, params, times, time_step, plans)._replace(between=between)
    if exp.poses:
        return poses_problem(model_at, exp, params)
    plan = actuation_steps(m, exp, params, times, time_step, plans) if drive is None else drive
    before = loads_before(m, exp.forces, exp.base, float(times[0]), float(exp.time[0]))
    if rest is None:
        start = exp.start.state(model_at, exp, params, plan.initial, before, plans)
    else:
        start = StartState(mechanics_of(m).coordinates(rest), np.zeros(mechanics_of(m).size))
    numbers = forward_numbers(model_at, exp, params, plan, (start.x, start.x), (m.base_angle, m.base_angle))
    numbers = numbers._replace(chambers=model_at.chambers(plan.initial), rate=start.rate)
    numbers = with_loads(numbers, m, exp, float(times[0]), before, params.get("latency", 0.0))
    acting = plan.pressure if between is None else plan.pressure[between[1]]
    forward = ForwardProblem(
        numbers, plan.keep, 1, carriers(model_at, exp), m, acting, exp.start.from_rest, drive=plan, between=between,
        first_seen=exp.first_places if exp.own_places else None, oriented=exp.framed,
    )
    return forward._replace(numbers=reattached(forward, numbers))


def poses_problem(model_at: ModelAt, exp: Experiment, params: Mapping[str, float]) -> ForwardProblem:
    """Return the simulation inputs of a recording of settled poses: the torques of each pose, without time steps."""
    model, plan, size = model_at.model, pose_inputs(model_at, exp), mechanics_of(model_at.model).size
    still = np.zeros(size), np.zeros(size)
    numbers = forward_numbers(model_at, exp, params, plan, still, (model.base_angle, model.base_angle))
    return ForwardProblem(numbers, plan.keep, 0, carriers(model_at, exp), model, plan.pressure, from_rest=False,
                 poses=True, settled=model_at.poses.setdefault(exp.name, []), oriented=exp.framed)  # fmt: skip


def output_times(exp: Experiment, params: Mapping[str, float]) -> tuple[Array, tuple[Array, Array] | None]:
    """Return the times [s] at which a simulation outputs rows. Without sensor lag these are the frame times, less any
    ``latency``, and the second value is None. With a lag, times between the frames are added, and the second value is
    the pair of all times and the indices of the frames among them.
    """
    times = exp.time - params.get("latency", 0.0)
    between = between_frames(times) if lags_of(params, exp.stations).size else None
    return times if between is None else between[0], between


def release_problem(
    model_at: ModelAt, exp: Experiment, params: Mapping[str, float], times: Array, time_step: float, plans: Plans,
) -> ForwardProblem:
    """Return the simulation inputs of a body that is held and then let go. At the release its base may turn by the
    angle ``base_turn``.
    """
    model = model_at.model
    base = (model.base_angle, model.base_angle + params.get("base_turn", 0.0))
    angles = mechanics_of(model).coordinates(held_angles(model_at, exp, params, plans))
    free = times[times > params["release"]]
    plan = no_drive(model)
    if free.size:
        key = ("release", exp.name, params["release"], times[0])
        if key not in plans.drives:
            still_air = [Pulse(0.0)] * model.actuation.count
            steps = drive_of(model, still_air, np.concatenate([[params["release"]], free]), time_step)
            plans.drives[key] = evenly_begun(steps)
        plan = plans.drives[key]
    numbers = forward_numbers(model_at, exp, params, plan, (angles, angles), base)
    numbers = with_loads(numbers, model, exp, params["release"])
    still, no_input = times.size - free.size, np.zeros((exp.time.size, model.actuation.count))
    forward = ForwardProblem(numbers, plan.keep, still, carriers(model_at, exp), model, no_input, from_rest=False,
                             pulled=exp.held is not None)
    return with_release_time(forward, exp, params) if "release_time" in params else forward


def evenly_begun(plan: Drive) -> Drive:
    """Return the steps of a release in still air with as many steps before the first frame as between frames.

    Without this change, the number of steps before the first frame would jump with the time of the release, and the
    error of the integration with it, so that a fit would end at such a time.
    """
    ends = np.flatnonzero(plan.keep >= 0)
    first = ends[0] + 1
    parts = max(int(np.diff(ends).max(initial=0)), first)
    h = np.concatenate([np.full(parts, plan.h[:first].sum() / parts), plan.h[first:]])
    torque = np.concatenate([np.repeat(plan.torque[:1], parts, axis=0), plan.torque[first:]])
    return plan._replace(h=h, torque=torque, keep=np.append(np.full(parts - 1, -1), plan.keep[ends[0] :]))


def with_release_time(forward: ForwardProblem, exp: Experiment, params: Mapping[str, float]) -> ForwardProblem:
    """Return the simulation inputs of a release with holding torques that fall to 0 within ``release_time`` [s].

    The torques fall along half a cosine. They enter as one more chamber, whose gains (n,) are the initial torques and
    whose torque is the fraction that remains.
    """
    numbers, length = forward.numbers, params["release_time"]
    nodes = np.minimum(np.append(0.0, np.cumsum(numbers.h)), length)
    impulse = 0.5 * nodes
    if length > 0:
        impulse += length / (2.0 * np.pi) * np.sin(np.pi * nodes / length)
    fraction = np.diff(impulse) / numbers.h
    loads = loads_at(forward.model, exp.forces, params["release"])
    gain = np.vstack([numbers.gain, holding_torques(forward, loads)])
    return forward._replace(numbers=numbers._replace(torque=np.column_stack([numbers.torque, fraction]), gain=gain))


def holding_torques(forward: ForwardProblem, loads: Array) -> Array:
    """Return the joint torques [N m] that a hand must apply to hold the body in its initial pose against springs,
    gravity and the link loads `loads`.
    """
    numbers = forward.numbers
    states, laws = initial_hysteresis(forward, numbers, REAL), laws_of(forward.model)
    rows = len(laws)
    slip = numbers.joints.K[:rows] * [slip_part(row, law) for row, law in zip(states, laws, strict=True)]
    chain = mechanics_of(forward.model).with_constants(numbers.body, numbers.joints)
    drive = np.append(-slip, np.zeros(forward.model.size + len(forward.model.actuation.levers) - rows))
    push = chain.static_forces(numbers.phi, drive) + chain.load_forces(numbers.phi, loads)
    return np.asarray(-chain.from_joints.T @ push)


def slip_part(states: Array, law: MemoryLaw) -> float:
    """Return the torque of the slip elements of one coordinate, divided by its stiffness, from its `states`
    (branches,).
    """
    first = len(law.creep_share)
    return float(states[first : first + law.slip_share.size] @ law.slip_share)


def held_angles(model_at: ModelAt, exp: Experiment, params: Mapping[str, float], plans: Plans) -> Array:
    """Return the joint angles [rad] of a body held before its release. If its held pose was measured, they fit the
    measured positions. Otherwise they are in equilibrium under the parameter ``hold_force`` or, without this parameter,
    zero as in the unloaded shape.
    """
    model = model_at.model
    if exp.held is not None:
        chain = chain_of(model, observed_points(model_at, exp))
        return pose_through(chain, exp.held - shift_of(params, exp), plans.poses)
    if "hold_force" in params:
        return equilibrium(model, 0.0, np.array([params["hold_force"], *[0.0] * (exp.dimension - 1)]))
    return np.zeros(model.size)


def held_note(model: Model, exp: Experiment, values: Mapping[str, float]) -> str:
    """Return a sentence on the stations of an experiment that were held beyond the reach of the body at parameter
    `values`; '' if there is none.
    """
    if exp.held is None:
        return ""
    params = {**for_record(values, exp.name), **exp.known}
    model_at = Plans().at(model, params)
    beyond = beyond_reach(model_at.model, observed_points(model_at, exp), exp.held - shift_of(params, exp))
    if not beyond:
        return ""
    listed = ", ".join(f"{name} by {1e3 * distance:.2g} mm" for name, distance in beyond.items())
    return (f"Experiment {exp.name}: before its release the body is held beyond its reach, {listed}: check the length, "
            "the base, and the positions of the stations on the body.")


def no_drive(model: Model) -> Drive:
    """Return an empty `Drive`, for a simulation without time steps."""
    C = model.actuation.count
    return Drive(np.zeros(0), np.zeros((0, C)), model.actuation.columns, np.zeros(0, dtype=int), np.zeros((1, C)),
                 np.zeros(C))  # fmt: skip


def actuation_steps(
    model: Model, exp: Experiment, params: Mapping[str, float], times: Array, time_step: float, plans: Plans,
) -> Drive:
    """Return the time steps and torques with which to simulate an experiment under its inputs. Each of the output
    `times` [s], on the clock of the inputs, is the end of a step.
    """
    start, stop = params.get("start", 0.0), params.get("stop", 0.0)
    dead_times = [c.valve.dead_time for c in model.chambers]
    where = (exp.name, times[0], start, stop, *dead_times)
    key = (where, *(c.key for c in model.chambers))
    if key not in plans.drives:
        if where not in plans.layouts:
            plans.layouts[where] = laid_out(inputs_to(model, exp, start, stop), dead_times, times, time_step)
        plans.drives[key] = driven(model, plans.layouts[where])
    return plans.drives[key]


def forward_numbers(
    model_at: ModelAt, exp: Experiment, params: Mapping[str, float], plan: Drive, angles: tuple[Array, Array],
    base: tuple[float, float],
) -> Numbers:
    """Return all quantities of a simulation that may depend on fitted parameters: initial angles, torques, model
    constants and positions of the observed points.
    """
    model, (along, across, aside) = model_at.model, with_axes(model_at.places(exp.stations), exp.framed)
    lags = lags_of(params, exp.stations)
    return Numbers(
        held=angles[0], held_base=base[0], phi=angles[1], rate=np.zeros(len(angles[1])), h=plan.h, torque=plan.torque,
        gain=np.array(model.actuation.columns), chambers=np.zeros((0, 0)),
        torque_before=model_at.torque_before(plan.initial),
        load=np.zeros((0, *mechanics_of(model).no_loads().shape)), base=np.zeros((0, 5)),
        load_before=loads_at(model, (), 0.0),
        body=model_at.body, joints=model_at.joints._replace(base_angle=base[1]), memory=model_at.memory,
        along=along, across=across, aside=aside, shift=shift_of(params, exp),
        sensor_lag=repeated(lags, exp.framed) if lags.size else lags,
        reference=model.base_angle if exp.angle_reference in ("base", "joint") else 0.0,
        length=model.link_length, base_length=model.base_length, share=model.stretch_share,
    )


def shift_of(params: Mapping[str, float], exp: Experiment) -> Array:
    """Return the offset (2 or 3,) [m] of the recording's frame from the model's: the parameters ``base_x``, ``base_y``
    and, in space, ``base_z``.
    """
    return np.array([params.get(f"base_{axis}", 0.0) for axis in "xyz"[: exp.dimension]])


def reattached(forward: ForwardProblem, numbers: Numbers) -> Numbers:
    """Return simulation inputs in which the markers sit on the body where the first frames of the recording show them.

    Angles, lengths and base are those of `numbers`, which may be complex: no other entry that follows from the rest
    pose may be taken from elsewhere, or `sensitivity` misses its derivative.
    """
    if forward.first_seen is None:
        return numbers
    chain = mechanics_of(forward.model).with_constants(numbers.body, numbers.joints)
    beside = chain.beside_links(numbers.phi, forward.first_seen - numbers.shift, numbers)
    stations = np.arange(len(forward.first_seen))
    along, across, aside = with_axes(beside[stations, forward.carrier[stations] + 1].T, forward.oriented)
    return numbers._replace(along=along, across=across, aside=aside)


def with_loads(
    numbers: Numbers, model: Model, exp: Experiment, first: float, before: Array | None = None, latency: float = 0.0,
) -> Numbers:
    """Return the simulation inputs `numbers` with the link loads of the experiment's known forces, and the motion of
    its base, in each time step. The first step begins at `first` [s] on the clock of the inputs. The poses of the base
    are on that of the frames, which is `latency` [s] late.
    """
    if (not exp.forces and exp.base is None) or not numbers.h.size:
        return numbers
    nodes = first + np.append(0.0, np.cumsum(numbers.h))
    load, base = loads_and_base(model, exp.forces, exp.base, nodes, latency)
    return numbers._replace(load=load, base=base, load_before=numbers.load_before if before is None else before)


def observed_points(model_at: ModelAt, exp: Experiment) -> list[Station]:
    """Return the model's points that the experiment observes, in the order of its stations."""
    return [model_at.points[name] for name in exp.stations]


def carriers(model_at: ModelAt, exp: Experiment) -> Array:
    """Return the index of the link that carries each observed point, (S + 2 m,). The points are S stations, and two
    auxiliary points on axes of each of the m links whose orientation is observed.
    """
    return repeated(np.array([p.link for p in observed_points(model_at, exp)]), exp.framed)
