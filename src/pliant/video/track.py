"""Track the shape of a soft body in a video and return it as a recording. Lost and repeated frames are counted."""

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
from pliant.recording.stated import WARNING, Stated, judge_stated
from pliant.video.marks import follow_aruco, follow_dots
from pliant.video.overlay import ENDINGS, overlay
from pliant.video.reel import Reel, even_exposure, open_reel
from pliant.video.silhouette import follow_silhouette

if TYPE_CHECKING:
    import xarray as xr

Array = np.ndarray
Method = Literal["silhouette", "dots", "aruco"]
STATIONS = 25  # default number of stations of a silhouette
LENGTH = 0.03  # accepted relative deviation of a silhouette's length from its median
SPARSE = 8  # step between the pixels that are compared with the previous frame
MOST_GAPS = 0.5  # largest fraction of frames that may be gaps
MOVES = 0.7  # pixels per frame: a repeated frame is detectable only in faster motion
STANDS, LEAPS = 0.2, 1.7  # relative to the neighbours' steps: of a repeated frame, and after a lost one
ALIKE = 0.35  # relative to the neighbours' change of the picture: of a repeated frame


FEW = 0.1  # of the frames of a container that may list frames which are not shown, such as those before a cut
UNSTATED = 0xFFFFFFFF


def stated_bytes(path: Path) -> int:
    """Return the number of bytes that the chunks of an AVI file, or the boxes of an MP4 or MOV file, state; 0 for other
    containers and for files that do not state it.

    Sources: Microsoft, AVI RIFF File Reference; ISO/IEC 14496-12, 4.2
    """
    size, position = path.stat().st_size, 0
    with path.open("rb") as file:
        head = file.read(12)
        riff = head.startswith(b"RIFF")
        if not riff and head[4:8] not in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"):
            return 0
        while position + 8 <= size:
            file.seek(position)
            head = file.read(16)
            length = int.from_bytes(head[4:8], "little") + 8 if riff else int.from_bytes(head[:4], "big")
            if riff and length - 8 in (0, UNSTATED):  # of a recording that was not closed
                return 0
            if not riff and length == 1:
                length = int.from_bytes(head[8:16], "big")
            if not riff and length < 8:  # the last box takes the rest of the file
                return size
            if riff and head[:4] not in (b"RIFF", b"JUNK", b"idx1"):
                return size
            position += length + (length % 2 if riff else 0)
    return position - (1 if riff and position == size + 1 else 0)


def judge_film(path: Path, stated: int, read: int, *, incomplete: bool) -> list[str]:
    """Return warnings where fewer frames were decoded than a film states, or where its file is shorter than it states.

    Raises
    ------
    InputError
        When the file is truncated or frames are lost, unless `incomplete` accepts that.
    """
    length, size = stated_bytes(path), path.stat().st_size
    lost = stated - read
    with path.open("rb") as file:
        avi = file.read(4) == b"RIFF"
    if lost <= 0 and length <= size:
        return []
    if length <= size and not avi and lost <= max(1, FEW * stated):
        return [f"{WARNING}{path.name} states {stated} frames, but {read} of {stated} were decoded"]
    entries = [Stated("frames", "its index", stated, read, "at least"),
               Stated("bytes", "its container", length, size, "at least")]  # fmt: skip
    return judge_stated(entries, path.name, incomplete=incomplete, place="[tracking]")


@dataclass(frozen=True)
class Tracking:
    """Options of video tracking: the method (silhouette, dots or markers), the position of the base, the colour of
    dots, the part of the picture, and overlay files.

    Attributes
    ----------
    method : {"silhouette", "dots", "aruco"}
    base : (x, y), pixels, optional
        Position of the base. Default: the end of the body that does not move.
    colour : str, optional
        Colour of the dots, as ``#rrggbb``.
    count : int, optional
        Number of dots on the body; marks of their colour away from the body are then left out and listed.
    region : (left, top, right, bottom), pixels, optional
        Part of the picture in which dots are searched.
    stations : int
        Number of points of a silhouette at equal spacing along the body, base and tip included.
    incomplete : bool
        Whether to track a film of which frames are lost, such as a truncated file; by default it is refused.
    overlays : tuple of Path
        Files to write that show the shape over the frames: one sheet with some frames (.png), or a video (.mp4).
    """

    method: Method = "silhouette"
    base: tuple[float, float] | None = None
    colour: str | None = None
    count: int | None = None
    region: tuple[float, float, float, float] | None = None
    stations: int = STATIONS
    incomplete: bool = False
    overlays: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        """Check the settings; raise InputError for invalid or contradictory ones."""
        if self.method not in get_args(Method):
            raise InputError(f"method must be one of {', '.join(get_args(Method))}, not {self.method!r}")
        if not 4 <= self.stations <= 200:
            raise InputError(f"stations must be between 4 and 200, not {self.stations}")
        if not isinstance(self.incomplete, bool):
            raise InputError(f"incomplete must be true or false, not {self.incomplete!r:.60}")
        if self.method != "dots" and (self.count is not None or self.region is not None):
            raise InputError("count and region apply to dots only: remove them, or set method to dots")
        if strange := [p.name for p in self.overlays if p.suffix.lower() not in ENDINGS]:
            raise InputError(f"an overlay must be a picture of frames (.png) or a video (.mp4), not {strange[0]!r}")
        if self.count is not None and (not isinstance(self.count, int) or self.count < 2):
            raise InputError(f"count must be the number of dots, 2 or more, not {self.count!r:.40}")
        if self.region is not None and not _is_region(self.region):
            raise InputError(f"region must be [left, top, right, bottom] in pixels, not {self.region!r:.60}")
        if self.method == "dots" and self.colour is None:
            raise InputError("method dots needs the colour of the dots: set colour to '#rrggbb'")
        if self.method != "dots" and self.colour is not None:
            raise InputError(f"method {self.method} takes no colour: remove colour, or set method to dots")

    @property
    def blue_green_red(self) -> tuple[float, float, float]:
        """Colour of the dots as (blue, green, red), each from 0 to 255."""
        text = (self.colour or "").removeprefix("#")
        try:
            r, g, b = bytes.fromhex(text)
        except ValueError:
            raise InputError(f"colour must be written as '#rrggbb', not {self.colour!r}") from None
        return float(b), float(g), float(r)


