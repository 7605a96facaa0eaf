"""From a video to a recording of the body's shape."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from hashlib import file_digest
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from pydantic import ValidationError

from pliant.errors import InputError, explain_validation
from pliant.recording import append_history, make_recording
from pliant.recording.camera import Camera, in_plane
from pliant.video.exposure import even_exposure
from pliant.video.marks import follow_aruco, follow_dots
from pliant.video.overlay import ENDINGS, overlay
from pliant.video.pace import doubled_and_leaps, lost_in_times
from pliant.video.reel import Reel, open_reel
from pliant.video.silhouette import follow_silhouette

if TYPE_CHECKING:
    import xarray as xr

Array = np.ndarray
Method = Literal["silhouette", "dots", "aruco"]
STATIONS = 25  # of a silhouette, evenly along the body
LENGTH = 0.03  # share by which a silhouette's length may differ from its median
SPARSE = 8  # pixels to one that is compared with the frame before
MOST_GAPS = 0.5  # of the frames


@dataclass(frozen=True)
class Tracking:
    """Settings of the tracking of a video.

    Attributes
    ----------
    method : {"silhouette", "dots", "aruco"}
    base : (x, y), pixels, optional
        Where the body begins; found where its colour ends when absent.
    colour : str, optional
        Of the dots, as ``#rrggbb``.
    count : int, optional
        Dots on the body; marks of their colour that lie away from it are then left out and counted.
    region : (left, top, right, bottom), pixels, optional
        Part of the picture in which dots are looked for.
    stations : int
        Points of a silhouette, evenly along the body, base and tip among them.
    overlays : tuple of Path
        To write: the shape over some frames on one sheet (.png), over all frames as a film (.mp4).
    """

    method: Method = "silhouette"
    base: tuple[float, float] | None = None
    colour: str | None = None
    count: int | None = None
    region: tuple[float, float, float, float] | None = None
    stations: int = STATIONS
    overlays: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        """Refuse what cannot be followed."""
        if self.method not in get_args(Method):
            raise InputError(f"method is one of {', '.join(get_args(Method))}, not {self.method!r}")
        if not 4 <= self.stations <= 200:
            raise InputError(f"stations lie between 4 and 200, got {self.stations}")
        if self.method != "dots" and (self.count is not None or self.region is not None):
            raise InputError("count and region concern dots: leave them out, or follow dots")
        if strange := [p.name for p in self.overlays if p.suffix.lower() not in ENDINGS]:
            raise InputError(f"an overlay is a sheet (.png) or a film (.mp4), not {strange[0]!r}")
        if self.count is not None and (not isinstance(self.count, int) or self.count < 2):
            raise InputError(f"count is a number of dots, 2 or more, got {self.count!r:.40}")
        if self.region is not None and not _is_region(self.region):
            raise InputError(f"region is [left, top, right, bottom] in pixels, got {self.region!r:.60}")
        if (self.method == "dots") != (self.colour is not None):
            raise InputError("dots are found by their colour: give colour as '#rrggbb' with method dots, only there")

    @property
    def blue_green_red(self) -> tuple[float, float, float]:
        """The colour of the dots."""
        text = (self.colour or "").removeprefix("#")
        try:
            r, g, b = bytes.fromhex(text)
        except ValueError:
            raise InputError(f"a colour is written as '#rrggbb', not {self.colour!r}") from None
        return float(b), float(g), float(r)


def track_video(
    path: str | Path, camera: Camera | dict[str, Any], tracking: Tracking | None = None,
    *, progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Follow a bending body through a video.

    Parameters
    ----------
    path : Path
        Anything that OpenCV reads; frames are read one at a time.
    camera : Camera or dict
        Scale and view, as in a study's ``[camera]``. Without `rate_hz` the times are those of the container.
    tracking : Tracking, optional
    progress : callable, optional
        Called with the fraction of the frames that is done.

    Returns
    -------
    xarray.Dataset
        Recording in frame ``tracker``: positions (time, station, axis) [m] in the plane z = 0, x right and y up. A
        frame in which the body is hidden is a gap, as is one that repeats the frame before. What was lost, repeated or
        hidden is counted in its history; `time_uncertainty_s` bounds how early or late a time may be.

    Raises
    ------
    InputError
        When the video, the camera or what they show cannot be used; one sentence says why.
    """
    path, how = Path(path), tracking or Tracking()
    camera = _camera(camera)
    reel = open_reel(path)
    names, findings, frames = _followed(reel, how)
    times, points, change, before = list[float](), list[Array | None](), list[float](), None
    with overlay(reel, how.overlays) as draw:
        for time, picture, found in frames:
            draw(time, picture, found)
            times.append(time)
            points.append(None if found is None else found.astype(np.float32))
            sparse = picture[::SPARSE, ::SPARSE].astype(np.float32)
            change.append(float(np.abs(sparse - before).mean()) if before is not None else np.nan)
            before = sparse
            if progress is not None:
                progress(min(1.0, len(times) / reel.count))
    recording = _recording(reel, camera, how, names, _Seen(np.array(times), _stacked(points, reel), np.array(change)))
    return append_history(recording, *findings) if findings else recording


