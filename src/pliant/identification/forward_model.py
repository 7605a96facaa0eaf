"""Set-up of the forward problem of a fit: the arrays on which the compiled loops run, from model and experiment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pliant.identification.drives import inputs_to
from pliant.identification.following import REAL, slipped
from pliant.identification.loop_inputs import Numbers, SetUp
from pliant.identification.orientation import repeated, with_axes
from pliant.identification.parameters import for_record
from pliant.identification.plans import ModelAt, Plans
from pliant.identification.pose import posed
from pliant.identification.poses import inputs_of
from pliant.identification.sensor import between_frames, lags_of
from pliant.mechanics import mechanics_of
from pliant.model import Model, Station, fixed_length
from pliant.simulation import Pulse, equilibrium
from pliant.simulation.drive import Drive, driven, laid_out
from pliant.simulation.drive import drive as drive_of
from pliant.simulation.forces import loads_at, mean_loads

if TYPE_CHECKING:
    from pliant.identification.experiment import Experiment

Array = np.ndarray


def set_up(
    model: Model, exp: Experiment, values: Mapping[str, float], step: float,
    plans: Plans | None = None, rest: Array | None = None, drive: Drive | None = None,
) -> SetUp:
    """Return the forward problem of an experiment at the parameter `values`: initial state, steps, torques and points.

    Parameters
    ----------
    step : float
        Integration step, s.
    plans : Plans, optional
        Cache of intermediate results, shared between calls for the same model.
    rest : array (n,), optional
        Known joint angles at the start, which spare a search for the equilibrium.
    drive : Drive, optional
        Precomputed steps and torques, used in place of those that follow from `values`. Not for a release.
    """
    own = {**for_record(values, exp.name), **exp.known}
    plans = Plans() if plans is None else plans
    here = plans.at(model, own)
    m = here.model
    times, between = moments(exp, own)
    if exp.excitation == "release":
        return let_go(here, exp, own, times, step, plans)._replace(between=between)
    if exp.poses:
        return of_poses(here, exp, own)
    plan = planned(m, exp, own, times, step, plans) if drive is None else drive
    before = loads_at(m, exp.forces, float(times[0])) if exp.forces else None
    if rest is None and before is not None:
        rest = equilibrium(m, plan.initial, link_load=before)
    start = here.at_rest(plan.initial) if rest is None else mechanics_of(m).coordinates(rest)
    numbers = gathered(here, exp, own, plan, (start, start), (m.base_angle, m.base_angle))
    numbers = numbers._replace(chambers=here.chambers(plan.initial))
    numbers = with_loads(numbers, m, exp, float(times[0]), before)
    acting = plan.pressure if between is None else plan.pressure[between[1]]
    made = SetUp(numbers, plan.keep, 1, carriers(here, exp), m, acting, True, drive=plan, between=between,
                 first_seen=exp.first_places if exp.own_places else None, oriented=exp.oriented)  # fmt: skip
    return made._replace(numbers=reattached(made, numbers))


def of_poses(here: ModelAt, exp: Experiment, own: Mapping[str, float]) -> SetUp:
    """Return the forward problem of settled poses: no time steps, but the torques at each row's equilibrium."""
    model, plan, size = here.model, inputs_of(here.model, exp), mechanics_of(here.model).size
    still = np.zeros(size), np.zeros(size)
    numbers = gathered(here, exp, own, plan, still, (model.base_angle, model.base_angle))
    return SetUp(numbers, plan.keep, 0, carriers(here, exp), model, plan.pressure, from_rest=False,
                 poses=True, oriented=exp.oriented)  # fmt: skip


def moments(exp: Experiment, own: Mapping[str, float]) -> tuple[Array, tuple[Array, Array] | None]:
    """Return the output times [s] on the pressure's clock; with a sensor lag, finer times and the frames' indices."""
    times = exp.time - own.get("latency", 0.0)
    between = between_frames(times) if lags_of(own, exp.stations).size else None
    return times if between is None else between[0], between


