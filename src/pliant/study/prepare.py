"""Preparation of a study: read and align its recordings, and build the experiments from its entries."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pliant.errors import InputError, inside
from pliant.identification import Experiment, experiment
from pliant.identification.drives import driving
from pliant.identification.from_recording import base_of
from pliant.model import Model
from pliant.preprocessing.align import DENSE_STATIONS, align, alignment_of
from pliant.preprocessing.angles import from_rest
from pliant.preprocessing.base import base_is_moved
from pliant.preprocessing.clusters import assemble
from pliant.preprocessing.cut import cut_time
from pliant.preprocessing.glitches import leave_out_glitches
from pliant.preprocessing.held import leave_out_frozen, lines_between_changes
from pliant.preprocessing.labels import exclude_swaps, undo_swaps
from pliant.preprocessing.plausibility.pressure import LEAST_PRESSURE
from pliant.preprocessing.quality import quality, standing_stations
from pliant.preprocessing.repair import leave_out_spikes
from pliant.preprocessing.side import ATTRIBUTE, half_turn, planar_side
from pliant.recording import read
from pliant.recording.columns import CHANGING
from pliant.recording.inputs import recorded_inputs
from pliant.recording.mapping import KEY
from pliant.recording.published import PREFIX
from pliant.recording.rules import shape_variable
from pliant.recording.schema import append_history, history_of
from pliant.recording.typed_steps import held_sentences
from pliant.sensing import read_shape
from pliant.study.aligned import Aligned, at_common_rest, known_forces, known_values, on_one_clock, with_pressure
from pliant.study.dense import body_of_fibre
from pliant.study.doubts import body_warnings, stated_case, unit_warning_first
from pliant.study.schema import AlignmentEntry, Recording, Study
from pliant.units import pascal_per

Array = np.ndarray
LEAST_TURN = 0.02  # rad: least rotation, for a recording of angles alone
LEAST_TRAVEL = 0.003  # of the body's length: least motion of the tip in a usable recording
MEANT = {"pressure": "gauge pressure, Pa", "tension": "tension, N", "displacement": "displacement, m",
         "angle": "angle of a motor, rad"}  # fmt: skip


def load_recording(study: Study, name: str) -> xr.Dataset:
    """Read one recording of the study, with its pressure log and its nominal pressure if the study states them."""
    entry = study.recordings[name]
    path = path_of(study, entry.file)
    in_metres = study.camera is None or entry.file.endswith((".nc", ".nc4"))  # pliant's own files are
    mapping = {**({} if in_metres else {"camera": study.camera}), **study.mapping, **(entry.mapping or {})}
    recording = read_shape(path, mapping or None, format=entry.format)
    if entry.pressure_file is not None:
        by_name = {KEY: study.mapping[KEY]} if KEY in study.mapping else None
        log = read(path_of(study, entry.pressure_file), mapping=entry.pressure_mapping or by_name)
        recording = with_pressure(recording, log, name, Path(entry.pressure_file).name)
    if entry.nominal_pressure is not None:
        recording = recording.assign_attrs(nominal_pressure=entry.nominal_pressure * pascal_per(entry.pressure_unit))
    if not entry.allow_low_pressure:
        check_pressure_unit(name, recording)
    return recording


def path_of(study: Study, file: str) -> Path:
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
    """Read every recording of the study and return them in the base frame, by name.

    For several chambers or a body in space, the x axis of all recordings is that of the first.

    Aligned separately, each recording would be turned so that its own pressure bends it to the same side, and opposite
    chambers would look alike.
    """
    recordings: dict[str, Aligned] = {}
    normal, shared = None, len(study.actuator.chambers) > 1 or bool(study.actuator.space)
    for name in study.recordings:
        recordings[name] = aligned_recording(study, name, normal)
        attributes = recordings[name].body.attrs
        if normal is None and shared and "alignment" in attributes:
            normal = np.array(alignment_of(recordings[name].body).normal)
    recordings = on_one_side(study, recordings)
    return at_common_rest(recordings) if study.alignment.common_rest else recordings


def on_one_side(study: Study, recordings: Mapping[str, Aligned]) -> dict[str, Aligned]:
    """Return all recordings, turned so that the body bends to the positive side: if it bends to the negative side in
    the first planar recording, all planar recordings are turned by 180 degrees about the base tangent.

    All planar recordings are turned alike. A body with several chambers is left as it was recorded, since its chambers
    may bend it to different sides. Recordings aligned by `pliant.align` are in the base frame already.  # D4
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
        last_step = str(body.attrs["history"]).splitlines()[-1]
        done[name] = done[name]._replace(body=body, findings=(*done[name].findings, last_step))
    return done


