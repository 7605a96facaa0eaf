"""Summarise the contents of a recording and count its faults; the recording is not changed."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.display import Card, Shown
from pliant.preprocessing import detectors
from pliant.preprocessing.angles import angle_facts, angle_sentences
from pliant.preprocessing.detectors import by_blocks
from pliant.preprocessing.glitches import Glitch, glitch_sentences, input_glitches, leave_out_glitches
from pliant.preprocessing.held import Span, frozen, frozen_sentences, frozen_spans, staircase_sentences, staircases
from pliant.preprocessing.labels import exchanged, recording_svg
from pliant.preprocessing.plausibility import UNITS, Case, doubts
from pliant.preprocessing.plausibility.shape import extent
from pliant.preprocessing.pressure_clock import clock_overlap, clock_sentences, overlap_sentences, pressure_clock
from pliant.preprocessing.rotations import continuous
from pliant.recording.clock import usual_step
from pliant.recording.inputs import recorded_inputs
from pliant.recording.lost import known_losses, listed, loss_sentences
from pliant.recording.rules import shape_variable
from pliant.recording.schema import check_recording, history_of
from pliant.recording.stated import WARNING

if TYPE_CHECKING:
    import xarray as xr

IRREGULAR_SHARE = 0.2  # a time step is irregular beyond this fraction of the median step
GAP_RATIO = 2.5  # and a gap beyond this multiple of it
STRETCH_SHARE = 0.05
DENSE_STATIONS = 8  # chords between fewer stations change with bending, so their spacing is not judged
STANDING_SHARE = 0.03
LEAST_TRAVEL = 0.01  # of the extent
OF_A_LOG = {"duration_s": "pressure_duration_s", "rate_hz": "pressure_rate_hz"}  # of a recording without a shape


@dataclass(frozen=True, repr=False)
class Quality(Shown):
    """Contents of a recording (stations, duration, rate) and counts of its faults, with one sentence per finding.

    Attributes
    ----------
    frames, stations : int
        Numbers of frames and of stations.
    duration_s, rate_hz : float
        Duration, and frame rate by the mean time step without gaps.
    irregular_steps : int
        Number of time steps that differ by more than 20 % from the median step, and by more than the rounding of times
        to 1 ms.
    gaps : tuple of (start_s, length_s)
        Time steps of more than 2.5 times the median step.
    repeated_frames : int
        Number of frames that equal the previous frame in every number.
    missing, spikes, station_jumps, sign_flips, orientation_jumps, orientation_spikes : dict
        Numbers of affected frames by station; stations without any are left out.
    lost : dict
        Numbers of frames that the tracker wrote as numbers although it had lost the station, by station and by what it
        wrote. They are among the missing ones.
    frozen : dict
        Spans (first s, last s, frames) in which the tracker repeated the last position of a station, by station.
    frame_jumps_s : tuple of float
        Times at which more than half of the stations jumped at once.
    stretched : dict
        Numbers of frames in which the spacing of two neighbours differs by more than 5 % from its median, by pair.
    swapped : dict
        Numbers of frames in which stations exchange their labels, by their names (``a-b``).
    standing : tuple of str
        Stations that do not move while others move, such as a base.
    noise_m, travel_m : dict
        Noise of one coordinate, and peak displacement from the median position, by station.
    noise_deg, travel_deg, step_deg : dict
        Noise and peak rotation [degrees] of stations with an angle and no position, and the resolution of coarse
        sensors, by station.
    out_of_plane_share : float
        Fraction of the motion (root mean square) out of the plane of bending. That plane contains the chord from the
        first to the last station and most of the motion.
    pressure_kpa : dict
        Pressure range (smallest, largest) by chamber.
    input_range : dict
        Range (smallest, largest, unit) of each input other than pressure, in N, mm or degrees.
    input_held : dict
        Update interval (samples, seconds) of inputs recorded as staircases, pressures included.
    input_glitches : dict
        Glitches (time s, value SI, samples) of each input that has any; see `pliant.preprocessing.glitches`.
    pressure_samples, pressure_duration_s, pressure_rate_hz : int, float, float
        Number of samples, duration and rate of a pressure whose times differ from the shape's.
    pressure_gaps : tuple of (sample, start_s, length_s, missing)
        Gaps of that pressure: after sample number `sample`, counted from 1, `missing` samples are missing.
    pressure_steps_s : tuple of float
        Shortest and longest time step of that pressure, where its steps are irregular.
    input_overlap : dict
        Fraction of the frames of the shape that the clock of the pressure, or of other inputs, covers, where that clock
        differs from the shape's.
    findings : tuple of str
        One sentence for each fault or remark, the sentences of `doubts` included.
    doubts : dict
        Sentences of the plausibility checks that found a problem, by check; see `pliant.preprocessing.plausibility`.
    drawing : str
        The body at a few instants as SVG, which a notebook shows; not part of `to_dict`.
    """

    frames: int = 0
    stations: int = 0
    duration_s: float = 0.0
    rate_hz: float = float("nan")
    irregular_steps: int = 0
    gaps: tuple[tuple[float, float], ...] = ()
    repeated_frames: int = 0
    missing: dict[str, int] = field(default_factory=dict)
    lost: dict[str, dict[str, int]] = field(default_factory=dict)
    spikes: dict[str, int] = field(default_factory=dict)
    station_jumps: dict[str, int] = field(default_factory=dict)
    sign_flips: dict[str, int] = field(default_factory=dict)
    orientation_jumps: dict[str, int] = field(default_factory=dict)
    orientation_spikes: dict[str, int] = field(default_factory=dict)
    frozen: dict[str, tuple[Span, ...]] = field(default_factory=dict)
    frame_jumps_s: tuple[float, ...] = ()
    stretched: dict[str, int] = field(default_factory=dict)
    swapped: dict[str, int] = field(default_factory=dict)
    standing: tuple[str, ...] = ()
    noise_m: dict[str, float] = field(default_factory=dict)
    travel_m: dict[str, float] = field(default_factory=dict)
    noise_deg: dict[str, float] = field(default_factory=dict)
    travel_deg: dict[str, float] = field(default_factory=dict)
    step_deg: dict[str, float] = field(default_factory=dict)
    out_of_plane_share: float = float("nan")
    pressure_kpa: dict[str, tuple[float, float]] = field(default_factory=dict)
    input_range: dict[str, tuple[float, float, str]] = field(default_factory=dict)
    input_held: dict[str, tuple[int, float]] = field(default_factory=dict)
    input_glitches: dict[str, tuple[Glitch, ...]] = field(default_factory=dict)
    pressure_samples: int = 0
    pressure_duration_s: float = 0.0
    pressure_rate_hz: float = float("nan")
    pressure_gaps: tuple[tuple[int, float, float, int], ...] = ()
    pressure_steps_s: tuple[float, ...] = ()
    input_overlap: dict[str, float] = field(default_factory=dict)
    findings: tuple[str, ...] = ()
    doubts: dict[str, str] = field(default_factory=dict)
    drawing: str = ""

    def summary(self) -> str:
        """Return the contents of the recording and the faults found in it as text, one line each."""
        if self.frames:
            of = f"{self.stations} station(s)" if self.stations else "strain"
            lines = [f"{self.frames} frames of {of}{spanned(self.duration_s, self.rate_hz)}"]
        elif self.input_range and not self.pressure_samples:
            lines = [f"log of {len(self.input_range)} inputs, without a shape"]
        else:
            of = f" of {len(self.pressure_kpa)} chambers" if len(self.pressure_kpa) > 1 else ""
            lines = [f"log of {self.pressure_samples} pressure samples{of}{spanned(self.duration_s, self.rate_hz)}"]
            lines.append("it holds no shape: use it in a study as pressure_file, or pass it to `pliant new --from` "
                         "after the recording of the shape")  # fmt: skip
        if self.frames and self.pressure_samples:
            clock = spanned(self.pressure_duration_s, self.pressure_rate_hz)
            lines.append(f"pressure with its own times: {self.pressure_samples} samples{clock}")
        for travel, noises, unit, factor, what in ((self.travel_m, self.noise_m, "mm", 1e3, "displacement"),
                                                   (self.travel_deg, self.noise_deg, "degrees", 1.0, "rotation")):
            finite = [v for v in travel.values() if np.isfinite(v)]
            noise = [v for v in noises.values() if np.isfinite(v)]
            if finite:
                noise_text = f", noise {factor * float(np.median(noise)):.2g} {unit} (median station)" if noise else ""
                lines.append(f"largest {what} from the median {factor * max(finite):.3g} {unit}{noise_text}")
        if np.isfinite(self.out_of_plane_share):
            lines.append(f"out of the plane of bending: {100 * self.out_of_plane_share:.2g} % of the motion")
        for name, (low, high) in self.pressure_kpa.items():
            lines.append(f"pressure {name}: {low:.3g} to {high:.3g} kPa")
        for name, (low, high, unit) in self.input_range.items():
            lines.append(f"input {name}: {low:.3g} to {high:.3g} {unit}")
        lines += [f"! {finding}" for finding in self.findings] or ["no faults were found"]
        return "\n".join(lines)

    def card(self) -> Card:
        """Return the contents of the recording, its faults and a drawing of the body for display in a notebook."""
        title, *lines = self.summary().splitlines()
        return Card(title, lines, drawing=self.drawing)

    def to_dict(self) -> dict[str, Any]:
        """Return the contents and fault counts of the recording as a dict that can be written as JSON, without the
        drawing.
        """
        return {name: value for name, value in asdict(self).items() if name != "drawing"}


def spanned(duration: float, rate: float) -> str:
    """Return the text ", <duration> s at <rate> Hz" that ends a sentence; "" for a recording of a single sample."""
    return f", {duration:.2f} s at {rate:.4g} Hz" if np.isfinite(rate) else ""


def quality(recording: xr.Dataset) -> Quality:
    """Return a summary of a recording: stations, duration, rate, and counts of faults such as spikes, gaps and repeated
    frames.

    Parameters
    ----------
    recording : xarray.Dataset
        A recording.

    Returns
    -------
    Quality
        Counts and one sentence per finding. ``summary()`` returns a text; a notebook also shows a drawing of the body.

    Examples
    --------
    >>> from pliant.preprocessing.quality import quality
    >>> from pliant.recording import make_recording
    >>> places = [[[0, 0, 0], [0.01 * k, 0.1, 0]] for k in range(5)]
    >>> quality(make_recording([0.0, 0.1, 0.2, 0.3, 0.4], places)).rate_hz
    10.0
    """
    check_recording(recording)
    facts: dict[str, Any] = {}
    if "time" in recording.coords:
        facts |= _clock(recording["time"].values)
    if "position" in recording:
        facts |= _positions(recording)
    elif shape_variable(recording):
        facts |= angle_facts(recording)
    if "strain" in recording:
        lost = np.isnan(recording["strain"].values).sum((0, 2))
        facts["missing"] = {str(c): int(n) for c, n in zip(recording["core"].values, lost, strict=True) if n}
    if "pressure" in recording:
        facts |= pressure_clock(recording)
    facts |= {**_inputs(recording), "lost": known_losses(recording), "input_overlap": clock_overlap(recording)}
    if "time" not in recording.coords:
        facts |= {to: facts[of] for to, of in OF_A_LOG.items() if of in facts}
    facts["doubts"] = doubts(Case(recording, facts.get("swapped", {})), "recording")
    result = Quality(**facts)
    first = [sentence for check, sentence in result.doubts.items() if check in UNITS]  # the rest may follow from it
    later = [sentence for check, sentence in result.doubts.items() if check not in UNITS]
    clock = clock_sentences(result.pressure_samples, result.pressure_gaps, result.pressure_steps_s)
    stated = [line.removeprefix(WARNING) for line in history_of(recording) if line.startswith(WARNING)]
    findings = (*stated, *first, *loss_sentences(result.lost), *_sentences(result), *clock,
                *overlap_sentences(recording, result.input_overlap), *staircase_sentences(result.input_held),
                *glitch_sentences(result.input_glitches, _units_shown(recording)),
                *_lost_inputs(recording), *_hardly_moves(recording, result), *later)
    named = replace(result, findings=findings)
    return replace(named, drawing=recording_svg(recording, named.summary().partition("\n")[0]))


def standing_stations(recording: xr.Dataset) -> tuple[str, ...]:
    """Return the names of the stations that stay still while other stations move."""
    position = recording["position"].values
    repeated = detectors.repeated_frames(
        position, recording["quaternion"].values if "quaternion" in recording else None
    )
    fresh = position[~repeated] if repeated.any() else position
    noise, deviation = (by_blocks(f, fresh) for f in (detectors.noise_level, detectors.rms_deviation))
    return _standing([str(n) for n in recording["station"].values], deviation, noise)


def _clock(time: np.ndarray) -> dict[str, Any]:
    facts: dict[str, Any] = {"frames": len(time), "duration_s": float(time[-1] - time[0])}
    if len(time) < 2:
        return facts
    step = np.diff(time)
    middle = float(np.median(step))
    wide = np.flatnonzero(step > GAP_RATIO * middle)
    return facts | {
        "rate_hz": 1.0 / usual_step(time),
        "irregular_steps": int((np.abs(step - middle) > max(IRREGULAR_SHARE * middle, _rounding(time))).sum()),
        "gaps": tuple((float(time[i]), float(step[i])) for i in wide),
    }


def _rounding(time: np.ndarray) -> float:
    """Return 1 ms, and the rounding of that number, where all times (T,) [s] are whole milliseconds, else 0."""
    ticks = 1e3 * (time - time[0])
    return 1.001e-3 if np.abs(ticks - np.rint(ticks)).max() < 1e-3 else 0.0


def _positions(recording: xr.Dataset) -> dict[str, Any]:
    names = [str(n) for n in recording["station"].values]
    position, time = recording["position"].values, recording["time"].values
    quaternion = recording["quaternion"].values if "quaternion" in recording else None
    repeated = detectors.repeated_frames(position, quaternion)
    fresh, clock = (position[~repeated], time[~repeated]) if repeated.any() else (position, time)
    measures = (detectors.noise_level, detectors.rms_deviation, detectors.travel)
    noise, deviation, travel = (by_blocks(f, fresh) for f in measures)
    floor = detectors.fault_floor(noise, travel)
    jumped = by_blocks(lambda part, least: detectors.jumps(part, clock, least), fresh, floor)
    whole = jumped.mean(1) > 0.5
    single = jumped & ~whole[:, None]
    facts = {
        "stations": len(names), "repeated_frames": int(repeated.sum()),
        "missing": _counts(names, by_blocks(lambda part: np.isnan(part).any(2).sum(0), position)),
        "spikes": _counts(names, by_blocks(lambda part, least: detectors.spikes(part, least).sum(0), fresh, floor)),
        "station_jumps": _counts(names, single.sum(0)), "frame_jumps_s": tuple(clock[whole].tolist()),
        "noise_m": dict(zip(names, noise.tolist(), strict=True)),
        "travel_m": dict(zip(names, travel.tolist(), strict=True)),
        "standing": _standing(names, deviation, noise), "swapped": exchanged(fresh, clock, names),
        "frozen": frozen_spans(time, names, frozen(position, quaternion)),
    }  # fmt: skip
    if quaternion is not None:
        facts["sign_flips"] = _counts(names, detectors.sign_flips(quaternion))
        facts["orientation_jumps"] = _counts(names, detectors.orientation_jumps(quaternion))
        steady, _ = continuous(quaternion[~repeated])
        facts["orientation_spikes"] = _counts(names, by_blocks(lambda part: detectors.spikes(part).sum(0), steady))
    if len(names) >= DENSE_STATIONS:
        pairs = [f"{a}-{b}" for a, b in pairwise(names)]
        frames = by_blocks(lambda part: detectors.stretched(part, STRETCH_SHARE).sum(0), fresh, overlap=1)
        facts["stretched"] = _counts(pairs, frames)
    if position.shape[2] == 3 and by_blocks(lambda part: np.isfinite(part).all(2).sum(0), position).sum() > 3:
        facts["out_of_plane_share"] = detectors.out_of_plane_share(fresh)
    return facts


def _counts(names: list[str], numbers: np.ndarray) -> dict[str, int]:
    return {name: int(n) for name, n in zip(names, numbers, strict=True) if n}


def _standing(names: list[str], deviation: np.ndarray, noise: np.ndarray) -> tuple[str, ...]:
    largest = float(np.nanmax(deviation)) if np.isfinite(deviation).any() else 0.0
    limit = np.fmax(STANDING_SHARE * largest, 3.0 * np.sqrt(3.0) * np.nan_to_num(noise))
    return tuple(name for name, still in zip(names, deviation <= limit, strict=True) if still)


def _pressure_range(recording: xr.Dataset) -> dict[str, tuple[float, float]]:
    ranges = {channel.name or "p": channel.values[np.isfinite(channel.values)] / 1e3
            for channel in recorded_inputs(recording) if channel.kind == "pressure"}  # fmt: skip
    return {n: (float(v.min()), float(v.max())) if v.size else (np.nan, np.nan) for n, v in ranges.items()}


SHOWN_IN = {"tension": (1.0, "N"), "displacement": (1e3, "mm"), "angle": (float(np.rad2deg(1.0)), "degrees")}


def _units_shown(recording: xr.Dataset) -> dict[str, tuple[float, str]]:
    return {channel.name or "p": SHOWN_IN.get(channel.kind, (1e-3, "kPa")) for channel in recorded_inputs(recording)}


def _inputs(recording: xr.Dataset) -> dict[str, Any]:
    """Return the ranges of the inputs without their glitches, their update intervals, and their glitches."""
    calm = leave_out_glitches(recording)
    return {"pressure_kpa": _pressure_range(calm), "input_range": _input_range(calm),
            "input_held": staircases(recording), "input_glitches": input_glitches(recording)}  # fmt: skip


def _input_range(recording: xr.Dataset) -> dict[str, tuple[float, float, str]]:
    facts = {}
    for channel in (i for i in recorded_inputs(recording) if i.kind in SHOWN_IN):
        factor, unit = SHOWN_IN[channel.kind]
        finite = factor * channel.values[np.isfinite(channel.values)]
        facts[channel.name] = (float(finite.min(initial=np.inf)), float(finite.max(initial=-np.inf)), unit)
    return facts


def _sentences(q: Quality) -> list[str]:
    said = []
    if q.irregular_steps:
        said.append(f"the times are irregular: {q.irregular_steps} of {q.frames - 1} steps differ by more than "
                    "20 % from the median step")  # fmt: skip
    if q.gaps:
        longest = max(q.gaps, key=lambda gap: gap[1])
        said.append(f"{len(q.gaps)} gap(s) in time, the longest {longest[1]:.3g} s at {longest[0]:.3g} s")
    if q.repeated_frames:
        said.append(f"{q.repeated_frames} of {q.frames} frames repeat the previous frame "
                    f"({100 * q.repeated_frames / q.frames:.1f} %)")  # fmt: skip
    for counts, what in (
        (q.missing, "drop-outs"), (q.spikes, "spikes of one frame"), (q.station_jumps, "sudden jumps"),
        (q.sign_flips, "flips of the quaternion's sign (the orientation stays the same)"),
        (q.orientation_jumps, "jumps of orientation by more than 30 degrees (a symmetric marker cluster?)"),
        (q.orientation_spikes, "spikes of the orientation in one frame"),
        (q.stretched, "frames with spacing more than 5 % off its median"),
    ):  # fmt: skip
        if counts:
            said.append(f"{what}: {listed(counts)}")
    said += frozen_sentences(q.frozen, q.stations)
    if q.frame_jumps_s:
        times = ", ".join(f"{t:.3g}" for t in q.frame_jumps_s[:6])
        said.append(f"{len(q.frame_jumps_s)} jump(s) of whole frames, at {times} s")
    said += angle_sentences(q.step_deg)
    if q.travel_m and len(q.standing) == q.stations:
        said.append("no station moves beyond its noise")
    elif q.standing:
        few = len(q.standing) <= 6
        names = ", ".join(q.standing) if few else f"{len(q.standing)} stations, {q.standing[0]} to {q.standing[-1]}"
        said.append(f"standing still: {names}")
    return said


def _lost_inputs(recording: xr.Dataset) -> list[str]:
    lost = {
        name: int(np.isnan(recording[name].values).sum()) for name in ("pressure", "actuation") if name in recording
    }
    called = {"pressure": "pressure", "actuation": "inputs other than pressure"}
    return [f"{count} samples of {called[name]} are missing" for name, count in lost.items() if count]


def _hardly_moves(recording: xr.Dataset, q: Quality) -> list[str]:
    if "unit of length" in q.doubts or not q.travel_m or recording.sizes["station"] < 2 or not np.isfinite(
        list(q.travel_m.values())
    ).any():
        return []
    still = np.nanmax(list(q.travel_m.values())) < LEAST_TRAVEL * extent(recording["position"].values)
    return ["the body hardly moves: its largest displacement is below 1 % of its extent"] if still else []
