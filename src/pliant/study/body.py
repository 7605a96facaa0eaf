"""Functions that build the model of a study's actuator from its table [actuator], and estimate the azimuths of tendons
that the table does not state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

import numpy as np

from pliant import actuators
from pliant.errors import InputError
from pliant.identification import Experiment
from pliant.model import Chamber, Extension, Memory, Model, Station, Tendon, Valve, chain_model
from pliant.model.chamber import FIELDS
from pliant.reduction import LinkPlacement
from pliant.study.body_tables import ActuatorEntry, ChamberTable, StationTable, TaperTable, TendonTable
from pliant.study.schema import Study
from pliant.study.tendon_ends import end_of_bend, ends_of_held_tendons

Array = np.ndarray
TURNED = "turned by pi about the base tangent: its x is minus that of the recordings"
PARTS: dict[str, Any] = {"memory": Memory, "valve": Valve}  # tables of [actuator]: records of the model
BESIDE = {"preset", "section_area", "diameter", "stations", "taper", "segments", "segment_links"}  # no parameters
SLICES = 200  # of each segment, for the integrals along it
LEAST_DRAWN = 1e-6  # of the inputs' largest singular value: below it, two tendons were always pulled together


def study_model(
    actuator: ActuatorEntry, rotation: Array | None, links: LinkPlacement | None = None, usual: int | None = None,
    sign: int = 1,
) -> Model:
    """Return the model of the study's actuator, built from the table [actuator] and its preset. If links were placed on
    a recorded shape, the model has their lengths and rest angles.

    Parameters
    ----------
    actuator : ActuatorEntry
    rotation : (3, 3) array or None
        Rotation that takes vectors of the tracker to the base frame.
    links : LinkPlacement, optional
        Links placed on the recorded shape: the chain has their lengths and rest angles, and the mass is distributed by
        length.
    usual : int, optional
        Number of links if neither `links` nor the actuator states one.
    sign : {1, -1}
        Direction of the planar recordings' x axis in the base frame.
    """
    values = actuator.model_dump(exclude_none=True, exclude=BESIDE)
    values["source"] = dict(actuator.source)
    if not values["space"]:
        del values["space"]
    if gravity := values.pop("gravity", None):
        size = 3 if actuator.space else 2
        values["gravity"] = in_base_frame(np.array(gravity, dtype=float), rotation, sign, size)
    if sign < 0:
        values["source"]["base_frame"] = TURNED
    if actuator.preset:
        defaults = dict(preset(actuator.preset).BODY)
        values = {**defaults, **values, "source": {**defaults.get("source", {}), **values["source"]}}
    chambers = [ChamberTable(**c) for c in values.pop("chambers")]
    tendons = [TendonTable(**c) for c in values.pop("tendons")]
    values["extensions"] = tuple(Extension(**e) for e in values.pop("extensions"))
    values |= {name: part(**values[name]) for name, part in PARTS.items() if isinstance(values.get(name), dict)}
    if actuator.taper:
        values |= tapered(actuator, values["extensions"])
    missing = [k for k in ("length", "mass") if k not in values]
    if missing:
        raise InputError(f"[actuator] needs {' and '.join(missing)} (SI), or a preset: {', '.join(presets())}")
    if usual is not None:
        values.setdefault("links", usual)
    values.setdefault("stiffness", 1.0)
    values.setdefault("damping", 1e-3)
    if chambers or tendons:
        for name in FIELDS:
            values.pop(name, None)  # of the preset's single chamber
        joints = values.setdefault("links", 5) if links is None else links.n
        drawn = tuple(tendon_of(entry, joints, values["length"], actuator.parts(joints)) for entry in tendons)
        values["chambers"] = named_chambers(chambers, joints, space=bool(actuator.space)) + drawn
    else:
        values.setdefault("torque", [0.0])
    return with_masses_and_stations(chain_of(values, actuator), actuator) if links is None else \
        measured_chain(values, links)


def chain_of(values: dict[str, Any], actuator: ActuatorEntry) -> Model:
    """Return the chain of equal parts with the arguments `values` of `chain_model`, or of the parts of an actuator
    whose segments differ. Joints are at the base of each part, or in its middle.
    """
    model = chain_model(**values)
    parts = actuator.parts(model.n)
    if parts is None:
        return model
    before, length = values.get("base_length", 0.0), parts
    if values.get("joint_placement") == "midsegment":
        before, length = before + 0.5 * parts[0], 0.5 * (parts + np.append(parts[1:], 0.0))
    return model.with_(link_length=length, link_mass=values["mass"] / parts.sum() * length, base_length=before)


def named_chambers(entries: Sequence[ChamberTable], joints: int, *, space: bool = False) -> tuple[Chamber, ...]:
    """Return the chambers that the tables of a study describe, as `Chamber` objects of an actuator with `joints`
    joints. In space, a chamber without a stated azimuth lies at 90 degrees.

    A chamber at 90 degrees bends the body about +x, as a chamber of a planar body does.
    """
    chambers = []
    for entry in entries:
        turned = joints_of(entry, joints)
        if isinstance(entry.joint_gain, list) and len(entry.joint_gain) != len(turned):
            raise InputError(
                f"chamber {entry.name}: joint_gain must be one number or one for each of its {len(turned)} joints, got "
                f"{len(entry.joint_gain)}"
            )
        gain = np.zeros(joints)
        gain[np.array(turned) - 1] = entry.joint_gain
        if entry.azimuth_deg is not None and not space:
            raise InputError(f"chamber {entry.name}: azimuth_deg needs a body in space: set space = true in [actuator]")
        azimuth = np.radians(90.0 if entry.azimuth_deg is None else entry.azimuth_deg)
        turns = {"joint_gain": np.sin(azimuth) * gain, "cross_gain": -np.cos(azimuth) * gain} if space else {
            "joint_gain": gain}  # fmt: skip
        values = entry.model_dump(exclude={"joints", "azimuth_deg", "joint_gain"})
        chambers.append(Chamber(**{**values, **turns, "valve": Valve(**values["valve"])}))
    return tuple(chambers)


def joints_of(entry: ChamberTable | TendonTable, joints: int) -> list[int]:
    """Return the numbers (from 1) of the joints on which a chamber or tendon acts; all joints if its table
    states none.
    """
    turned = list(range(1, joints + 1)) if entry.joints is None else entry.joints
    if strange := [j for j in turned if not 1 <= j <= joints]:
        what = "tendon" if isinstance(entry, TendonTable) else "chamber"
        raise InputError(f"{what} {entry.name} acts on joint {strange[0]}, but the chain has joints 1 to {joints}: "
                         "correct its joints, or links in [actuator]")
    return turned


def tendon_of(entry: TendonTable, joints: int, length: float, parts: Array | None = None) -> Tendon:
    """Return the `Tendon` that a table of the study describes, on a chain of `length` [m] with `joints` joints, whose
    parts have the lengths `parts` (joints,) [m]; default: equal ones.
    """
    if entry.azimuth_deg is None:
        raise InputError(f"tendon {entry.name}: state azimuth_deg; it can only be estimated in a study with recordings")
    passed, lever_positions = passed_joints(entry, length, joints, parts)
    passed = np.isin(np.arange(1, joints + 1), joints_of(entry, joints)) * passed
    crossing = entry.lever / entry.taper if entry.taper > 0 else np.inf
    if crossing <= (last := lever_positions[passed > 0].max(initial=0.0)):
        raise InputError(
            f"tendon {entry.name}: with this lever and taper it reaches the axis at {crossing:.3g} m, before the last "
            f"joint that it bends (at {last:.3g} m): correct lever, taper or stop"
        )
    values = entry.model_dump(exclude={"joints", "azimuth_deg", "stop"}) | {"at": lever_positions}
    values["valve"] = Valve(**values["valve"])
    if entry.driven_by == "tension":
        values["line_stiffness"] = 0.0
    return Tendon.at_azimuth(np.radians(entry.azimuth_deg), passed, **values)


def measured_chain(values: dict[str, Any], links: LinkPlacement) -> Model:
    """Return a model whose links have the lengths and rest angles of links placed on a measured shape. Its observed
    points are the link tips.
    """
    turns: dict[str, Any] = {"rest_angle": links.rest_angle}
    if len(links.base) == 3:
        space = values.get("space")
        turned = np.pad(links.rest_angle.reshape(links.n, 2), ((0, 0), (0, 1)))
        turns = {"space": {**(space if isinstance(space, dict) else {}), "rest_turn": turned}}
    for key in ("length", "links", "joint_placement"):
        values.pop(key, None)
    lengths, before = links.link_length, float(links.node_arc_length[0])  # the part before the first joint is rigid
    values["source"] |= dict.fromkeys(("link_length", *turns), "chords of the recorded rest shape")
    mass = values.pop("mass") * lengths / (lengths.sum() + before)
    model = Model(**{**values, "link_length": lengths, "link_mass": mass, "base_length": before, **turns})  # fmt: skip
    return model.with_(stations=model.points)


def in_base_frame(gravity: Array, rotation: Array | None, sign: int, dimension: int = 2) -> Array:
    """Return the gravity that a study states as a vector [m/s^2] in the base frame: (2,) for a planar body, (3,) in
    space.

    Three numbers are in the tracker's frame. Two numbers are in the base frame, with their x multiplied by `sign`. For
    a body in space without an alignment, three numbers are in the base frame.
    """
    if dimension == 3:
        if gravity.shape != (3,):
            raise InputError(f"gravity of a body in space needs (x, y, z) of the tracker, got {gravity.size} numbers")
        return gravity if rotation is None else rotation @ gravity
    if gravity.shape == (2,):
        return gravity * [sign, 1.0]
    if gravity.shape != (3,):
        raise InputError(f"gravity is (x, y) of the base frame or (x, y, z) of the tracker, got {gravity.size} numbers")
    if rotation is None:
        raise InputError("gravity (x, y, z) needs a recording in the tracker's frame; state (x, y) instead")
    turned = rotation @ gravity
    return np.asarray(turned[:2])


def presets() -> list[str]:
    """Return the names of the actuator presets in `pliant.actuators`."""
    return [m.name for m in iter_modules(actuators.__path__)]


def preset(name: str) -> Any:
    """Return the module of the actuator preset `name`. Its constant BODY is a dict of arguments for `chain_model`."""
    if name not in presets():
        raise InputError(f"unknown actuator preset {name!r}: use one of {', '.join(presets())}")
    return import_module(f"pliant.actuators.{name}")


def slices(length: float, joints: int) -> tuple[Array, float]:
    """Divide the segment of each joint into thin slices of equal thickness. Return their midpoints (joints, SLICES) [m
    from the base] and the thickness [m].
    """
    thin = length / (joints * SLICES)
    return (thin * (np.arange(joints * SLICES) + 0.5)).reshape(joints, SLICES), thin


def checked_radius(taper: TaperTable, length: float) -> None:
    """Raise InputError unless there is one radius for each position, and the positions increase from the base (0) to
    the tip.
    """
    arcs = np.array(taper.at)
    if arcs.size != len(taper.radius) or (np.diff(arcs) <= 0).any() or arcs[0] > 0 or arcs[-1] < length * (1 - 1e-9):
        raise InputError(
            "[actuator.taper] needs one radius for each position in at, increasing from 0 to the length of the body "
            f"({length:g} m)"
        )


def tapered_masses(taper: TaperTable, length: float, link_length: Array) -> Array:
    """Return the masses (n,) [kg] of the n links of a tapered body. The part before the first joint is left out, since
    it does not move.
    """
    ends = length - np.append(np.cumsum(link_length[::-1])[::-1], 0.0)
    s, thin = slices(length, link_length.size)
    section = taper.density * np.pi * np.interp(s, taper.at, taper.radius).ravel() ** 2
    return np.histogram(s.ravel(), ends, weights=thin * section)[0]


def passed_joints(
    entry: TendonTable, length: float, joints: int, parts: Array | None = None,
) -> tuple[Array, Array]:
    """Return the fraction (joints,) of each joint's segment along which a tendon runs, and the middle (joints,) [m from
    the base] of this part. The segments have the lengths `parts` (joints,) [m]; default: equal ones.

    For a segment beyond the end of the tendon, the fraction is 0 and the middle is that of the segment.
    """
    stop = length if entry.stop is None else entry.stop
    edges = length * np.arange(joints + 1) / joints if parts is None else np.append(0.0, np.cumsum(parts))
    part = np.clip((stop - edges[:-1]) / np.diff(edges), 0.0, 1.0)
    end = np.where(part > 0, edges[:-1] + part * np.diff(edges), edges[1:])
    return part, 0.5 * (edges[:-1] + end)


def stations_of(entries: Sequence[StationTable], length: float, link_length: Array) -> tuple[Station, ...]:
    """Return the observed points of a body, each on the link that contains its position along the body."""
    joints = length - np.cumsum(link_length[::-1])[::-1]
    stations = []
    for entry in entries:
        if not 0 <= entry.at <= length * (1 + 1e-9):
            raise InputError(f"station {entry.name}: at must be between 0 and the length of the body ({length:g} m)")
        link = int(np.searchsorted(joints, entry.at, side="right")) - 1
        before = 0.0 if link < 0 else float(joints[link])
        stations.append(Station(entry.name, link, entry.at + entry.along - before, entry.across, entry.aside))
    return tuple(stations)


def tapered(actuator: ActuatorEntry, segments: Sequence[Extension]) -> dict[str, Any]:
    """Return the stiffness, mass and extensible segments of an actuator whose radius changes along it.

    The stiffness of a joint [N m/rad] is 1 / integral of 1 / (E I) over its equal segment. The axial stiffness of an
    extensible segment [N] is its length / integral of 1 / (E A). The masses of the single links are set later, by
    `with_masses_and_stations`.
    """
    taper, length, links = actuator.taper, actuator.length, actuator.links
    if taper is None or length is None or links is None or actuator.stiffness or actuator.mass:
        raise InputError("[actuator.taper] needs length and links in [actuator], and replaces stiffness and mass: "
                         "state length and links, and remove stiffness and mass")
    checked_radius(taper, length)
    s, thin = slices(length, links)
    radius = np.interp(s, taper.at, taper.radius)
    bending, axial = taper.modulus * np.pi / 4 * radius**4, taper.modulus * np.pi * radius**2
    stretched = []
    for e in segments:
        soft = float(np.sum(thin / axial[(s > e.start) & (s < e.end(length))]))
        stretched.append(replace(e, stiffness=(e.end(length) - e.start) / soft))
    mass = float(tapered_masses(taper, length, np.full(links, length / links)).sum())
    return {"stiffness": 1.0 / np.sum(thin / bending, axis=1), "mass": mass, "extensions": tuple(stretched)}


def with_masses_and_stations(model: Model, actuator: ActuatorEntry) -> Model:
    """Return the model with the link masses of a tapered body, and with the stations that its study states."""
    changes: dict[str, Any] = {}
    if actuator.taper:
        changes["link_mass"] = tapered_masses(actuator.taper, model.length, model.link_length)
    if actuator.stations:
        changes["stations"] = stations_of(actuator.stations, model.length, model.link_length)
    return model.with_(**changes) if changes else model


def training(study: Study) -> list[str]:
    """Return the names of the study's training recordings, without duplicates, in order."""
    names = [name for entry in study.fits.values() for name in entry.train]
    names += study.model_selection.train if study.model_selection else []
    return list(dict.fromkeys(names))


