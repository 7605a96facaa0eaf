"""Preparation of a study: read and align its recordings, and build the model and the experiments from its entries."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pliant.errors import InputError
from pliant.identification import Experiment, experiment
from pliant.model import Chamber, Extension, Model, Tendon, chain_model
from pliant.preprocessing.align import DENSE_STATIONS, align, alignment_of
from pliant.preprocessing.angles import from_rest
from pliant.preprocessing.clusters import assemble
from pliant.preprocessing.cut import cut_time
from pliant.preprocessing.held import leave_out_frozen, lines_between_changes
from pliant.preprocessing.labels import exclude_swaps, undo_swaps
from pliant.preprocessing.plausibility.pressure import LEAST_PRESSURE
from pliant.preprocessing.quality import quality, standing_stations
from pliant.preprocessing.side import ATTRIBUTE, half_turn, planar_side, x_sign
from pliant.recording import read
from pliant.recording.published import PREFIX
from pliant.reduction import LinkPlacement
from pliant.sensing import read_shape
from pliant.study.channels import inputs_in_words
from pliant.study.clocks import on_one_clock, with_pressure
from pliant.study.dense import body_of_fibre
from pliant.study.doubts import of_body, preset, presets, stated_case, units_first
from pliant.study.resting import Aligned, at_one_rest
from pliant.study.schema import ActuatorEntry, AlignmentEntry, ChamberTable, Recording, Study, TendonTable
from pliant.study.tapered import fitted_out, passed_joints, tapered
from pliant.units import pascal_per

Array = np.ndarray
LEAST_TURN = 0.02  # rad: least rotation, for a recording of angles alone
TURNED = "turned by pi about the base tangent: its x is minus that of the recordings"
LEAST_TRAVEL = 0.003  # of the body's length: least motion of the tip in a usable recording


def load_recording(study: Study, name: str) -> xr.Dataset:
    """Read one recording of the study, with its pressure log and its nominal pressure if the study states them."""
    entry = study.recordings[name]
    path = located(study, entry.file)
    mapping = {**seen_by(study, entry.file), **study.mapping, **(entry.mapping or {})}
    recording = read_shape(path, mapping or None, format=entry.format)
    if entry.pressure_file is not None:
        log = read(located(study, entry.pressure_file), mapping=entry.pressure_mapping)
        recording = with_pressure(recording, log, name, Path(entry.pressure_file).name)
    if entry.nominal_pressure is not None:
        recording = recording.assign_attrs(nominal_pressure=entry.nominal_pressure * pascal_per(entry.pressure_unit))
    if not entry.allow_low_pressure:
        check_pressure_unit(name, recording)
    return recording


def seen_by(study: Study, file: str) -> dict[str, Any]:
    """Return the study's camera as a mapping entry for a file; empty for pliant's own files, which are in metres."""
    return {} if study.camera is None or file.endswith((".nc", ".nc4")) else {"camera": study.camera}


def located(study: Study, file: str) -> Path:
    """Return the path of a file of the study; a relative name starts from the study's folder."""
    path = Path(file)
    return path if path.is_absolute() or file.startswith(PREFIX) else Path(study.folder) / path


def check_pressure_unit(name: str, recording: xr.Dataset) -> None:
    """Raise InputError if the pressure is too low to move a soft body, which suggests a wrong unit."""
    nominal = recording.attrs.get("nominal_pressure", 0.0)
    measured = float(np.nanmax(np.abs(recording["pressure"].values), initial=0.0)) if "pressure" in recording else 0.0
    for what, pascal in (("nominal pressure", nominal), ("highest pressure", measured)):
        if 0 < pascal < LEAST_PRESSURE:
            raise InputError(
                f"recording {name}: its {what} is {pascal:.4g} Pa, too low to move a soft body; state its unit (psi, "
                "kPa, mbar, ...) if it is not Pa, or set allow_low_pressure = true if it is right"
            )


def all_aligned(study: Study) -> dict[str, Aligned]:
    """Return every recording of the study in the base frame, by name.

    For several chambers or a body in space, the x axis of all recordings is that of the first.

    Aligned separately, each recording would be turned so that its own pressure bends it to the same side, and opposite
    chambers would look alike.
    """
    made: dict[str, Aligned] = {}
    normal, shared = None, len(study.actuator.chambers) > 1 or bool(study.actuator.space)
    for name in study.recordings:
        made[name] = aligned_recording(study, name, normal)
        attributes = made[name].body.attrs
        if normal is None and shared and "alignment" in attributes:
            normal = np.array(alignment_of(made[name].body).normal)
    made = on_one_side(study, made)
    return at_one_rest(made) if study.alignment.common_rest else made


