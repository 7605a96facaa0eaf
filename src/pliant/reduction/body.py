"""Inputs of order selection from a recording: whole frames, arc length, the tangent at the base."""

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

TANGENT_SHARE = 0.1  # of the length: the stretch at the base whose fit gives the tangent


@dataclass(frozen=True)
class BodyShape:
    """Whole frames of a body as plain arrays.

    Attributes
    ----------
    time : (T,) array, s
    position : (T, S, d) array, m
    arc_length : (S,) array, m
        One abscissa for all frames, so that a node stays on the same piece of the body.
    tangent : (T, d) array
        Slope at the first station by arc length: a unit vector, times the stretch there where the body lengthens.
    dropped : int
        Frames that were left out because a station was missing.
    notes : tuple of str
        What was assumed or found on the way.
    """

    time: NDArray[np.float64]
    position: NDArray[np.float64]
    arc_length: NDArray[np.float64]
    tangent: NDArray[np.float64]
    dropped: int
    notes: tuple[str, ...]


def body_of(recording: xr.Dataset, *, fewest_stations: int = 4) -> BodyShape:
    """Take the whole frames of a recording, its arc length and base tangent.

    Arc length is the recording's own where it carries one, otherwise the time-mean sum of chords. The base
    tangent is +y in an aligned planar recording and +z in one in space, otherwise that of a least-squares parabola
    through the first tenth of the body (at least three stations), frame by frame.

    Raises
    ------
    InputError
        When the recording has no positions, too few stations, no whole frame, or stations that coincide.
    """
    check_recording(recording)
    stations = recording.sizes.get("station", fewest_stations)
    if stations < fewest_stations:
        raise InputError(f"at least {fewest_stations} stations along the body are needed, but {stations} came")
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
        notes.append("joints keep their share of a length that changes; the slope at the base stretches along")
    return BodyShape(time, position, arc_length, tangent, dropped, tuple(notes))


def _base_stretch(chords: NDArray[np.float64], arc_length: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the ratio (T,) of the first tenth's length to its arc length; None if the length hardly changes."""
    total = chords.sum(axis=1)
    if np.ptp(total) <= STRETCH_WORTH_TELLING * total.mean():
        return None
    last = max(1, int(np.searchsorted(arc_length, TANGENT_SHARE * arc_length[-1])))
    stretch: NDArray[np.float64] = chords[:, :last].sum(axis=1) / arc_length[last]
    return stretch


def _measured_tangent(
    position: NDArray[np.float64], arc_length: NDArray[np.float64]
) -> tuple[NDArray[np.float64], int]:
    count = max(3, int(np.searchsorted(arc_length, TANGENT_SHARE * arc_length[-1], side="right")))
    weights = polynomial_slope_weights(arc_length[:count], 2)
    slope = np.einsum("s,tsd->td", weights, position[:, :count])
    length = np.linalg.norm(slope, axis=1, keepdims=True)
    if (length == 0.0).any():
        raise InputError(f"the base has no direction in {int((length == 0.0).sum())} frame(s)")
    return slope / length, count
