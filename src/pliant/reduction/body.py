"""Extract the body's shape from a recording: positions in complete frames, arc length, tangent at the base."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError
from pliant.numerics.spline import polynomial_slope_weights
from pliant.preprocessing.arc_length import STRETCH_WORTH_TELLING, chord_lengths, station_arc_length, whole_frames
from pliant.recording.schema import check_recording

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

TANGENT_SHARE = 0.1  # of the length: part at the base that is fitted for the tangent


@dataclass(frozen=True)
class BodyShape:
    """Shape of a body over time as arrays (positions, arc length, tangent at the base), of the frames in which no
    station is missing.

    Attributes
    ----------
    time : (T,) array, s
    position : (T, S, d) array, m
    arc_length : (S,) array, m
        Arc length of the stations, equal for all frames, so that a node stays at the same material point.
    tangent : (T, d) array
        Derivative of the position by arc length at the first station: a unit vector, times the stretch where the body
        lengthens.
    dropped : int
        Number of frames that were left out because a station was missing.
    notes : tuple of str
        Assumptions and remarks, one sentence each.
    """

    time: Array
    position: Array
    arc_length: Array
    tangent: Array
    dropped: int
    notes: tuple[str, ...]


def body_of(recording: xr.Dataset, *, fewest_stations: int = 4) -> BodyShape:
    """Return the shape of the body in a recording as arrays: positions, arc length and base tangent in the frames
    without missing stations.

    The arc length is that of the recording where it has one, otherwise the time-mean sum of chords. The base tangent is
    +y in an aligned planar recording and +z in an aligned spatial one. Otherwise it is the tangent of a least-squares
    parabola through the first tenth of the body (at least three stations) in each frame.

    Raises
    ------
    InputError
        When the recording has no positions, too few stations, no complete frame, or stations that coincide.
    """
    check_recording(recording)
    stations = recording.sizes.get("station", fewest_stations)
    if stations < fewest_stations:
        raise InputError(f"at least {fewest_stations} stations along the body are needed, but the recording has "
                         f"{stations}: track more points")
    position, time, dropped = whole_frames(recording)
    notes = [f"{dropped} frame(s) with missing stations left out"] if dropped else []
    chords = chord_lengths(position)
    arc_length, findings = station_arc_length(recording, position, chords)
    notes += findings
    axis = {"planar": "y", "spatial": "z"}.get(str(recording.attrs["frame"]))
    if axis is not None:  # the last axis, in the plane and in space
        tangent = np.broadcast_to(np.eye(position.shape[2])[-1], (len(time), position.shape[2]))
        notes.append(f"base tangent: +{axis}, the frame of the recording")
    else:
        tangent, count = _measured_tangent(position, arc_length)
        notes.append(f"base tangent: parabola through the first {count} stations, frame by frame")
    stretch = _base_stretch(chords, arc_length)
    if stretch is not None:
        tangent = tangent * stretch[:, None]
        notes.append("the length changes: joints keep their fraction of the length, the base tangent is stretched too")
    return BodyShape(time, position, arc_length, tangent, dropped, tuple(notes))


def _base_stretch(chords: Array, arc_length: Array) -> Array | None:
    """Return the ratio (T,) of the first tenth's length to its arc length; None where the length hardly changes."""
    total = chords.sum(axis=1)
    if np.ptp(total) <= STRETCH_WORTH_TELLING * total.mean():
        return None
    last = max(1, int(np.searchsorted(arc_length, TANGENT_SHARE * arc_length[-1])))
    return chords[:, :last].sum(axis=1) / arc_length[last]


def _measured_tangent(position: Array, arc_length: Array) -> tuple[Array, int]:
    count = max(3, int(np.searchsorted(arc_length, TANGENT_SHARE * arc_length[-1], side="right")))
    weights = polynomial_slope_weights(arc_length[:count], 2)
    slope = np.einsum("s,tsd->td", weights, position[:, :count])
    length = np.linalg.norm(slope, axis=1, keepdims=True)
    if (length == 0.0).any():
        raise InputError(f"the first stations coincide in {int((length == 0.0).sum())} frame(s), so the base has no "
                         "tangent: leave one out")
    return slope / length, count