def let_go(
    here: ModelAt, exp: Experiment, own: Mapping[str, float], times: Array, step: float, plans: Plans,
) -> SetUp:
    """Return the forward problem of a body that is held, then let go, while the base may turn by ``base_turn``."""
    model = here.model
    base = (model.base_angle, model.base_angle + own.get("base_turn", 0.0))
    angles = mechanics_of(model).coordinates(held_angles(here, exp, own, plans))
    free = times[times > own["release"]]
    plan = no_drive(model)
    if free.size:
        key = ("release", exp.name, own["release"], times[0])
        if key not in plans.drives:
            still_air = [Pulse(0.0)] * model.actuation.count
            plans.drives[key] = drive_of(model, still_air, np.concatenate([[own["release"]], free]), step)
        plan = plans.drives[key]
    numbers = with_loads(gathered(here, exp, own, plan, (angles, angles), base), model, exp, own["release"])
    still, none = times.size - free.size, np.zeros((exp.time.size, model.actuation.count))
    made = SetUp(numbers, plan.keep, still, carriers(here, exp), model, none, from_rest=False,
                 pulled=exp.held is not None)
    return fading(made, exp, own) if "release_time" in own else made


def fading(made: SetUp, exp: Experiment, own: Mapping[str, float]) -> SetUp:
    """Return the forward problem of a release with holding torques that fall to 0 within ``release_time``.

    The torques fall along half a cosine. They enter as one more chamber, whose gains (n,) are the initial torques and
    whose torque is the fraction that remains.
    """
    numbers, length = made.numbers, own["release_time"]
    nodes = np.minimum(np.append(0.0, np.cumsum(numbers.h)), length)
    impulse = 0.5 * nodes
    if length > 0:
        impulse += length / (2.0 * np.pi) * np.sin(np.pi * nodes / length)
    share = np.diff(impulse) / numbers.h
    loads = loads_at(made.model, exp.forces, own["release"])
    gain = np.vstack([numbers.gain, holding_torques(made, loads)])
    return made._replace(numbers=numbers._replace(torque=np.column_stack([numbers.torque, share]), gain=gain))


def holding_torques(made: SetUp, loads: Array) -> Array:
    """Return the joint torques (n,) [N m] that hold the body at rest in its initial pose, against link `loads`."""
    numbers = made.numbers
    stretched = slipped(made, numbers, REAL)[:, len(numbers.memory.creep_time) :]
    rows, share = len(stretched), numbers.memory.slip_share
    own = numbers.joints.K[:rows] * (stretched[:, : share.size] @ share)
    chain = mechanics_of(made.model).with_constants(numbers.body, numbers.joints)
    drive = np.append(-own, np.zeros(made.model.size + len(made.model.actuation.levers) - rows))
    push = chain.static_forces(numbers.phi, drive) + chain.load_forces(numbers.phi, loads)
    return np.asarray(-chain.from_joints.T @ push)


def held_angles(here: ModelAt, exp: Experiment, own: Mapping[str, float], plans: Plans) -> Array:
    """Return the joint angles (n,) of the held body: from measured positions, under ``hold_force``, or unloaded."""
    model = here.model
    if exp.held is not None:
        if not model.space:
            fixed_length(
                model, f"experiment {exp.name}: a measured held pose needs a body of fixed length, but the model "
                f"{model.name!r} is extensible: leave out held (as measured), or the model's extensions",
            )
        return posed(model, observed(here, exp), exp.held - shift_of(own, exp), plans.poses)
    if "hold_force" in own:
        return equilibrium(model, 0.0, np.array([own["hold_force"], *[0.0] * (exp.dimension - 1)]))
    return np.zeros(model.size)


def no_drive(model: Model) -> Drive:
    """Return a `Drive` without time steps."""
    C = model.actuation.count
    return Drive(np.zeros(0), np.zeros((0, C)), model.actuation.columns, np.zeros(0, dtype=int), np.zeros((1, C)),
                 np.zeros(C))  # fmt: skip