def reduced_recording(study: Study) -> str:
    """Return the name of the recording whose shape determines the links: the stated one, or the first of training."""
    stated = study.reduction.recording if study.reduction else None
    return stated or next(iter(training(study) or study.recordings))


def with_azimuths(
    study: Study, experiments: Mapping[str, Experiment], notify: Callable[[str], None],
) -> ActuatorEntry:
    """Return the study's actuator with every missing `azimuth_deg`, and the end of these tendons, estimated from the
    training recordings.

    A tendon bends the body towards itself. The motion of the tip across the base tangent is modelled as a sum of one
    motion for each tendon, proportional to its input, by least squares over the training recordings. The direction of
    each motion is the azimuth of the tendon. Fits of gain_x and gain_y start from these azimuths. If several stations
    are tracked, a tendon without stated joints or end ends where `end_of_bend` finds it or, if lengths of all tendons
    are the inputs, `ends_of_held_tendons`.

    Raises
    ------
    InputError
        When the recordings do not determine the motion of each tendon, since some were always pulled together.
    """
    tendons = study.actuator.tendons
    unknown = [t.name for t in tendons if t.azimuth_deg is None]
    if not unknown:
        return study.actuator
    names = [t.name for t in tendons]
    recordings = [experiments[n] for n in training(study) if n in experiments]
    moves = station_moves(recordings, names)
    pulled, ends = all(t.driven_by != "tension" for t in tendons), list[tuple[float, float]]()
    if moves.shape[1] > 1:
        heights = rest_heights(recordings)
        ends = (ends_of_held_tendons(moves, heights, [stated_end(study.actuator, t) for t in tendons]) if pulled
                else [end_of_bend(gain, heights) for gain in moves])
    stated, measured = [], []
    for k, tendon in enumerate(tendons):
        if tendon.name not in unknown:
            stated.append(tendon)
            continue
        azimuth = float(np.degrees(np.arctan2(moves[k, -1, 1], moves[k, -1, 0])) % 360.0)
        entries: dict[str, Any] = {"azimuth_deg": ends[k][0] if ends and pulled else azimuth}
        if ends and tendon.joints is None and tendon.stop is None and ends[k][1] < max(end for _, end in ends):
            entries = {"azimuth_deg": ends[k][0], "stop": ends[k][1]}
        stated.append(tendon.model_copy(update=entries))
        measured.append(f"{tendon.name} {entries['azimuth_deg']:.0f} deg"
                     + (f" up to {1e3 * entries['stop']:.0f} mm" if "stop" in entries else ""))
    notify("estimated azimuths of the inputs: " + ", ".join(measured))
    return study.actuator.model_copy(update={"tendons": stated})


