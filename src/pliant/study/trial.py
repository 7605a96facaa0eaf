"""Inspection of a user's files: what each contains, its alignment, and the excitation that it shows."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pliant.errors import InputError
from pliant.numerics.ringdown import peak
from pliant.preprocessing.align import DENSE_STATIONS, align, seen_from_base
from pliant.preprocessing.angles import from_rest
from pliant.preprocessing.base import base_is_moved
from pliant.preprocessing.clusters import assemble
from pliant.preprocessing.detectors import without_spikes
from pliant.preprocessing.glitches import leave_out_glitches
from pliant.preprocessing.held import leave_out_frozen
from pliant.preprocessing.quality import Quality, quality
from pliant.preprocessing.rest import FIRST_FRAMES, later_rest, nearest_rest
from pliant.preprocessing.side import alignment_of
from pliant.recording.inputs import RecordedInput, recorded_inputs
from pliant.recording.rules import shape_values, shape_variable
from pliant.recording.vocabulary import says_base
from pliant.sensing import read_shape
from pliant.study.aligned import with_log
from pliant.study.column_guess import TableGuess
from pliant.study.doubts import unit_warning_first
from pliant.study.first_reading import FirstReading, WithLog, perhaps_a_place, read_or_guess, several
from pliant.study.named_levels import named_pressure
from pliant.study.plates import RIGID_M, UNNAMED, base_first, off_curve, rigid, rigid_clusters, standing_among

MOVED_PLATE = 5.0  # of RIGID_M: a plate that moves farther shows that its markers keep their distances
OUT_OF_PLANE = 0.15  # out-of-plane fraction of the motion: tracked bodies that bend in a plane show up to 0.12
DRIVEN = 0.05  # of the widest pressure range: a pressure with a smaller range drives nothing
NO_BASE = "no station shows where the base is: state origin and tangent"
RETURNED = 0.3  # of the peak displacement: a body that ends below this has returned


@dataclass(frozen=True)
class Trial:
    """The content of one file at first reading, and the alignment that was tried on it.

    Attributes
    ----------
    path : Path
    recording : xarray.Dataset
    quality : Quality
        Data quality of the recording.
    mapping : dict or None
        Mapping as the user gave it.
    stations : dict
        Marker clusters, name -> markers; empty if every marker is a station.
    options : dict
        Arguments of `align`.
    aligned : xarray.Dataset or None
        The recording in the base frame; None when the alignment failed.
    problem : str
        Why the alignment failed.
    assumed : dict
        Mapping entries that were assumed in order to read the file: a camera, or units.
    log : Path or None
        File of the pressure log, if it is separate. `recording` then holds its pressure.
    log_mapping : dict or None
        Mapping of this file.
    part : str
        Name of the trial, if the file holds several.
    guess : TableGuess or None
        Proposed mapping, if the file is a table that nobody described.
    number : int or None
        Number of the trial, if the file holds several.
    """

    path: Path
    recording: xr.Dataset
    quality: Quality
    mapping: dict[str, Any] | None
    stations: dict[str, list[str]] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)
    aligned: xr.Dataset | None = None
    problem: str = ""
    assumed: dict[str, Any] = field(default_factory=dict)
    log: Path | None = None
    log_mapping: dict[str, Any] | None = None
    part: str = ""
    guess: TableGuess | None = None
    number: int | None = None

    @property
    def file_name(self) -> str:
        """Return the name of the file's table in the study, made from the file name and the name of the trial."""
        named = f"{self.path.stem}_{self.part}" if self.part else self.path.stem
        return re.sub(r"[^A-Za-z0-9_-]+", "_", named) or "recording"

    @property
    def name(self) -> str:
        """Return the name of the recording in the study; of a trial in a file of several, with its number."""
        return self.file_name if self.number is None else f"{self.file_name}_{self.number}"

    @property
    def files(self) -> WithLog:
        """Return the files of the recording, and their mappings."""
        return WithLog(self.path, self.mapping, self.log, self.log_mapping, self.part)

    @property
    def asks_rate(self) -> bool:
        """Return whether the frame rate is an open question."""
        return self.guess is not None and "rate_hz" in self.guess.questions

    @property
    def asks_inputs(self) -> bool:
        """Return whether the file has columns that may be inputs, but do not show which."""
        return self.guess is not None and "pressure" in self.guess.mapping and "pressure" not in self.guess.neutral

    @property
    def grouped(self) -> xr.Dataset:
        """Return the recording with one station for each group of markers on a rigid part."""
        return assemble(self.recording, self.stations) if self.stations else self.recording

    @property
    def names(self) -> list[str]:
        """Return the names of the stations, from grouped markers if there are groups."""
        return list(self.stations) or [str(s) for s in self.recording["station"].values]

    @property
    def base(self) -> str:
        """Return the name of the base station."""
        report = json.loads(str(self.recording.attrs.get("alignment", "{}")))
        return str(self.options.get("base") or report.get("base") or self.recording["station"].values[0])

    @property
    def has_scale(self) -> bool:
        """Return whether the file could be read without an assumption about its scale or units."""
        return not self.assumed and (self.guess is None or "arc_unit" not in self.guess.questions)

    @property
    def angles_only(self) -> bool:
        """Return whether the file holds angles or inclination, and no positions."""
        return "position" not in self.recording

    @property
    def last_motion(self) -> np.ndarray:
        """Return the motion of the last station over T frames (T, axes): position [m], or angle [rad] or inclination if
        the file holds no positions.
        """
        recording = self.recording if self.aligned is None else self.aligned
        return without_spikes(shape_values(recording)[:, -1:])[:, 0]

    @property
    def out_of_plane(self) -> float:
        """Return the fraction of the motion out of its best-fit plane; 0 if the file is planar or nothing moves."""
        share, moves = self.quality.out_of_plane_share, len(self.quality.standing) < self.quality.stations
        return float(share) if np.isfinite(share) and moves else 0.0

    @property
    def spatial(self) -> bool:
        """Return whether the file shows a body that moves in space."""
        frame = self.recording.attrs["frame"]
        moves_in_space = self.out_of_plane > OUT_OF_PLANE or bool(self.tendon_inputs)
        if frame == "tracker" and not moves_in_space and not self.angles_only and self.tracks_one_body:
            moves_in_space = off_curve(self.last_motion) > OUT_OF_PLANE
        return frame == "spatial" or (frame == "tracker" and moves_in_space)

    @property
    def tracks_one_body(self) -> bool:
        """Return whether a single point or rigid body was tracked."""
        return len(self.names) == 1

    @property
    def chambers(self) -> list[str]:
        """Return the names of the pressures if there are several; for a body in a plane only those that vary."""
        names, ranges = several(self.recording), self.pressure_ranges
        widest = max(ranges.values(), default=0.0)
        return names if self.spatial else [n for n in names if ranges.get(n, 0.0) > DRIVEN * widest]

    @property
    def pressure_ranges(self) -> dict[str, float]:
        """Return the difference between highest and lowest value of each pressure [kPa]."""
        return {name: high - low for name, (low, high) in self.quality.pressure_kpa.items()}

    @property
    def tendon_inputs(self) -> list[RecordedInput]:
        """Return the recorded inputs that drive tendons: all inputs except pressures."""
        return [signal for signal in recorded_inputs(self.recording) if signal.kind != "pressure"]

    @property
    def peak_motion(self) -> float:
        """Return the largest peak displacement [m] of a station, or the largest rotation [degrees] for angles."""
        return max((self.quality.travel_deg if self.angles_only else self.quality.travel_m).values())

    @property
    def dense(self) -> bool:
        """Return whether the file has enough stations to describe the shape all along the body."""
        return not self.angles_only and len(self.names) >= DENSE_STATIONS

    @property
    def capped(self) -> bool:
        """Return whether the file states that a cap marks the tip."""
        return "cap_curvature" in self.recording.attrs and "cap_length" in self.recording.attrs

    @property
    def highest_pa(self) -> float | None:
        """Return the measured pressure farthest from 0 [Pa] or, if none was measured, the nominal pressure in the file
        or in its name, see `named_pressure`. Return None if none is known.
        """
        if "pressure" in self.recording:
            return peak(self.recording["pressure"].values)
        if "nominal_pressure" in self.recording.attrs:
            return float(self.recording.attrs["nominal_pressure"])
        return named_pressure(self.path.stem)