def on_one_side(study: Study, recordings: Mapping[str, Aligned]) -> dict[str, Aligned]:
    """Return the recordings with planar ones turned by half a turn, if the first one bends to the negative side.  # D4

    All planar recordings are turned alike. A body with several chambers is left as it was recorded, since its chambers
    may bend it to different sides. Recordings aligned by `pliant.align` are in the base frame already.
    """
    done = dict(recordings)
    planar = [n for n, a in done.items() if not {"alignment", ATTRIBUTE} & set(a.body.attrs) and "position" in a.body]
    bend = -1 if study.alignment.options.get("bend") == "negative" else 1
    if study.actuator.space or len(study.actuator.chambers) > 1:
        return done
    if not planar or planar_side(done[planar[0]].body) != -bend:
        return done
    for name in planar:
        body = half_turn(done[name].body)
        said = str(body.attrs["history"]).splitlines()[-1]
        done[name] = done[name]._replace(body=body, findings=(*done[name].findings, said))
    return done


def aligned_recording(study: Study, name: str, normal: Array | None = None) -> Aligned:
    """Read one recording of the study, synchronise its pressure, and align it.

    With `normal` (3,) the plane of bending is that with this normal.
    """
    entry = study.recordings[name]
    alignment = combined(study.alignment, entry.alignment)
    raw, clocks, findings = on_one_clock(load_recording(study, name), entry, name)
    raw = raw if entry.window is None else cut_time(raw, *entry.window)
    raw = raw if entry.part is None else part_of(name, raw, *entry.part)
    before = len(str(raw.attrs.get("history", "")).splitlines())
    if alignment.swaps is not None:
        raw = (undo_swaps if alignment.swaps == "undo" else exclude_swaps)(raw)
    looked = quality(raw)
    raw = raw if entry.poses else leave_out_frozen(raw)  # a pose may equal the previous one
    if entry.staircase == "lines":
        raw = lines_between_changes(raw)
    with units_first({check: f"recording {name}: {line}" for check, line in looked.doubts.items()}):
        stations, body, tip = in_frame(study, name, raw, alignment, normal)
    found = [*findings, *inputs_in_words(entry, raw, name), *(str(line) for line in looked.findings)]
    if tip:
        found.append(tip)
    elif body is not raw or alignment.swaps:
        found += str(body.attrs.get("history", "")).splitlines()[before:]
    doubts = {**looked.doubts, **of_body(stated_case(study.actuator), stations, body)}
    return Aligned(body, tuple(found), tip, clocks, doubts)


def part_of(name: str, recording: xr.Dataset, start: float, stop: float) -> xr.Dataset:
    """Return the rows of a recording between two fractions of its number of rows, with the inputs of that time."""
    count = recording.sizes["time"]
    first, last = (round(f * count) for f in (start, stop))
    if not 0 <= first < last <= count:
        raise InputError(f"recording {name}: part must be [start, stop], fractions from 0 to 1 of its {count} rows")
    times = recording.time.values
    return cut_time(recording, float(times[first]), float(times[last - 1]))


def in_frame(
    study: Study, name: str, raw: xr.Dataset, alignment: AlignmentEntry, normal: Array | None,
) -> tuple[xr.Dataset, xr.Dataset, str]:
    """Return a recording's stations in the tracker's frame, the same in the base frame, and how a fibre's tip was
    found.
    """
    space = bool(study.actuator.space)
    check_frame(name, raw, space=space)
    if study.fibre is not None:
        return raw, *body_of_fibre(raw, study.fibre, space=space, normal=normal)
    if "position" not in raw and "angle" in raw:
        return raw, from_rest(raw, checked_rest(alignment)), ""
    if raw.attrs.get("frame") != "tracker":
        return raw, raw, ""
    stations = assemble(raw, alignment.stations) if alignment.stations else raw
    options = checked_options(alignment) | {"space": space}
    if study.recordings[name].poses:
        options.setdefault("rest", (float(raw.time.min()), float(raw.time.max())))  # each row is at rest
    own = study.recordings[name].alignment
    if normal is not None and not {"plane", "bend"} & set(own.options if own else ()):
        options |= {"plane": normal, "bend": None}
    return stations, align(stations, **options), ""