def planned(
    model: Model, exp: Experiment, own: Mapping[str, float], times: Array, step: float, plans: Plans,
) -> Drive:
    """Return the time steps and torques under the experiment's pressure, for frames at `times` [s] on its clock."""
    start, stop = own.get("start", 0.0), own.get("stop", 0.0)
    dead_times = [c.valve.dead_time for c in model.chambers]
    where = (exp.name, times[0], start, stop, *dead_times)
    key = (where, *(c.key for c in model.chambers))
    if key not in plans.drives:
        if where not in plans.layouts:
            plans.layouts[where] = laid_out(inputs_to(model, exp, start, stop), dead_times, times, step)
        plans.drives[key] = driven(model, plans.layouts[where])
    return plans.drives[key]


def gathered(
    here: ModelAt, exp: Experiment, own: Mapping[str, float], plan: Drive, angles: tuple[Array, Array],
    base: tuple[float, float],
) -> Numbers:
    """Return the `Numbers` of a forward problem, with angles and base angle while held and at the start of motion."""
    model, (along, across, aside) = here.model, with_axes(here.places(exp.stations), exp.oriented)
    lags = lags_of(own, exp.stations)
    return Numbers(
        held=angles[0], held_base=base[0], phi=angles[1], h=plan.h, torque=plan.torque,
        gain=np.array(model.actuation.columns), chambers=np.zeros((0, 0)),
        torque_before=here.torque_before(plan.initial),
        load=np.zeros((0, *mechanics_of(model).no_loads().shape)), load_before=loads_at(model, (), 0.0), body=here.body,
        joints=here.joints._replace(base_angle=base[1]), memory=here.memory,
        along=along, across=across, aside=aside, shift=shift_of(own, exp),
        sensor_lag=repeated(lags, exp.oriented) if lags.size else lags,
        reference=model.base_angle if exp.angle_reference in ("base", "joint") else 0.0,
        length=model.link_length, base_length=model.base_length, share=model.stretch_share,
    )


def shift_of(own: Mapping[str, float], exp: Experiment) -> Array:
    """Return the offset (d,) [m] of the recording's frame: the parameters ``base_x``, ``base_y`` and ``base_z``."""
    return np.array([own.get(f"base_{axis}", 0.0) for axis in "xyz"[: exp.dimension]])


def reattached(made: SetUp, numbers: Numbers) -> Numbers:
    """Return the numbers with the markers attached where the first frames show them, for an experiment with own_places.

    Angles, lengths and base are those of `numbers`, which may be complex: no other entry that follows from the rest
    pose may be taken from elsewhere, or `sensitivity` misses its derivative.
    """
    if made.first_seen is None:
        return numbers
    chain = mechanics_of(made.model).with_constants(numbers.body, numbers.joints)
    beside = chain.beside_links(numbers.phi, made.first_seen - numbers.shift, numbers)
    stations = np.arange(len(made.first_seen))
    along, across, aside = with_axes(beside[stations, made.carrier[stations] + 1].T, made.oriented)
    return numbers._replace(along=along, across=across, aside=aside)


def with_loads(numbers: Numbers, model: Model, exp: Experiment, first: float, before: Array | None = None) -> Numbers:
    """Return the numbers with the loads of the experiment's known forces; the steps begin at the time `first` [s]."""
    if not exp.forces or not numbers.h.size:
        return numbers
    nodes = first + np.append(0.0, np.cumsum(numbers.h))
    loads = mean_loads(model, exp.forces, nodes)
    return numbers._replace(load=loads, load_before=numbers.load_before if before is None else before)


def observed(here: ModelAt, exp: Experiment) -> list[Station]:
    """Return the points of the model that the experiment observes, in the order of its stations."""
    return [here.points[name] for name in exp.stations]


def carriers(here: ModelAt, exp: Experiment) -> Array:
    """Return the link index (S + 2 m,) of each observed point and of the axis points of the m oriented stations."""
    return repeated(np.array([p.link for p in observed(here, exp)]), exp.oriented)