def inspect_file(files: WithLog) -> list[Trial]:
    """Inspect a recording; return one `Trial`, or one for each trial that a column of a table numbers."""
    whole = inspect_trial(*files)
    if whole.guess is None or whole.guess.trials is None:
        return [whole]
    return [inspect_guessed(whole, whole.guess, number) for number in whole.guess.trials[1]]


def inspect_guessed(trial: Trial, guess: TableGuess, number: int | None = None) -> Trial:
    """Return the inspection of a trial's file by a proposed mapping; of one of several trials, with its number."""
    column = guess.trials[0] if guess.trials else ""
    select = {} if number is None else {"select": {"column": column, "value": number}}
    recording = read_shape(trial.path, {**guess.neutral, **select})
    return inspect_reading(trial.files, FirstReading(recording, guess.assumed, guess), number)


def inspect_trial(
    path: Path, mapping: Mapping[str, Any] | None = None, log: Path | None = None,
    log_mapping: dict[str, Any] | None = None, part: str = "",
) -> Trial:
    """Read a file, assess its quality, group its markers and try to align it in the plane.

    Parameters
    ----------
    path : Path
    mapping : dict, optional
        See `pliant.read`.
    log : Path, optional
        Separate file with the pressures, which are moved to the clock of the shape as a run of the study moves them.
    log_mapping : dict, optional
        Mapping of this file.
    part : str, optional
        Name of the trial, if the file holds several.

    Raises
    ------
    InputError
        When the file cannot be read, or holds neither positions nor angles.
    """
    entries = dict(mapping) if mapping else None
    return inspect_reading(WithLog(path, entries, log, log_mapping, part), read_or_guess(path, entries))


