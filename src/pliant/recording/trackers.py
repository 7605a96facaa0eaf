"""Convert the points that a tracker found in a video to a recording; shared by all tracker formats."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from pliant.errors import InputError, inside
from pliant.recording.camera import Camera, in_plane, with_z
from pliant.recording.mapping import FileMapping
from pliant.recording.schema import make_recording
from pliant.units import metre_per

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray

LIKELY = 0.6  # a point of lower likelihood is a gap; the default of the trackers' own tools


class TrackerMapping(FileMapping):
    """Options of all readers of video trackers: camera or unit of length, smallest accepted likelihood, and points to
    read.

    Attributes
    ----------
    camera : Camera, optional
        Needed where the points are in pixels.
    length_unit : str, optional
        Instead of a camera, where the tracker was calibrated: coordinates are then lengths, y upward.
    likelihood : float
        A point with a lower likelihood or score becomes a gap.
    individual : str, optional
        Name of the animal or track to read, where there are several.
    stations : list of str, optional
        Points to read, from base to tip. Default: all, in the order of the file.
    """

    camera: Camera | None = None
    length_unit: str | None = None
    likelihood: float = Field(default=LIKELY, ge=0, le=1)
    individual: str | None = None
    stations: list[str] | None = None


def tracked(
    path: Path, options: TrackerMapping, names: Sequence[str], points: NDArray, *,
    likelihood: NDArray | None = None, history: Sequence[str] = (),
) -> xr.Dataset:
    """Convert points (T, S, 2) of S stations over T frames, in pixels or in the tracker's unit, to a recording. Points
    that were not found are NaN.

    Parameters
    ----------
    names : S names
    likelihood : array (T, S), optional
    """
    history = list(history)
    if likelihood is not None:
        doubtful = (likelihood < options.likelihood) & np.isfinite(points).all(axis=2)
        points = np.where(doubtful[..., None], np.nan, points)
        by_station = ", ".join(f"{n} {c}" for n, c in zip(names, doubtful.sum(axis=0), strict=True) if c)
        lost = f"{int(doubtful.sum())} of {doubtful.size} points have a likelihood below {options.likelihood:g}"
        history.append(f"{lost} and are gaps{f': {by_station}' if by_station else ''}")
    names, points = chosen(names, points, options, path.name)
    position, how = in_metres(points, options, path)
    with inside(path.name):
        return make_recording(frames(len(points), options, path.name), position, station=list(names),
                              history=[*history, how])  # fmt: skip


def chosen(
    names: Sequence[str], points: NDArray, options: TrackerMapping, file: str
) -> tuple[list[str], NDArray]:
    """Return the names and points of the stations that the options list, in that order; all stations where they list
    none.
    """
    if options.stations is None:
        return list(names), points
    if missing := [s for s in options.stations if s not in names]:
        raise InputError(f"{file} has no point {missing[0]!r}: choose stations among {', '.join(names)}")
    return list(options.stations), points[:, [list(names).index(s) for s in options.stations]]


def in_metres(points: NDArray, options: TrackerMapping, path: Path) -> tuple[NDArray, str]:
    """Convert the points (T, S, 2) of a tracker, for S stations over T frames, to positions (T, S, 3) [m], y upward and
    z = 0. Also return a line for the history.
    """
    if options.camera is None and options.length_unit is None:
        raise InputError(
            f"{path.name} does not state the unit of its points: for points in pixels give [camera] with pixels_per_mm "
            "(or scale, plane, board) and rate_hz; for a calibrated tracker give length_unit in its mapping"
        )
    if options.camera is not None and options.length_unit is not None:
        raise InputError(
            f"the mapping for {path.name} has both [camera] and length_unit: keep [camera] if the points are in "
            "pixels, or length_unit if the tracker is calibrated"
        )
    if options.camera is not None:
        return in_plane(points, options.camera, path.parent)
    position = with_z(points * metre_per(str(options.length_unit)))
    return position, f"lengths in {options.length_unit}, y upward, as calibrated"


def frames(count: int, options: TrackerMapping, file: str) -> NDArray:
    """Return the times (count,) [s] of the `count` frames of a video, computed from the camera's frame rate. The first
    is 0.
    """
    rate = options.camera.rate_hz if options.camera is not None else None
    if rate is None:
        raise InputError(f"{file} has no times: set rate_hz in [camera] to the frame rate of the video")
    return np.arange(count) / rate
