"""First look at a user's files: what each contains, its alignment, and the excitation that it shows."""

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
RIGID_SHARE, RIGID_M = 0.02, 1e-3  # permitted change of distances within a rigid part, relative and in metres
LINE = 0.15  # markers narrower than this fraction of their length lie along a body, not on a plate
OUT_OF_PLANE = 0.15  # out-of-plane fraction of the motion: tracked bodies that bend in a plane show up to 0.12
DRIVEN = 0.05  # of the widest pressure range: a pressure with a smaller range drives nothing
FEWEST_SHOWING = 3  # stations with the base: so few can always be explained by the bend of some part
MUCH_BETTER = 0.5  # a bend of a part is used if its squared error is below this fraction of an even bend's
RETURNED = 0.3  # of the peak displacement: a body that ends below this has returned


@dataclass(frozen=True)
class FirstLook:
    """The content of one file at first reading, with its trial alignment.

    Attributes
    ----------
    path : Path
    recording : xarray.Dataset
    found : Quality
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
    made_up : dict
        Mapping entries that were assumed in order to read the file: a camera, or units.
    log : Path or None
        File of the pressure log, if it is separate. `recording` then holds its pressure, on the log's own clock.
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
        """Return the name of the recording in the study, made from the file name."""
        return re.sub(r"[^A-Za-z0-9_-]+", "_", self.path.stem) or "recording"

    @property
    def grouped(self) -> xr.Dataset:
        """Return the recording with one station for each cluster of markers."""
        return assemble(self.recording, self.stations) if self.stations else self.recording

    @property
    def base(self) -> str:
        """Return the name of the base station."""
        report = json.loads(str(self.recording.attrs.get("alignment", "{}")))
        return str(self.options.get("base") or report.get("base") or self.recording["station"].values[0])

    @property
    def scaled(self) -> bool:
        """Return whether the file was read without assumed scale or units."""
        return not self.made_up

    @property
    def turns(self) -> bool:
        """Return whether the file holds angles and no positions."""
        return "position" not in self.recording

    @property
    def shown(self) -> np.ndarray:
        """Return the last station's motion (T, axes): position [m], or angle [rad] if the file holds angles alone."""
        recording = self.recording if self.aligned is None else self.aligned
        last = recording["angle"].values[:, -1:, None] if self.turns else recording["position"].values[:, -1:]
        return without_spikes(last)[:, 0]

    @property
    def out_of_plane(self) -> float:
        """Return the fraction of the motion out of its best-fit plane; 0 if the file is planar or nothing moves."""
        share, moves = self.found.out_of_plane_share, len(self.found.standing) < self.found.stations
        return float(share) if np.isfinite(share) and moves else 0.0

    @property
    def spatial(self) -> bool:
        """Return whether the file shows a body that moves in space."""
        frame = self.recording.attrs["frame"]
        return frame == "spatial" or (frame == "tracker" and (self.out_of_plane > OUT_OF_PLANE or bool(self.cords)))

    @property
    def chambers(self) -> list[str]:
        """Return the names of the pressures if there are several; for a body in a plane only those that vary."""
        names, ranges = several(self.recording), self.pressure_ranges
        widest = max(ranges.values(), default=0.0)
        return names if self.spatial else [n for n in names if ranges.get(n, 0.0) > DRIVEN * widest]

    @property
    def pressure_ranges(self) -> dict[str, float]:
        """Return the difference between highest and lowest value of each pressure [kPa]."""
        return {name: high - low for name, (low, high) in self.found.pressure_kpa.items()}

    @property
    def cords(self) -> list[RecordedInput]:
        """Return the inputs other than pressure, which drive tendons."""
        return [one for one in recorded_inputs(self.recording) if one.kind != "pressure"]

    @property
    def widest(self) -> float:
        """Return the largest peak displacement [m] of a station, or the largest rotation [degrees] for angles."""
        return max((self.found.travel_deg if self.turns else self.found.travel_m).values())

    @property
    def dense(self) -> bool:
        """Return whether the file has enough stations to describe the shape all along the body."""
        count = len(self.stations) or int(self.recording.sizes["station"])
        return not self.turns and count >= DENSE_STATIONS

    @property
    def capped(self) -> bool:
        """Return whether the file states that a cap marks the tip."""
        return "cap_curvature" in self.recording.attrs and "cap_length" in self.recording.attrs

    @property
    def highest_pa(self) -> float | None:
        """Return the measured pressure farthest from 0 or the level in the file's name [Pa]; None if unknown."""
        if "pressure" in self.recording:
            return peak(self.recording["pressure"].values)
        named = LEVEL.search(self.path.stem)
        return float(named[1]) * pascal_per(named[2]) if named else None


