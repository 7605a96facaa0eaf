"""A first study for a user's own files: look at them, write what they tell, mark what only the user knows."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pliant.errors import InputError
from pliant.identification import experiment
from pliant.identification.edges import edges
from pliant.identification.recorded import Excitation
from pliant.numerics.peak import peak
from pliant.preprocessing.align import DENSE_STATIONS, align
from pliant.preprocessing.alignment import alignment_of
from pliant.preprocessing.angles import from_rest
from pliant.preprocessing.clusters import assemble
from pliant.preprocessing.detectors import without_spikes
from pliant.preprocessing.held import leave_out_frozen
from pliant.preprocessing.quality import Quality, quality
from pliant.recording import read
from pliant.recording.inputs import RecordedInput, inputs_at, recorded_inputs
from pliant.study.clocks import with_pressure
from pliant.study.doubts import units_first
from pliant.study.first_reading import read_or_guess, several
from pliant.units import PASCAL, pascal_per

LEVEL = re.compile(rf"(\d+(?:\.\d+)?)[ _-]?({'|'.join(PASCAL)})(?![a-z])", re.IGNORECASE)
NUMBERED = re.compile(r"(.*?)[ _.:-]*\d+")  # "Tip - 1" belongs to "Tip"
RIGID_SHARE, RIGID_M = 0.02, 1e-3  # what distances within a rigid part may change, of themselves and in metres
LINE = 0.15  # markers whose width is below this share of their length lie along a body, not on a plate
OUT_OF_PLANE = 0.15  # of the motion, out of its best plane: tracked bodies that bend in one show up to 0.12
DRIVEN = 0.05  # of the widest range of a pressure: one that moves by less drives nothing
FEWEST_SHOWING = 3  # stations, that of the base with them: so few lie on an even bend of one part or another
MUCH_BETTER = 0.5  # of the squared errors of an even bend: a part of the body explains more than that
RETURNED = 0.3  # of the travel: what a pulse leaves at its end, and a release does not undo


@dataclass(frozen=True)
class FirstLook:
    """Contents of one file at first reading.

    Attributes
    ----------
    path : Path
    recording : xarray.Dataset
    found : Quality
    mapping : dict or None
    stations : dict
        Marker clusters, name -> markers; empty where every marker is a station.
    options : dict
        Of `align`.
    aligned : xarray.Dataset or None
        None when the alignment failed.
    problem : str
        Why it failed.
    made_up : dict
        What nobody said and was made up to read the file, for its shape alone: a camera, or units.
    log : Path or None
        Log of the pressure in a file of its own; `recording` then holds it, on its own clock.
    """

    path: Path
    recording: xr.Dataset
    found: Quality
    mapping: dict[str, Any] | None
    stations: dict[str, list[str]] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)
    aligned: xr.Dataset | None = None
    problem: str = ""
    made_up: dict[str, Any] = field(default_factory=dict)
    log: Path | None = None

    @property
    def name(self) -> str:
        """Name of the recording in the study."""
        return re.sub(r"[^A-Za-z0-9_-]+", "_", self.path.stem) or "recording"

    @property
    def grouped(self) -> xr.Dataset:
        """The recording, with one station for each cluster of markers."""
        return assemble(self.recording, self.stations) if self.stations else self.recording

    @property
    def base(self) -> str:
        """Name of the base station."""
        report = json.loads(str(self.recording.attrs.get("alignment", "{}")))
        return str(self.options.get("base") or report.get("base") or self.recording["station"].values[0])

    @property
    def scaled(self) -> bool:
        """Whether nothing was made up to read the file."""
        return not self.made_up

    @property
    def turns(self) -> bool:
        """Whether the file holds angles and no places."""
        return "position" not in self.recording

    @property
    def shown(self) -> np.ndarray:
        """Return the motion of the last station (T, axes): its position, or its angle where the file holds angles
        alone.
        """
        recording = self.recording if self.aligned is None else self.aligned
        last = recording["angle"].values[:, -1:, None] if self.turns else recording["position"].values[:, -1:]
        return without_spikes(last)[:, 0]

    @property
    def out_of_plane(self) -> float:
        """Share of the motion out of its best plane; 0 where the file is planar or nothing moves beyond the noise."""
        share, moves = self.found.out_of_plane_share, len(self.found.standing) < self.found.stations
        return float(share) if np.isfinite(share) and moves else 0.0

    @property
    def spatial(self) -> bool:
        """Whether the body moves in space, as far as the file shows it."""
        frame = self.recording.attrs["frame"]
        return frame == "spatial" or (frame == "tracker" and (self.out_of_plane > OUT_OF_PLANE or bool(self.cords)))

    @property
    def chambers(self) -> list[str]:
        """Names of the pressures where there are several, of a body in a plane those that move."""
        names, ranges = several(self.recording), self.pressure_ranges
        widest = max(ranges.values(), default=0.0)
        return names if self.spatial else [n for n in names if ranges.get(n, 0.0) > DRIVEN * widest]

    @property
    def pressure_ranges(self) -> dict[str, float]:
        """Highest less lowest value of each pressure, kPa."""
        return {name: high - low for name, (low, high) in self.found.pressure_kpa.items()}

    @property
    def cords(self) -> list[RecordedInput]:
        """Inputs other than pressure: those of tendons."""
        return [one for one in recorded_inputs(self.recording) if one.kind != "pressure"]

    @property
    def widest(self) -> float:
        """Largest travel of a station, m, or turn, degrees."""
        return max((self.found.travel_deg if self.turns else self.found.travel_m).values())

    @property
    def dense(self) -> bool:
        """Whether the shape is known all along the body."""
        count = len(self.stations) or int(self.recording.sizes["station"])
        return not self.turns and count >= DENSE_STATIONS

    @property
    def capped(self) -> bool:
        """Whether the file says that a cap marks the tip."""
        return "cap_curvature" in self.recording.attrs and "cap_length" in self.recording.attrs

    @property
    def highest_pa(self) -> float | None:
        """Measured pressure farthest from 0, or the level in the file's name, Pa; None when neither is known."""
        if "pressure" in self.recording:
            return peak(self.recording["pressure"].values)
        named = LEVEL.search(self.path.stem)
        return float(named[1]) * pascal_per(named[2]) if named else None