def track_video(
    path: str | Path, camera: Camera | dict[str, Any], tracking: Tracking | None = None,
    *, progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Track a bending body in a video and return its shape as a recording.

    Parameters
    ----------
    path : Path
        A video that OpenCV can read; frames are read one at a time.
    camera : Camera or dict
        Scale and view, as in a study's ``[camera]``. Without `rate_hz` the times are those of the container.
    tracking : Tracking, optional
        Settings; default: the silhouette.
    progress : callable, optional
        Function that is called with the fraction of frames processed so far.

    Returns
    -------
    xarray.Dataset
        Recording in frame ``tracker``: positions (time, station, axis) [m] in the plane z = 0, x right and y up. A
        frame in which the body is hidden is a gap, as is one that repeats the previous frame. The history counts lost,
        repeated and hidden frames; the attribute `time_uncertainty_s` bounds the error of the times.

    Raises
    ------
    InputError
        When the video or the camera cannot be used, or the body cannot be tracked.
    """
    path, how = Path(path), tracking or Tracking()
    camera = _camera(camera)
    reel = open_reel(path)
    names, findings, frames = _followed(reel, how)
    times, points, change, before = list[float](), list[Array | None](), list[float](), None
    with overlay(reel, how.overlays) as draw:
        for time, picture, marks in frames:
            draw(time, picture, marks)
            times.append(time)
            points.append(None if marks is None else marks.astype(np.float32))
            sparse = picture[::SPARSE, ::SPARSE].astype(np.float32)
            change.append(float(np.abs(sparse - before).mean()) if before is not None else np.nan)
            before = sparse
            if progress is not None:
                progress(min(1.0, len(times) / reel.count))
        if reel.source is not None:
            findings = [*findings, *judge_film(path, reel.count, len(times), incomplete=how.incomplete)]
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
        raise explain_validation(error, "camera", Camera) from None


def _followed(reel: Reel, how: Tracking) -> tuple[list[str], list[str], Iterator[tuple[float, Array, Array | None]]]:
    """Return the station names (empty for a silhouette), lines for the history, and an iterator over the frames."""
    if how.method == "silhouette":
        even, findings = even_exposure(reel)
        return [], findings, follow_silhouette(even, how.base)
    if how.method == "dots":
        return [], *follow_dots(reel, how.blue_green_red, how.count, how.region)
    numbers, frames = follow_aruco(reel)
    return [f"marker_{n}" for n in numbers], [], frames


def _is_region(region: Any) -> bool:
    """Return whether `region` is four numbers left, top, right, bottom in order."""
    numbers = isinstance(region, list | tuple) and all(isinstance(v, int | float) for v in region)
    return numbers and len(region) == 4 and region[0] < region[2] and region[1] < region[3]


def _stacked(points: list[Array | None], reel: Reel) -> Array:
    first = next((p for p in points if p is not None), None)
    hidden = sum(p is None or not np.isfinite(p).any() for p in points)
    if first is None or hidden > MOST_GAPS * len(points):
        raise InputError(
            f"{reel.path.name}: the whole body was found in only {len(points) - hidden} of {len(points)} frames: keep "
            "hands and cables away from it, keep it in the picture, and put a plain sheet behind it"
        )
    return np.array([np.full(first.shape, np.nan) if p is None else p for p in points], float)


def _recording(reel: Reel, camera: Camera, how: Tracking, names: list[str], seen: _Seen) -> xr.Dataset:
    """Return the recording of the tracked points, with its history."""
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
            findings.append(f"{strange} frames in which the length differs by more than {100 * LENGTH:g} % are gaps")
    findings += [f"{int(hidden.sum())} of {len(time)} frames are gaps: the body was hidden or not found",
             f"{int(doubled.sum())} frames repeat the previous frame and are gaps"]  # fmt: skip
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
    """Return times (T,) [s] of the middle of each exposure, history lines, and the uncertainty of the times [s]."""
    findings = []
    if camera.rate_hz is not None:
        if abs(camera.rate_hz / reel.rate - 1.0) > 0.02:
            rates = f"{reel.rate:.4g} frames per second, [camera] {camera.rate_hz:.4g}"
            findings.append(f"the file states {rates}, which is used")
        time = np.arange(len(time)) / camera.rate_hz
    if (np.diff(time) <= 0).any():
        raise InputError(f"{reel.path.name}: the frame times of the file do not increase: set rate_hz in [camera]")
    missing, indices = lost_in_times(time)
    findings.append(f"{missing} frames are missing in {indices} gap(s) of the file's times")
    period = float(np.median(np.diff(time)))
    open_s = 1e-3 * camera.exposure_ms if camera.exposure_ms is not None else None
    read_s = 1e-3 * camera.readout_ms if camera.readout_ms is not None else None
    unsure = (0.0 if open_s is not None else 0.5 * period) + 0.5 * (read_s if read_s is not None else period)
    shutter = f"open for {1e3 * open_s:g} ms" if open_s is not None else "open for an unknown time"
    rows = f"rows read within {1e3 * read_s:g} ms" if read_s is not None else "rows read within an unknown time"
    findings.append(f"times are the middle of the exposure, uncertain by {1e3 * unsure:.1f} ms: shutter {shutter}, "
                    f"{rows}")
    return time + 0.5 * (open_s if open_s is not None else period), findings, unsure


def _base_first(points: Array, names: list[str], how: Tracking) -> tuple[Array, list[str]]:
    """Return the marks and their names in order from the base: the given base, or the end that moves less."""
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
    """Return stations (T, N, 3) evenly along the body, arc length (N,) [m], names, and the number of dropped frames."""
    from scipy.interpolate import CubicSpline

    along = np.cumsum(np.linalg.norm(np.diff(position, axis=1), axis=2), axis=1)
    along = np.concatenate([np.zeros((len(position), 1)), along], axis=1)
    length = float(np.nanmedian(along[:, -1]))
    with np.errstate(invalid="ignore"):
        strange = np.abs(along[:, -1] / length - 1.0) > LENGTH
    resampled = np.full((len(position), stations, 3), np.nan)
    share = np.linspace(0.0, 1.0, stations)
    for k in np.flatnonzero(np.isfinite(along[:, -1]) & ~strange):
        resampled[k] = CubicSpline(along[k], position[k])(share * along[k, -1])
    names = ["base", *(f"s{k:02d}" for k in range(1, stations - 1)), "tip"]
    return resampled, share * length, names, int(strange.sum())


def lost_in_times(time: Array) -> tuple[int, int]:
    """Return the number of frames that are missing in the frame times (T,) [s] of a video, and the number of gaps that
    they form.
    """
    step = np.diff(time)
    missing = np.rint(step / np.median(step)).astype(int) - 1
    return int(missing[missing > 0].sum()), int((missing > 0).sum())


def doubled_and_leaps(points: Array, change: Array, time: Array) -> tuple[Array, Array]:
    """Return two masks (T,) of the T frames of a video: those that repeat the previous frame, and those in which the
    body moves twice as far as in the neighbouring frames.

    A step that is twice as long suggests a missing frame. Both are reported only where the body moves by `MOVES` or
    more and keeps its direction, as two frames at a reversal are alike.

    Parameters
    ----------
    points : array (T, S, 2), pixels
        Tracked points; NaN where nothing was seen.
    change : array (T,), levels
        Mean change of the picture since the previous frame, in grey levels.
    time : array (T,), s
    """
    step = np.diff(points, axis=0, prepend=np.nan)
    apart = (step**2).sum(axis=2)
    count = np.isfinite(apart).sum(axis=1)
    size = np.sqrt(np.where(count > 0, np.nansum(apart, axis=1), np.nan) / np.maximum(count, 1))
    even = np.rint(np.diff(time, prepend=time[0]) / np.median(np.diff(time))) <= 1
    doubled, leaps = np.zeros(len(points), bool), np.zeros(len(points), bool)
    for k in range(2, len(points) - 1):
        before, after = size[k - 1], size[k + 1]
        if not np.isfinite([before, size[k], after]).all() or np.nansum(step[k - 1] * step[k + 1]) <= 0:
            continue
        least = min(before, after)
        alike = change[k] < ALIKE * min(change[k - 1], change[k + 1])
        doubled[k] = least > MOVES and size[k] < STANDS * least and alike
        leaps[k] = min(before, after) > MOVES and size[k] > LEAPS * max(before, after) and even[k - 1 : k + 2].all()
    leaps[1:] &= ~doubled[:-1]
    return doubled, leaps