def look_with_log(path: Path, log: Path | None, mapping: Mapping[str, Any] | None = None) -> FirstLook:
    """Read a file as `look_at` does, and take its pressure from a separate log if one is given."""
    look = look_at(path, mapping)
    if log is None:
        return look
    recording = with_pressure(look.recording, read(log), look.name, log.name)
    found = quality(recording)
    known = replace(look.found, pressure_kpa=found.pressure_kpa, doubts=found.doubts)
    return replace(look, recording=recording, log=log, found=known)


def look_at(path: Path, mapping: Mapping[str, Any] | None = None) -> FirstLook:
    """Read a file, assess its quality, group its markers and try to align it in the plane.

    Parameters
    ----------
    path : Path
    mapping : dict, optional
        See `pliant.read`.

    Raises
    ------
    InputError
        When the file cannot be read, or holds neither positions nor angles.
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
    """Return the first look with its recording aligned in space.

    Raises
    ------
    InputError
        When the file holds angles alone, or positions that are planar already.
    """
    if look.turns or look.recording.attrs["frame"] == "planar":
        raise InputError(f"{look.path.name} holds {'angles alone' if look.turns else 'a planar recording'}: a study in "
                         "space needs the three-dimensional positions of the tracker")  # fmt: skip
    if look.recording.attrs["frame"] == "spatial" or look.capped:
        return look
    try:
        with units_first(look.found.doubts):
            return replace(look, aligned=align(look.grouped, **look.options, space=True), problem="")
    except InputError as error:
        return replace(look, aligned=None, problem=str(error))


def from_one_side(looks: Sequence[FirstLook]) -> list[FirstLook]:
    """Return the looks with all planar recordings aligned to the first one's plane normal, so that x is the same."""
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
    """Group markers on one rigid part by their names: ``Tip - 1``, ``Tip - 2``, ... become ``tip``; base first.

    The result is empty unless there are at least two groups, one of them with three markers or more.
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
    """Return the marker groups suggested by names that can be rigid plates; other markers become stations of one.

    The result is empty if no group has more than one marker.
    """
    groups = clusters([str(s) for s in recording["station"].values])
    found: dict[str, list[str]] = {}
    for name, markers in groups.items():
        plate = len(markers) < DENSE_STATIONS and rigid(recording, markers)
        found |= {name: markers} if plate else {m: [m] for m in markers}
    return found if any(len(markers) > 1 for markers in found.values()) else {}


def rigid(recording: xr.Dataset, markers: Sequence[str]) -> bool:
    """Return whether markers can sit on one rigid plate: not on a line, and at nearly constant distances."""
    position = recording["position"].sel(station=list(markers)).values
    apart = np.linalg.norm(position[:, :, None] - position[:, None], axis=-1)
    apart = apart[np.isfinite(apart).all(axis=(1, 2))]
    if not len(apart):
        return True  # never visible together: rigidity cannot be tested
    low, high = np.percentile(apart, [5, 95], axis=0)
    still = bool((high - low <= np.maximum(RIGID_M, RIGID_SHARE * high)).all())
    shape = position[np.argmax(np.isfinite(position).all(axis=(1, 2)))]
    size = np.linalg.svd(shape - shape.mean(axis=0), compute_uv=False)
    return still and (len(markers) < 3 or bool(size[1] > LINE * size[0]))


def directions(
    recording: xr.Dataset, found: Quality, stations: Mapping[str, list[str]], *, dense: bool
) -> dict[str, Any]:
    """Return options of `align`, with the station named base, else one that does not move, else the first, as base."""
    names = list(stations) or [str(s) for s in recording["station"].values]
    named = [n for n in names if "base" in n.lower()]
    standing = [n for n in found.standing if n in names] if len(found.standing) < len(names) else []
    base = (named or ([] if dense else standing) or names)[0]
    options: dict[str, Any] = {"base": base, "tangent": "clamp" if dense else "chord"}
    if found.orientation_jumps:
        options["undo_jumps"] = True
    return options


def azimuths(recording: xr.Dataset) -> list[float]:
    """Return the azimuth of each pressure's chamber [degrees, 0 to 360] from x towards y, from the last station's
    motion.

    A chamber bends the body away from itself. The station's displacement is assumed to be linear in all pressures.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording in the base frame, in space.
    """
    gain = -sideways(recording)[:, -1]
    return [float(a) for a in np.degrees(np.arctan2(gain[:, 1], gain[:, 0])) % 360.0]


def sideways(recording: xr.Dataset) -> np.ndarray:
    """Return the linear gain of stations' displacement across the base tangent [m] for each input (C, S, 1 or 2)."""
    across = without_spikes(recording["position"].values)[..., :-1]
    inputs = inputs_at(recording, recording["time"].values)
    design = np.column_stack([inputs, np.ones(len(inputs))])
    gain = np.full((inputs.shape[1], *across.shape[1:]), np.nan)
    for s in range(across.shape[1]):
        known = np.isfinite(across[:, s]).all(axis=1) & np.isfinite(inputs).all(axis=1)
        gain[:, s] = np.linalg.lstsq(design[known], across[known, s], rcond=None)[0][:-1]
    return gain