def check_frame(name: str, raw: xr.Dataset, *, space: bool) -> None:
    """Raise InputError if the recording's frame (planar or spatial) does not fit `space` of the study."""
    frame = str(raw.attrs.get("frame")) if "position" in raw else "planar"
    if frame != "tracker" and space != (frame == "spatial"):
        flat = "positions in a plane" if "position" in raw else "angles alone"
        holds = "positions in space" if frame == "spatial" else flat
        raise InputError(f"recording {name} holds {holds}, but [actuator] space is {str(space).lower()}: change space, "
                         "or use the tracker's recording before alignment")  # fmt: skip


def combined(shared: AlignmentEntry, own: AlignmentEntry | None) -> AlignmentEntry:
    """Return the study's alignment, with the entries that a recording states itself taking precedence."""
    if own is None:
        return shared
    return AlignmentEntry(stations=own.stations or shared.stations, options={**shared.options, **own.options},
                     swaps=own.swaps or shared.swaps)  # fmt: skip


def checked_rest(alignment: AlignmentEntry) -> tuple[float, float] | None:
    """Return the rest window [s] of a recording of angles alone; None if the study states none.

    Other options of the alignment do not apply to angles.
    """
    rest = alignment.options.get("rest")
    if rest is None:
        return None
    if not (isinstance(rest, list) and len(rest) == 2 and all(isinstance(t, int | float) for t in rest)):
        raise InputError(f"alignment option rest must be [start, end] in s, got {rest!r:.60}")
    return float(rest[0]), float(rest[1])


def checked_options(alignment: AlignmentEntry) -> dict[str, Any]:
    """Return the options of `align` that the study states; InputError for an unknown one."""
    import inspect

    known = [p for p in inspect.signature(align).parameters if p not in ("recording", "space")]  # [actuator] says space
    for key in alignment.options:
        if key not in known:
            raise InputError(f"alignment option {key!r} is unknown: use one of {', '.join(known)}")
    return dict(alignment.options)


def study_experiment(study: Study, name: str, recording: xr.Dataset) -> Experiment:
    """Return the `Experiment` of an aligned recording: moving stations, actuation input, known loads."""
    entry: Recording = study.recordings[name]
    base = alignment_of(recording).base if "alignment" in recording.attrs else "base"
    stations = entry.stations or moving_stations(name, recording, base)
    return experiment(
        name, recording, stations=tuple(stations), excitation=entry.excitation, known=entry.known, noise=entry.noise,
        angles=entry.angles, held=entry.held, forces=[f.in_base_frame(x_sign(recording)) for f in entry.forces],
        drive=entry.drive, own_places=entry.own_places, poses=entry.poses, inputs=entry.inputs,
    )


def moving_stations(name: str, recording: xr.Dataset, base: str) -> list[str]:
    """Return the names of all stations but the base; all stations if angles alone were recorded.

    Raises InputError if one of a few stations does not move, since that one may be the base.
    """
    stations = [str(s) for s in recording.station.values if str(s) != base]
    if "position" not in recording:
        return stations
    still = [s for s in standing_stations(recording) if s in stations]
    if still and len(still) < len(stations) < DENSE_STATIONS:
        raise InputError(
            f"recording {name}: {', '.join(still)} does not move, like the base {base!r}; name the base in "
            f"[alignment.options], and the stations that move in [recordings.{name}], as stations = [...]"
        )
    return stations


def hardly_moved(experiments: Mapping[str, Experiment], length: float) -> dict[str, str]:
    """Return the recordings in which the body hardly moved, each with a sentence that says so.

    A fit to such a recording would fit its noise.
    """
    reasons = {}
    for name, exp in experiments.items():
        unit, factor = exp.shown_in
        least = LEAST_TURN if exp.without_positions else LEAST_TRAVEL * length
        if exp.travel < least:
            limit = f"less than {factor * least:.2g} {unit}"
            if not exp.without_positions:
                limit = f"less than {100 * LEAST_TRAVEL:g} % of the body's {1e3 * length:.3g} mm"
            what = "angle" if exp.without_positions else "tip"
            moved = f"its {what} moves by {factor * exp.travel:.2g} {unit}"
            reasons[name] = f"recording {name} is dropped: {moved}, {limit}"
    return reasons