def inspect_reading(files: WithLog, reading: FirstReading, number: int | None = None) -> Trial:
    """Inspect what was read from a file; see `inspect_trial`."""
    recording, assumed, guess = reading
    if not shape_variable(recording):
        releases = ("pressure alone, and a study needs the shape too: add the recording to which it belongs, or name "
                    f"its positions in a mapping{perhaps_a_place(recording)}")  # fmt: skip
        if "strain" in recording:
            releases = "the strain of a fibre: state its cores in a mapping (table [cores]) and give that by --mapping"
        raise InputError(f"{files.shape.name} holds {releases}")
    unsynchronised = ""
    if files.log is not None:
        recording, unsynchronised = with_log(recording, files.log, files.shape.stem, files.log_options)
    assessed = quality(recording)
    if unsynchronised:
        assessed = replace(assessed, doubts={**assessed.doubts, "clock of the log": unsynchronised})
    recording = leave_out_glitches(leave_out_frozen(recording))
    trial = Trial(files.shape, recording, assessed, files.options, assumed=assumed, log=files.log, number=number,
                  log_mapping=files.log_options, part=files.trial, guess=guess)  # fmt: skip
    if shape_variable(recording) == "angle":
        try:
            return replace(trial, aligned=from_rest(recording))
        except InputError as error:
            return replace(trial, problem=str(error))
    if recording.attrs["frame"] != "tracker":
        return replace(trial, aligned=recording)
    plates = {} if guess is not None and guess.numbered else rigid_clusters(recording)
    trial = replace(trial, stations=base_first(recording, plates, assessed.standing))
    trial = replace(trial, options=directions(recording, assessed, trial.stations, dense=trial.dense))
    if trial.options.get("base_motion"):
        shape = seen_from_base(trial.grouped, trial.names.index(trial.base))
        share = quality(shape).out_of_plane_share
        trial = replace(trial, quality=replace(assessed, out_of_plane_share=share))
    return trial if trial.capped else with_alignment(trial)