def look_with_log(path: Path, log: Path | None, mapping: Mapping[str, Any] | None = None) -> FirstLook:
    """Look at a file, and take its pressure from a log beside it where there is one; as `look_at`."""
    look = look_at(path, mapping)
    if log is None:
        return look
    recording = with_pressure(look.recording, read(log), look.name, log.name)
    found = quality(recording)
    known = replace(look.found, pressure_kpa=found.pressure_kpa, doubts=found.doubts)
    return replace(look, recording=recording, log=log, found=known)


def look_at(path: Path, mapping: Mapping[str, Any] | None = None) -> FirstLook:
    """Read a file, judge it, group its markers and try its alignment in the plane.

    Parameters
    ----------
    path : Path
    mapping : dict, optional
        See `pliant.read`.

    Raises
    ------
    InputError
        When the file cannot be read, or holds no positions.
    """
    kept = dict(mapping) if mapping else None
    recording, made_up = read_or_guess(path, kept)
    if not {"position", "angle"} & set(recording):
        held = (
            "the strain of a fibre: describe its cores in a mapping file (table [cores]) and give that by --mapping"
            if "strain" in recording
            else "pressure alone: a study needs the shape too"
        )
        raise InputError(f"{path.name} holds {held}")
    found = quality(recording)
    look = FirstLook(path, recording := leave_out_frozen(recording), found, kept, made_up=made_up)
    if look.turns:
        return replace(look, aligned=from_rest(recording))
    if recording.attrs["frame"] != "tracker":
        return replace(look, aligned=recording)
    look = replace(look, stations=rigid_clusters(recording))
    look = replace(look, options=directions(recording, found, look.stations, dense=look.dense))
    if look.capped:
        return look
    try:
        with units_first(found.doubts):
            return replace(look, aligned=align(look.grouped, **look.options))
    except InputError as error:
        return replace(look, problem=str(error))


def in_space(look: FirstLook) -> FirstLook:
    """The look with its recording aligned in space.

    Raises
    ------
    InputError
        When the file holds angles alone, or positions that are planar already.
    """
    if look.turns or look.recording.attrs["frame"] == "planar":
        raise InputError(f"{look.path.name} holds {'angles alone' if look.turns else 'a planar recording'}: a study in "
                         "space needs the positions as the tracker has them")  # fmt: skip
    if look.recording.attrs["frame"] == "spatial" or look.capped:
        return look
    try:
        with units_first(look.found.doubts):
            return replace(look, aligned=align(look.grouped, **look.options, space=True), problem="")
    except InputError as error:
        return replace(look, aligned=None, problem=str(error))


def from_one_side(looks: Sequence[FirstLook]) -> list[FirstLook]:
    """The looks with their recordings in a plane seen from the side of the first, as a study of several chambers."""
    done: list[FirstLook] = []
    normal = None
    for look in looks:
        one = look
        if look.aligned is not None and "alignment" in look.aligned.attrs:
            if normal is None:
                normal = np.array(alignment_of(look.aligned).normal)
            else:
                one = replace(look, aligned=align(look.grouped, **look.options, plane=normal, bend=None))
        done.append(one)
    return done