def without(study: Study, dropped: Collection[str], doubts: Sequence[str] = ()) -> Study:
    """Return the study without the `dropped` recordings in its fits and model selection.

    Raises InputError if a fit has no training recording left.
    """
    if not dropped:
        return study

    def rest(entry: Any, what: str) -> Any:
        left = {k: [r for r in getattr(entry, k) if r not in dropped] for k in ("train", "held_out")}
        if not left["train"]:
            perhaps = "".join(f"; {line}" for line in doubts)
            raise InputError(
                f"{what} has no usable training recording: {', '.join(entry.train)} hardly move{perhaps}"
            )
        return entry.model_copy(update=left)

    fits = {name: rest(entry, f"fit {name}") for name, entry in study.fits.items()}
    selection = rest(study.model_selection, "[model_selection]") if study.model_selection else None
    return study.model_copy(update={"fits": fits, "model_selection": selection})


def study_model(
    actuator: ActuatorEntry, rotation: Array | None, links: LinkPlacement | None = None, usual: int | None = None,
    sign: int = 1,
) -> Model:
    """Return the model of the study's actuator, from its entries, its preset and the recorded shape.

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
    values = actuator.model_dump(exclude_none=True, exclude={"preset", "section_area", "diameter", "stations", "taper"})
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
        for name in ("torque", "joint_gain", "valve"):
            values.pop(name, None)  # of the preset's single chamber
        joints = values.setdefault("links", 5) if links is None else links.n
        drawn = tuple(tendon_of(entry, joints, values["length"]) for entry in tendons)
        values["chambers"] = named_chambers(chambers, joints, space=bool(actuator.space)) + drawn
    else:
        values.setdefault("torque", [0.0])
    return fitted_out(chain_model(**values), actuator) if links is None else measured_chain(values, links)


def named_chambers(entries: Sequence[ChamberTable], joints: int, *, space: bool = False) -> tuple[Chamber, ...]:
    """Return the chambers of an actuator with `joints` joints; in space each at its azimuth, by default 90 degrees.

    A chamber at 90 degrees bends the body about +x, as a chamber of a planar body does.
    """
    made = []
    for entry in entries:
        turned = joints_of(entry, joints)
        if isinstance(entry.gain, list) and len(entry.gain) != len(turned):
            raise InputError(
                f"chamber {entry.name}: gain must be one number or one for each of its {len(turned)} joints, got "
                f"{len(entry.gain)}"
            )
        gain = np.zeros(joints)
        gain[np.array(turned) - 1] = entry.gain
        if entry.azimuth_deg is not None and not space:
            raise InputError(f"chamber {entry.name}: azimuth_deg needs a body in space: set space = true in [actuator]")
        azimuth = np.radians(90.0 if entry.azimuth_deg is None else entry.azimuth_deg)
        turns = {"joint_gain": np.sin(azimuth) * gain, "cross_gain": -np.cos(azimuth) * gain} if space else {
            "joint_gain": gain}  # fmt: skip
        made.append(Chamber(torque=np.array(entry.torque), axial_gain=np.atleast_1d(entry.axial_gain), name=entry.name,
                            **turns))  # fmt: skip
    return tuple(made)


def joints_of(entry: ChamberTable | TendonTable, joints: int) -> list[int]:
    """Return the numbers, from 1, of the joints on which an input acts: all if its entry states none."""
    turned = list(range(1, joints + 1)) if entry.joints is None else entry.joints
    if strange := [j for j in turned if not 1 <= j <= joints]:
        what = "tendon" if isinstance(entry, TendonTable) else "chamber"
        raise InputError(f"{what} {entry.name} acts on joint {strange[0]}, but the chain has joints 1 to {joints}")
    return turned


def tendon_of(entry: TendonTable, joints: int, length: float) -> Tendon:
    """Return the tendon of a study's table, on a chain of `length` [m] with `joints` joints."""
    if entry.azimuth_deg is None:
        raise InputError(f"tendon {entry.name}: state azimuth_deg; it can only be estimated in a study with recordings")
    passed = np.isin(np.arange(1, joints + 1), joints_of(entry, joints)) * passed_joints(entry, length, joints)
    values = entry.model_dump(exclude={"joints", "azimuth_deg", "taper", "stop"})
    if entry.driven_by == "tension":
        values["line_stiffness"] = 0.0
    return Tendon.at_azimuth(np.radians(entry.azimuth_deg), passed, **values)


def measured_chain(values: dict[str, Any], links: LinkPlacement) -> Model:
    """Return the chain of links placed on a measured shape, with the link tips as its observed points."""
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
    """Return gravity (2,) or (3,) [m/s^2] in the base frame.

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