def aligned_recording(study: Study, name: str, normal: Array | None = None) -> Aligned:
    """Read one recording of the study, synchronise its pressure, and align it.

    With `normal` (3,) the plane of bending is that with this normal.
    """
    entry = study.recordings[name]
    alignment = merged_alignment(study.alignment, entry.alignment)
    loaded = load_recording(study, name)
    calm = loaded if entry.poses or entry.spikes == "keep" else leave_out_glitches(loaded)
    glitches = history_of(calm)[len(history_of(loaded)):]
    raw, clocks, findings = on_one_clock(calm, entry, name)
    raw = raw if entry.window is None else cut_time(raw, *entry.window)
    raw = raw if entry.part is None else part_of(name, raw, *entry.part)
    before = len(str(raw.attrs.get("history", "")).splitlines())
    if alignment.swaps is not None:
        raw = (undo_swaps if alignment.swaps == "undo" else exclude_swaps)(raw)
    looked = quality(raw)
    raw = raw if entry.poses else leave_out_frozen(raw)  # a pose may equal the previous one
    if entry.staircase == "lines":
        raw = lines_between_changes(raw)
    with unit_warning_first({check: f"recording {name}: {line}" for check, line in looked.doubts.items()}):
        stations, body, tip = in_frame(study, name, raw, alignment, normal)
    if not entry.poses and entry.spikes == "leave out" and not study.reduction:
        body = leave_out_spikes(body, stations)
    lines = [*glitches, *findings, *held_sentences(raw), *left_out_columns(raw), *inputs_in_words(entry, raw, name)]
    lines += [str(line) for line in looked.findings]
    if entry.every > 1:
        lines.append(f"each frame of {entry.every} is used, {-(-body.sizes['time'] // entry.every)} of "
                     f"{body.sizes['time']}")  # fmt: skip
    if tip:
        lines.append(tip)
    elif body is not raw or alignment.swaps:
        lines += str(body.attrs.get("history", "")).splitlines()[before:]
    if (base := base_of(body)) is not None:
        lines.append(base.summary())
    doubts = {**looked.doubts, **body_warnings(stated_case(study.actuator), stations, body)}
    return Aligned(body, tuple(lines), tip, clocks, doubts)


def left_out_columns(recording: xr.Dataset) -> list[str]:
    """Return the sentences of a recording's history on columns of its file that change and are not in its mapping."""
    return [line for line in str(recording.attrs.get("history", "")).splitlines() if CHANGING in line]


def part_of(name: str, recording: xr.Dataset, start: float, stop: float) -> xr.Dataset:
    """Return the rows of a recording between two fractions (0 to 1) of its number of rows, with the inputs recorded in
    that time.
    """
    count = recording.sizes["time"]
    first, last = (round(f * count) for f in (start, stop))
    if not 0 <= first < last <= count:
        raise InputError(f"recording {name}: part must be [start, stop], fractions from 0 to 1 of its {count} rows")
    times = recording.time.values
    return cut_time(recording, float(times[first]), float(times[last - 1]))


def in_frame(
    study: Study, name: str, raw: xr.Dataset, alignment: AlignmentEntry, normal: Array | None,
) -> tuple[xr.Dataset, xr.Dataset, str]:
    """Return a recording's stations in the tracker's frame, the same stations in the base frame, and a sentence on how
    a fibre's tip was found.
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
    with inside(f"recording {name}"):
        return stations, with_moved_base(study.recordings[name], stations, options), ""


def with_moved_base(entry: Recording, stations: xr.Dataset, options: dict[str, Any]) -> xr.Dataset:
    """Return the stations of a recording in the base frame by the `options` of `align`. Where these do not say what to
    do with the motion of the base, and the base moves as that of a robot does, its motion becomes an input of the body.
    """
    aligned = align(stations, **options)
    stated = {"base_motion", "remove_base_motion"} & set(options)
    index = [str(n) for n in stations["station"].values].index(alignment_of(aligned).base)
    if stated or entry.poses or entry.excitation == "release" or not base_is_moved(stations, index):
        return aligned
    why = ("the base carries all stations along: its motion is taken as an input; set base_motion = false in "
           "[alignment.options] if it is part of the body's own motion")
    return append_history(align(stations, **options, base_motion=True), why)


def check_frame(name: str, raw: xr.Dataset, *, space: bool) -> None:
    """Raise InputError if the recording's frame (planar or spatial) does not fit `space` of the study."""
    shape = shape_variable(raw)
    frame = "planar" if shape in ("", "angle") else str(raw.attrs.get("frame"))
    if frame != "tracker" and space != (frame == "spatial"):
        what, where = "positions" if shape == "position" else shape, "space" if frame == "spatial" else "a plane"
        holds = "angles alone" if shape in ("", "angle") else f"{what} in {where}"
        raise InputError(f"recording {name} holds {holds}, but [actuator] space is {str(space).lower()}: change space, "
                         "or use the tracker's recording before alignment")  # fmt: skip


def merged_alignment(shared: AlignmentEntry, own: AlignmentEntry | None) -> AlignmentEntry:
    """Return the study's alignment, with the entries of a recording's own alignment taking precedence."""
    if own is None:
        return shared
    return AlignmentEntry(stations=own.stations or shared.stations, options={**shared.options, **own.options},
                     swaps=own.swaps or shared.swaps)  # fmt: skip