def clusters(names: Sequence[str]) -> dict[str, list[str]]:
    """Markers on one rigid part, by their names: ``Tip - 1``, ``Tip - 2``, ... -> ``tip``; base first.

    Empty unless at least two groups come out, one with three markers or more.
    """
    groups: dict[str, list[str]] = {}
    for name in names:
        match = NUMBERED.fullmatch(name)
        label = re.sub(r"[^a-z0-9]+", "_", (match[1] if match and match[1] else name).lower()).strip("_")
        groups.setdefault(label or name, []).append(name)
    if len(groups) < 2 or max(map(len, groups.values())) < 3:
        return {}
    return dict(sorted(groups.items(), key=lambda item: "base" not in item[0]))


def rigid_clusters(recording: xr.Dataset) -> dict[str, list[str]]:
    """The groups that names suggest, where they can be plates: off one line, and keeping their distances."""
    groups = clusters([str(s) for s in recording["station"].values])
    found: dict[str, list[str]] = {}
    for name, markers in groups.items():
        plate = len(markers) < DENSE_STATIONS and rigid(recording, markers)
        found |= {name: markers} if plate else {m: [m] for m in markers}
    return found if any(len(markers) > 1 for markers in found.values()) else {}


def rigid(recording: xr.Dataset, markers: Sequence[str]) -> bool:
    """Whether markers can sit on one plate: not on a line, and their distances hardly change (5 to 95 % of frames)."""
    place = recording["position"].sel(station=list(markers)).values
    apart = np.linalg.norm(place[:, :, None] - place[:, None], axis=-1)
    apart = apart[np.isfinite(apart).all(axis=(1, 2))]
    if not len(apart):
        return True  # never seen together: what is rigid is not known
    low, high = np.percentile(apart, [5, 95], axis=0)
    still = bool((high - low <= np.maximum(RIGID_M, RIGID_SHARE * high)).all())
    shape = place[np.argmax(np.isfinite(place).all(axis=(1, 2)))]
    size = np.linalg.svd(shape - shape.mean(axis=0), compute_uv=False)
    return still and (len(markers) < 3 or bool(size[1] > LINE * size[0]))


def directions(
    recording: xr.Dataset, found: Quality, stations: Mapping[str, list[str]], *, dense: bool
) -> dict[str, Any]:
    """Options of `align`: the base by its name, else what stands still, else the first."""
    names = list(stations) or [str(s) for s in recording["station"].values]
    named = [n for n in names if "base" in n.lower()]
    standing = [n for n in found.standing if n in names] if len(found.standing) < len(names) else []
    base = (named or ([] if dense else standing) or names)[0]
    options: dict[str, Any] = {"base": base, "tangent": "clamp" if dense else "chord"}
    if found.orientation_jumps:
        options["undo_jumps"] = True
    return options


def azimuths(recording: xr.Dataset) -> list[float]:
    """Azimuth of each pressure's chamber [degrees] from x towards y, 0 to 360, by the motion of the last station.

    A chamber bends the body away from itself. The station's displacement is taken for linear in all pressures.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording in the base frame, in space.
    """
    gain = -sideways(recording)[:, -1]
    return [float(a) for a in np.degrees(np.arctan2(gain[:, 1], gain[:, 0])) % 360.0]


def sideways(recording: xr.Dataset) -> np.ndarray:
    """Displacement (C, S, 1 or 2) of each station across the base tangent for a unit of each input, as if linear."""
    across = without_spikes(recording["position"].values)[..., :-1]
    inputs = inputs_at(recording, recording["time"].values)
    design = np.column_stack([inputs, np.ones(len(inputs))])
    gain = np.full((inputs.shape[1], *across.shape[1:]), np.nan)
    for s in range(across.shape[1]):
        known = np.isfinite(across[:, s]).all(axis=1) & np.isfinite(inputs).all(axis=1)
        gain[:, s] = np.linalg.lstsq(design[known], across[known, s], rcond=None)[0][:-1]
    return gain