@dataclass(frozen=True)
class _Seen:
    time: Array  # (T,) s
    points: Array  # (T, S, 2) pixels
    change: Array  # (T,) levels


def _camera(camera: Camera | dict[str, Any]) -> Camera:
    if isinstance(camera, Camera):
        return camera
    try:
        return Camera.model_validate(camera)
    except ValidationError as error:
        raise explain_validation(error, "camera") from None


def _followed(reel: Reel, how: Tracking) -> tuple[list[str], list[str], Iterator[tuple[float, Array, Array | None]]]:
    """Names of the stations, empty for a silhouette's; what to tell; and what is seen frame by frame."""
    if how.method == "silhouette":
        even, findings = even_exposure(reel)
        return [], findings, follow_silhouette(even, how.base)
    if how.method == "dots":
        return [], *follow_dots(reel, how.blue_green_red, how.count, how.region)
    numbers, frames = follow_aruco(reel)
    return [f"marker_{n}" for n in numbers], [], frames


def _is_region(region: Any) -> bool:
    """Whether it is left, top, right, bottom."""
    numbers = isinstance(region, list | tuple) and all(isinstance(v, int | float) for v in region)
    return numbers and len(region) == 4 and region[0] < region[2] and region[1] < region[3]


def _stacked(points: list[Array | None], reel: Reel) -> Array:
    first = next((p for p in points if p is not None), None)
    hidden = sum(p is None or not np.isfinite(p).any() for p in points)
    if first is None or hidden > MOST_GAPS * len(points):
        raise InputError(
            f"{reel.path.name}: the body is seen whole in {len(points) - hidden} of {len(points)} frames only: keep "
            "hands and cables away from it, keep it in the picture, and put a plain sheet behind it"
        )
    return np.array([np.full(first.shape, np.nan) if p is None else p for p in points], float)


def _recording(reel: Reel, camera: Camera, how: Tracking, names: list[str], seen: _Seen) -> xr.Dataset:
    """The recording of what was seen, with its history."""
    time, findings, unsure = _times(reel, camera, seen.time)
    doubled, leaps = doubled_and_leaps(seen.points, seen.change, time)
    points = np.where(doubled[:, None, None], np.nan, seen.points)
    if how.method != "silhouette":
        points, names = _base_first(points, names, how)
    hidden = ~np.isfinite(points).all(axis=(1, 2)) & ~doubled
    position, scale = in_plane(points, camera, reel.path.parent)
    arc = None
    if how.method == "silhouette":
        position, arc, names, strange = _even(position, how.stations)
        findings.append(f"the body is {1e3 * arc[-1]:.2f} mm long in the picture")
        if strange:
            findings.append(f"{strange} frames in which its length differs by more than {100 * LENGTH:g} % are gaps")
    findings += [f"{int(hidden.sum())} of {len(time)} frames are gaps: the body was hidden, or not recognised",
             f"{int(doubled.sum())} frames repeat the one before and are gaps"]  # fmt: skip
    if leaps.any():
        findings.append(f"{int(leaps.sum())} steps are twice as long as their neighbours: frames may be missing")
    with reel.path.open("rb") as file:
        digest = file_digest(file, "sha256").hexdigest()
    return make_recording(
        time, position, station=names, arc_length=arc, source=reel.path.name, source_format="video",
        source_sha256=digest, attrs={"time_uncertainty_s": unsure},
        history=[f"followed {how.method} through {len(time)} frames of {reel.path.name}", scale, *findings],
    )