def checked_rest(alignment: AlignmentEntry) -> tuple[float, float] | None:
    """Return the time (start, end) [s] in which the body is at rest, for a recording of angles alone; None if the study
    states none.

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
    """Return the `Experiment` of an aligned recording, with its moving stations, its actuation input and its known
    loads.
    """
    entry: Recording = study.recordings[name]
    base = alignment_of(recording).base if "alignment" in recording.attrs else "base"
    stations = entry.stations or moving_stations(name, recording, base, settled=bool(entry.poses))
    full = experiment(
        name, recording, stations=tuple(stations), excitation=entry.excitation,
        known=known_values(entry, recording), noise=entry.noise,
        angles=entry.angles, held=entry.held, forces=known_forces(entry, recording),
        drive=entry.drive, own_places=entry.own_places, poses=entry.poses, inputs=entry.inputs,
        start=entry.start, warm_up=entry.warm_up,
    )
    return full.thinned(entry.every) if entry.every > 1 else full


def moving_stations(name: str, recording: xr.Dataset, base: str, *, settled: bool = False) -> list[str]:
    """Return the names of all stations but the base; all stations if angles alone were recorded.

    Raises InputError if one of a few stations does not move, since that one may be the base. In a recording of settled
    poses any station may stay where it is.
    """
    stations = [str(s) for s in recording.station.values if str(s) != base]
    if "position" not in recording or settled:
        return stations
    still = [s for s in standing_stations(recording) if s in stations]
    if still and len(still) < len(stations) < DENSE_STATIONS:
        raise InputError(
            f"recording {name}: {', '.join(still)} does not move, like the base {base!r}; name the base in "
            f"[alignment.options], and the stations that move in [recordings.{name}], as stations = [...]"
        )
    return stations


def supported_links(experiments: Mapping[str, Experiment]) -> int | None:
    """Return the number of links that recorded angles can determine, one for each angle; None if positions were
    recorded.

    Raises
    ------
    InputError
        When some recordings hold positions and others do not.
    """
    kinds = {name: e.without_positions for name, e in experiments.items()}
    if len(set(kinds.values())) > 1:
        bare = [name for name, without_positions in kinds.items() if without_positions]
        raise InputError(f"recording {bare[0]} holds angles and no positions, but others hold positions: use "
                         "recordings of one kind in a study")  # fmt: skip
    if not all(kinds.values()):
        return None
    return max(len(e.stations) for e in experiments.values())


def without_motion(experiments: Mapping[str, Experiment], length: float) -> dict[str, str]:
    """Return a dict with a sentence for each recording in which the body hardly moved; its keys are the recordings'
    names.

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


def beyond_reach(experiments: Mapping[str, Experiment], model: Model) -> dict[str, str]:
    """Return a dict with a sentence for each recording in which a station is farther from the base than the body can
    reach; its keys are the recordings' names.

    The body reaches its length, its rigid part before the first joint included, plus a quarter for markers beside the
    axis; if segments lengthen, 60 % more than its length.
    """
    reasons: dict[str, str] = {}
    most = model.reach
    for name, exp in experiments.items():
        away = np.nan_to_num(np.linalg.norm(exp.position, axis=2))
        if not (far := away > most).any():
            continue
        frame, station = np.unravel_index(int(np.argmax(away)), away.shape)
        reasons[name] = (
            f"recording {name} is dropped: station {exp.stations[station]} is {1e3 * away[frame, station]:.4g} mm from "
            f"the base in frame {frame + 1} (at {exp.time[frame]:.3f} s), farther than the body of "
            f"{1e3 * model.length:.4g} mm reaches ({int(far.any(axis=1).sum())} such frame(s)); check the tracking "
            "there and the stated length, and leave these frames out with window or as empty cells"
        )
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
            far = "is dropped: station" in perhaps
            fault, remedy = ("cannot be used", "correct them") if far else (
                "hardly move", "train on a recording in which the body moves more")  # fmt: skip
            raise InputError(f"{what} has no usable training recording: {', '.join(entry.train)} {fault}{perhaps}; "
                             f"{remedy}")
        return entry.model_copy(update=left)

    fits = {name: rest(entry, f"fit {name}") for name, entry in study.fits.items()}
    selection = rest(study.model_selection, "[model_selection]") if study.model_selection else None
    return study.model_copy(update={"fits": fits, "model_selection": selection})


def inputs_in_words(entry: Recording, recording: xr.Dataset, name: str) -> list[str]:
    """Return a sentence on the inputs of a recording: channels, kinds, and whether they were measured or commanded.

    The list is empty if all inputs are pressures and the study does not state whether they were measured.
    """
    inputs = recorded_inputs(recording)
    if not inputs or (entry.signal is None and all(item.kind == "pressure" for item in inputs)):
        return []
    driven = driving(name, recording, entry.drive) if entry.drive else {}
    listed = {kind: [f"{item.name} drives {to}" for to, item in driven.items() if item.kind == kind] for kind in MEANT}
    if not driven:
        listed = {kind: [item.name or "a single input" for item in inputs if item.kind == kind] for kind in MEANT}
    listing = "; ".join(f"{', '.join(names)} ({MEANT[kind]})" for kind, names in listed.items() if names)
    return [f"inputs, {entry.signal or 'not stated whether measured or commanded'}: {listing}"]