def chamber_span(recording: xr.Dataset, name: str) -> tuple[int, float, float]:
    """Side to which a chamber bends a body in a plane, 1 or -1, and where its bend begins and ends [m from the base].

    The bend is taken for even between two tenths of the body, and the body for straight beyond; for even in all of it
    where no part explains the displacements of the stations much better.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording in the base frame, in a plane.
    name : str
        Of the chamber, which the recording drives.
    """
    gain = sideways(recording)[several(recording).index(name), :, 0]
    height = np.nanmedian(recording["position"].values[:10, :, -1], axis=0)
    seen = np.isfinite(gain) & np.isfinite(height)
    marks = np.linspace(0.0, np.nanmax(height), 11)
    found = []
    parts = list(combinations(marks, 2)) if seen.sum() > FEWEST_SHOWING else []
    for begin, end in [(0.0, marks[-1]), *parts]:
        shape = even_bend(height, begin, end)[seen]
        curvature = float(shape @ gain[seen] / (shape @ shape))
        missed = float(((gain[seen] - shape * curvature) ** 2).sum())
        found.append((missed, -1 if curvature > 0 else 1, begin, end))
    best = min(found)
    return (best if best[0] < MUCH_BETTER * found[0][0] else found[0])[1:]


def even_bend(height: np.ndarray, begin: float, end: float | np.ndarray) -> np.ndarray:
    """Displacement sideways at heights (S,) [m] of a body of unit curvature from `begin` to `end` [m]."""
    bent = np.clip(height, begin, end) - begin
    return np.asarray(bent * (height - begin - 0.5 * bent))


def tendon_ends(recording: xr.Dataset) -> list[tuple[float, float]]:
    """Azimuth [degrees] of the tendon of each input, and where it ends [m along the base tangent at rest].

    A tendon bends the body towards itself, evenly from the base to one of the stations, and leaves it straight beyond:
    the end is the station for which that explains the displacements of all stations best.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording in the base frame, in space, without input 0 in any channel.
    """
    height = np.nanmedian(recording["position"].values[:10, :, 2], axis=0)
    ends = np.sort(height[height > 0.05 * height.max()])
    shapes = even_bend(height, 0.0, ends[:, None])  # (E, S)
    found = []
    for gain in sideways(recording):
        seen = np.isfinite(gain).all(axis=1)
        curvature = shapes[:, seen] @ gain[seen] / (shapes[:, seen] ** 2).sum(axis=1)[:, None]  # (E, 2)
        missed = ((gain[seen] - shapes[:, seen, None] * curvature[:, None]) ** 2).sum(axis=(1, 2))
        best = int(np.argmin(missed))
        towards = curvature[best]
        found.append((float(np.degrees(np.arctan2(towards[1], towards[0])) % 360.0), float(ends[best])))
    return found


def body_length(look: FirstLook) -> float | None:
    """Length of the body as far as the file shows it, m: along the stations, or from base to tip at rest."""
    if look.aligned is None or look.capped or look.turns or not look.scaled:
        return None
    if "arc_length" in look.aligned.coords:
        return float(look.aligned["arc_length"].values[-1])
    first = look.shown[:10]
    return float(np.linalg.norm(np.nanmedian(first, axis=0)))


def excitation(look: FirstLook) -> Excitation:
    """"trace", "pulse", "step" or "release", as far as the file shows it."""
    if {"pressure", "actuation"} & set(look.recording):
        return "trace"
    if look.aligned is None:
        return "pulse"
    p = look.shown
    u = np.linalg.norm(p - np.nanmedian(p[:5], axis=0), axis=-1)
    end = np.nanmedian(u[-max(5, len(u) // 20):])
    if end < RETURNED * np.nanmax(u):
        return "pulse"
    return "release" if look.highest_pa is None else "step"


def held_out(looks: Sequence[FirstLook]) -> str | None:
    """Name of the recording to predict: the one with the middle pressure, of two the lower, so that none is beyond.

    Where a pressure is not known, the one of middle travel: the others then lie on both sides of it. Where some
    recordings drive several chambers, one of those: what each chamber does alone is learnt.
    """
    if len(looks) < 2:
        return None
    together = [look for look in looks if len(look.chambers) > 1]
    looks = together if len(together) < len(looks) and together else looks
    known = all(look.highest_pa is not None for look in looks)
    listed = sorted(looks, key=lambda look: abs(look.highest_pa or 0.0) if known else look.widest)
    return listed[(len(looks) - 1) // 2].name


def moved(look: FirstLook) -> str:
    """Return begin and end of the motion as a comment; empty if they are not known."""
    if look.aligned is None or not look.scaled or excitation(look) == "trace":
        return ""
    stations = tuple(str(n) for n in look.aligned["station"].values if look.turns or n != look.base)
    recording = look.aligned.assign_attrs(nominal_pressure=1.0)  # any level: only times are asked for
    try:
        found = edges(experiment(look.name, recording, stations=stations, excitation=excitation(look)))
    except InputError:
        return ""
    return ", ".join(f"{what} near {time:.2f} s" for what, time in found.items())