def _times(reel: Reel, camera: Camera, time: Array) -> tuple[Array, list[str], float]:
    """Times (T,) [s] of the middle of each exposure, how they came to be, and how far off they may be [s]."""
    findings = []
    if camera.rate_hz is not None:
        if abs(camera.rate_hz / reel.rate - 1.0) > 0.02:
            rates = f"{reel.rate:.4g} frames a second, [camera] {camera.rate_hz:.4g}"
            findings.append(f"the file says {rates}, which is used")
        time = np.arange(len(time)) / camera.rate_hz
    if (np.diff(time) <= 0).any():
        raise InputError(f"{reel.path.name}: its times do not increase: say rate_hz in [camera]")
    missing, places = lost_in_times(time)
    findings.append(f"{missing} frames are missing at {places} places of the file's times")
    period = float(np.median(np.diff(time)))
    open_s = 1e-3 * camera.exposure_ms if camera.exposure_ms is not None else None
    read_s = 1e-3 * camera.readout_ms if camera.readout_ms is not None else None
    unsure = (0.0 if open_s is not None else 0.5 * period) + 0.5 * (read_s if read_s is not None else period)
    shutter = f"open for {1e3 * open_s:g} ms" if open_s is not None else "open for an unknown time"
    rows = f"its rows within {1e3 * read_s:g} ms" if read_s is not None else "its rows within an unknown time"
    findings.append(f"times are the middle of the exposure, known to {1e3 * unsure:.1f} ms: shutter {shutter}, {rows}")
    return time + 0.5 * (open_s if open_s is not None else period), findings, unsure


def _base_first(points: Array, names: list[str], how: Tracking) -> tuple[Array, list[str]]:
    """Marks in their order from the base: the end nearest to it, or the one that moves less."""
    ends = points[:, [0, -1]]
    if how.base is not None:
        apart = np.nanmedian(np.linalg.norm(ends - np.array(how.base), axis=2), axis=0)
    else:
        apart = np.linalg.norm(np.nanstd(ends, axis=0), axis=1)
    count = points.shape[1]
    names = names or [f"dot_{k + 1}" for k in range(count)]
    if apart[0] <= apart[1]:
        return points, names
    return points[:, ::-1], (names[::-1] if how.method == "aruco" else names)


def _even(position: Array, stations: int) -> tuple[Array, Array, list[str], int]:
    """Stations (T, N, 3) evenly along the body, their arc length (N,) [m], names, and how many frames were dropped."""
    from scipy.interpolate import CubicSpline

    along = np.cumsum(np.linalg.norm(np.diff(position, axis=1), axis=2), axis=1)
    along = np.concatenate([np.zeros((len(position), 1)), along], axis=1)
    length = float(np.nanmedian(along[:, -1]))
    with np.errstate(invalid="ignore"):
        strange = np.abs(along[:, -1] / length - 1.0) > LENGTH
    made = np.full((len(position), stations, 3), np.nan)
    share = np.linspace(0.0, 1.0, stations)
    for k in np.flatnonzero(np.isfinite(along[:, -1]) & ~strange):
        made[k] = CubicSpline(along[k], position[k])(share * along[k, -1])
    names = ["base", *(f"s{k:02d}" for k in range(1, stations - 1)), "tip"]
    return made, share * length, names, int(strange.sum())