def with_alignment(trial: Trial, *, space: bool = False, rest: tuple[float, float] | None = None) -> Trial:
    """Return the trial with its recording aligned in the plane or in space, or with the reason why it cannot be. With
    `rest` (start, end) [s] the body is at rest then.
    """
    if not trial.options:
        return replace(trial, aligned=None, problem=NO_BASE)
    try:
        with unit_warning_first(trial.quality.doubts):
            aligned = align(trial.grouped, **{"rest": rest, **trial.options}, space=space)
            return replace(trial, aligned=aligned, problem="")
    except InputError as error:
        if rest is None and "rest" not in trial.options and (
            calm := later_rest(trial.grouped) or (
                None if recorded_inputs(trial.recording) else nearest_rest(trial.grouped))
        ):
            return with_alignment(replace(trial, options={**trial.options, "rest": calm}), space=space)
        return replace(trial, aligned=None, problem=str(error))


def from_first_frames(trial: Trial) -> Trial:
    """Return the trial with its first frames as the rest, if it has rests only after its motion, as where a recording
    begins with the inflation and ends before the pressure falls.
    """
    if trial.aligned is None or "alignment" not in trial.aligned.attrs or "rest" in trial.options:
        return trial
    time, motion = trial.recording["time"].values, trial.last_motion
    away = np.linalg.norm(motion - np.nanmedian(motion[:FIRST_FRAMES], axis=0), axis=-1)
    begin = alignment_of(trial.aligned).rest_s[0]
    if not np.nanmedian(away[(time >= begin)][:FIRST_FRAMES]) > RETURNED * np.nanmax(away):
        return trial
    rest = [round(float(time[0]), 3), round(float(time[min(FIRST_FRAMES, len(time) - 1)]), 3)]
    return with_alignment(replace(trial, options={**trial.options, "rest": rest}))


def in_space(trial: Trial, *, settled: bool = False) -> Trial:
    """Return the trial with its recording aligned in space; a settled one is at rest from begin to end.

    Raises
    ------
    InputError
        When the file holds angles alone, or positions that are planar already.
    """
    if trial.recording.attrs["frame"] == "planar":
        content = "angles alone" if trial.angles_only else "a planar recording"
        raise InputError(f"{trial.path.name} holds {content}: a study in space needs the three-dimensional positions "
                         "of the tracker")
    if trial.recording.attrs["frame"] == "spatial" or trial.capped:
        return trial
    time = trial.recording["time"].values
    return with_alignment(trial, space=True, rest=(float(time[0]), float(time[-1])) if settled else None)


def from_one_side(trials: Sequence[Trial]) -> list[Trial]:
    """Return the inspected files with all planar recordings aligned to the plane of the first one, so that x has the
    same direction in all.
    """
    done: list[Trial] = []
    normal = None
    for trial in trials:
        turned = trial
        if trial.aligned is not None and "alignment" in trial.aligned.attrs:
            if normal is None:
                normal = np.array(alignment_of(trial.aligned).normal)
            else:
                turned = replace(trial, aligned=align(trial.grouped, **trial.options, plane=normal, bend=None))
        done.append(turned)
    return done