def chamber_span(recording: xr.Dataset, name: str) -> tuple[int, float, float]:
    """Return the side to which a chamber bends a planar body (1 or -1), and where the bend begins and ends [m from
    base].

    The bend is assumed to be even between two points at tenths of the body, and the body straight elsewhere. If
    no part explains the displacements of the stations much better, the bend is assumed to be even over the whole body.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording in the base frame, in a plane.
    name : str
        Name of the chamber.
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
    """Return the sideways displacement at heights (S,) [m] of a body of unit curvature from `begin` to `end` [m]."""
    bent = np.clip(height, begin, end) - begin
    return np.asarray(bent * (height - begin - 0.5 * bent))


def tendon_ends(recording: xr.Dataset) -> list[tuple[float, float]]:
    """Return for each input the azimuth of its tendon [degrees] and where it ends [m along the base tangent at rest].

    A tendon is assumed to bend the body towards itself, evenly from the base to one of the stations, and to leave it
    straight beyond. The end is the station with which this best explains the displacements of all stations.

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
    """Return the length of the body [m], along the stations or from base to tip at rest; None if it is unknown."""
    if look.aligned is None or look.capped or look.turns or not look.scaled:
        return None
    if "arc_length" in look.aligned.coords:
        return float(look.aligned["arc_length"].values[-1])
    first = look.shown[:10]
    return float(np.linalg.norm(np.nanmedian(first, axis=0)))


def excitation(look: FirstLook) -> Excitation:
    """Return the excitation that the file shows: "trace" (measured input), "pulse", "step" or "release"."""
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
    """Return the name of the recording to hold out; None if there is only one.

    It is the recording with the middle pressure (of two, the lower), so that the test does not extrapolate. If some
    pressure is unknown, the peak displacement decides instead. If only some recordings drive several chambers together,
    one of these is held out, so that the fit has the effect of each chamber alone.
    """
    if len(looks) < 2:
        return None
    together = [look for look in looks if len(look.chambers) > 1]
    looks = together if len(together) < len(looks) and together else looks
    known = all(look.highest_pa is not None for look in looks)
    listed = sorted(looks, key=lambda look: abs(look.highest_pa or 0.0) if known else look.widest)
    return listed[(len(looks) - 1) // 2].name


def moved(look: FirstLook) -> str:
    """Return the begin and end of the motion as a comment, or "" if they are unknown."""
    if look.aligned is None or not look.scaled or excitation(look) == "trace":
        return ""
    stations = tuple(str(n) for n in look.aligned["station"].values if look.turns or n != look.base)
    recording = look.aligned.assign_attrs(nominal_pressure=1.0)  # any level, since only the times are used
    try:
        found = edges(experiment(look.name, recording, stations=stations, excitation=excitation(look)))
    except InputError:
        return ""
    return ", ".join(f"{what} near {time:.2f} s" for what, time in found.items())