def stated_end(actuator: ActuatorEntry, tendon: TendonTable) -> float | None:
    """Return the height [m] at which a study says that a tendon ends; None if it does not."""
    if tendon.stop is not None or not tendon.joints:
        return tendon.stop
    if actuator.segments and actuator.segment_links:
        parts = actuator.parts(sum(actuator.segment_links))
        return None if parts is None else float(np.cumsum(parts)[min(max(tendon.joints), parts.size) - 1])
    if actuator.length and actuator.links:
        return actuator.length * max(tendon.joints) / actuator.links
    return None


def rest_heights(experiments: Sequence[Experiment]) -> Array:
    """Return the largest height (S,) [m] along the base tangent at which each of S stations is seen: that on the
    straight body.
    """
    return np.asarray(np.nanmax(np.concatenate([e.position[..., 2] for e in experiments]), axis=0))


def tip_moves(experiments: Sequence[Experiment], names: Sequence[str]) -> Array:
    """Return the displacement of the last station per unit of each of C inputs, (C, 2) [m per unit], by least squares.
    Its two components are perpendicular to the base tangent.
    """
    return moves_of(experiments, names, [e.last_station[:, :2] for e in experiments])


def station_moves(experiments: Sequence[Experiment], names: Sequence[str]) -> Array:
    """Return the displacement of S stations per unit of each of C inputs, (C, S, 2) [m per unit], as `tip_moves` does.
    If the recordings have different stations, S is 1: the last.
    """
    stations = {e.stations for e in experiments}
    if len(stations) != 1:
        return tip_moves(experiments, names)[:, None]
    count = len(stations.pop())
    moves = [moves_of(experiments, names, [e.position[:, s, :2] for e in experiments]) for s in range(count)]
    return np.stack(moves, axis=1)


def moves_of(experiments: Sequence[Experiment], names: Sequence[str], places: Sequence[Array]) -> Array:
    """Return the displacement of a point per unit of each of C inputs, (C, 2) [m per unit], from its places (T, 2) [m]
    in each experiment.

    Raises
    ------
    InputError
        When some inputs were always pulled together.
    """
    inputs, moves = [], []
    for exp, position in zip(experiments, places, strict=True):
        measured = np.isfinite(position).all(axis=1)
        drawn = np.stack([exp.drives[n](exp.time) if n in exp.drives else 0.0 * exp.time for n in names], axis=1)
        inputs.append(drawn[measured] - drawn[measured].mean(axis=0))
        moves.append(position[measured] - position[measured].mean(axis=0))
    drawn = np.concatenate(inputs) if inputs else np.zeros((0, len(names)))
    gains, _, rank, _ = np.linalg.lstsq(drawn, np.concatenate(moves or [np.zeros((0, 2))]), rcond=LEAST_DRAWN)
    if rank < len(names):
        raise InputError(
            f"the azimuths of the tendons {', '.join(names)} cannot be estimated, since no training recordings pull "
            "each of them separately: state azimuth_deg of each"
        )
    return np.asarray(gains)