def two_plates(trials: Sequence[Trial]) -> dict[str, list[str]]:
    """Return the markers of a base plate that stands still and of a tip plate that moves, if the markers of all
    recordings have no names and are on these two: at least three on each, at constant distances in all recordings,
    though the tip plate moves much more than they change. Empty otherwise.
    """
    names = [str(s) for s in trials[0].recording["station"].values]
    for trial in trials:
        unnamed = trial.guess.numbered if trial.guess else all(UNNAMED.fullmatch(name) for name in names)
        grouped = trial.dense or any(len(markers) > 1 for markers in trial.stations.values())
        same = [str(s) for s in trial.recording["station"].values] == names
        if trial.angles_only or trial.recording.attrs["frame"] != "tracker" or grouped or not (unnamed and same):
            return {}
    base = [n for n in names if all(n in trial.quality.standing for trial in trials)]
    tip = [n for n in names if n not in base]
    widest = max(trial.peak_motion for trial in trials)
    if min(len(base), len(tip)) < 3 or widest < MOVED_PLATE * RIGID_M:
        return {}
    plates = all(rigid(trial.recording, plate) for trial in trials for plate in (base, tip))
    return {"base": base, "tip": tip} if plates else {}


def on_plates(trials: Sequence[Trial]) -> list[Trial]:
    """Return the trials with a station for each of two plates, if all their markers are on these; see `two_plates`."""
    if not (plates := two_plates(trials)):
        return list(trials)
    options = [directions(trial.recording, trial.quality, plates, dense=False) for trial in trials]
    grouped = [replace(t, stations=plates, options=o) for t, o in zip(trials, options, strict=True)]
    return [with_alignment(trial) for trial in grouped]


def directions(
    recording: xr.Dataset, found: Quality, stations: Mapping[str, list[str]], *, dense: bool
) -> dict[str, Any]:
    """Return arguments for `align` that suit a recording, such as the name of its base: the station named base, else
    one that does not move, of a dense shape the first. Empty if no station shows the base.
    """
    names = list(stations) or [str(s) for s in recording["station"].values]
    named = [n for n in names if "base" in n.lower()] or [n for n in names if says_base(n)]
    still = standing_among(names, stations, found.standing)
    candidates = named or (names if dense else still if len(still) < len(names) else [])
    if len(names) == 1 or not candidates:
        return {}
    base = candidates[0]
    options: dict[str, Any] = {"base": base, "tangent": "clamp" if dense else "chord"}
    if found.orientation_jumps:
        options["undo_jumps"] = True
    grouped = assemble(recording, stations) if stations else recording
    if not dense and base_is_moved(grouped, names.index(base)):
        options["base_motion"] = True
    return options


def longest_rest(trials: Sequence[Trial]) -> tuple[float, Trial] | None:
    """Return the largest length of the body [m] that a recording shows, and this recording; None if none shows it. A
    recording that begins under pressure shows a bent body, which is shorter.
    """
    lengths = [(length, trial) for trial in trials if (length := body_length(trial)) is not None]
    return max(lengths, key=lambda one: one[0], default=None)


def farthest(trials: Sequence[Trial]) -> float | None:
    """Return the largest distance of a last station from its base [m]; None if no base is known."""
    away = [np.nanmax(np.linalg.norm(trial.last_motion, axis=1)) for trial in trials if trial.aligned is not None]
    return float(max(away)) if away else None


def body_length(trial: Trial) -> float | None:
    """Return the length of the body [m]: the arc length to the last station or, if arc lengths are unknown, the
    distance from base to tip at rest. Return None if the file does not determine the length.
    """
    if trial.aligned is None or trial.capped or trial.angles_only or not trial.has_scale:
        return None
    if "arc_length" in trial.aligned.coords:
        return float(trial.aligned["arc_length"].values[-1])
    begin, end = trial.options.get("rest", (-np.inf, np.inf))
    time = trial.aligned["time"].values
    first = trial.last_motion[(time >= begin) & (time <= end)][:10]
    length = float(np.linalg.norm(np.median(first[np.isfinite(first).all(axis=1)], axis=0)))
    return length if np.isfinite(length) else None
