"""Determine the side to which a planar body bends, and turn a recording by pi about the base tangent."""  # D4

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pliant.equations.observation import FURTHER
from pliant.errors import InputError
from pliant.preprocessing.detectors import by_blocks, mean_place
from pliant.preprocessing.rest import rest_window
from pliant.recording import append_history

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

ATTRIBUTE = "x_sign"


def bending_sign(
    recording: xr.Dataset, position: NDArray, pose: NDArray, origin: NDArray, x_axis: NDArray,
) -> int:
    """Return the direction in which a planar body bends: 1 for rotation about +z (tip towards -x), -1 about -z, 0
    without motion.

    The station with the largest displacement decides: under the highest pressure or, where no pressure was measured, at
    its largest displacement.

    Parameters
    ----------
    recording : xarray.Dataset
        The recording.
    position : array (T, S, d)
        Positions of the stations, m.
    pose : array (S, d)
        Positions of the stations at rest, m.
    origin, x_axis : array (d,)
        Origin [m] and x axis (unit vector) of the base frame.
    """
    travel = by_blocks(lambda part: np.nanmax(np.abs(part), axis=0, initial=0.0), position @ x_axis - pose @ x_axis)
    most = int(np.argmax(travel))
    sideways = (position[:, most] - pose[most]) @ x_axis if travel.max() > 0 else (position[:, -1] - origin) @ x_axis
    weight = sideways
    if "pressure" in recording:
        values = recording["pressure"].values.reshape(recording.sizes["pressure_time"], -1)
        rise = np.nan_to_num(values - np.nanmin(values, axis=0, initial=np.inf)).sum(1)
        level = np.interp(recording["time"].values, recording["pressure_time"].values, rise)
        if level.max() > level.min():
            chosen = level > 0.5 * (level.max() + level.min())
            weight = np.where(chosen, sideways, 0.0)
    largest = np.nan_to_num(weight)
    return -int(np.sign(largest[np.argmax(np.abs(largest))]))


def planar_side(recording: xr.Dataset) -> int:
    """Return the direction in which the body of a planar recording bends: 1 towards -x, -1 towards +x. Return 0 without
    positions or rest, or with several chambers.
    """
    several = "pressure" in recording and recording["pressure"].ndim > 1 and recording.sizes["chamber"] > 1
    if "position" not in recording or recording.attrs["frame"] != "planar" or several:
        return 0
    position, time = recording["position"].values, recording["time"].values
    try:
        start, end = rest_window(recording)
    except InputError:  # no rest found
        return 0
    pose = mean_place(position[(time >= start) & (time <= end)])
    return bending_sign(recording, position, pose, np.zeros(2), np.array([1.0, 0.0]))


def half_turn(recording: xr.Dataset) -> xr.Dataset:
    """Return a planar recording turned by pi about the base tangent, so that all x coordinates and angles change sign.

    The attribute `x_sign` and the history record the turn. A variable of another kind raises InputError.
    """
    if turned := [name for name in FURTHER if name in recording]:
        raise InputError(f"a recording with {turned[0]} cannot be turned: record it in a base frame in which the body "
                         f"bends to the side of the model, or remove {turned[0]}")  # fmt: skip
    changed = recording.assign_attrs({ATTRIBUTE: -x_sign(recording)})
    if "position" in recording:
        changed["position"] = recording["position"] * np.array([-1.0, 1.0])
        changed["position"].attrs = recording["position"].attrs
    if "angle" in recording:
        changed["angle"] = -recording["angle"]
        changed["angle"].attrs = recording["angle"].attrs
    for name, sign in (("base_position", np.array([-1.0, 1.0])), ("base_angle", -1.0)):
        if name in recording:
            changed[name] = (recording[name] * sign).assign_attrs(recording[name].attrs)
    return append_history(changed, "turned by pi about the base tangent: x and angles change their signs")


def x_sign(recording: xr.Dataset) -> int:
    """Return -1 where a planar recording has been turned by pi about its base tangent, else 1."""
    return int(recording.attrs.get(ATTRIBUTE, 1))


@dataclass(frozen=True)
class Alignment:
    """Report of `align`: position and axes of the base frame in tracker coordinates, flatness of the motion, and
    options used. It is stored as JSON in the recording's attribute ``alignment``.

    Attributes
    ----------
    base : str
        Name of the base station.
    origin : 3 floats, m
        Origin of the base frame in tracker coordinates.
    rotation : 3 x 3 floats
        Rows are the base frame's axes in tracker coordinates: in the plane x, y (base tangent) and z (normal of the
        plane); in space x (normal of the plane), y and z (base tangent).
    tangent, plane : str
        Options by which tangent and plane were determined.
    bending : int
        Sign of the rotation about +z at the largest excursion, or under the highest pressure.
    rest_s : (start, end)
        Rest window, s.
    flatness : float
        Second over first singular value across the tangent: 0 for planar motion, 1 where no plane is preferred.
    out_of_plane_rms_m, out_of_plane_max_m : float
        Displacement along the normal from each station's mean position, over all stations and frames.
    out_of_plane_share : float
        Ratio of the displacement along the normal to the whole displacement (root mean squares).
    base_travel_m : float
        Largest distance of the base station from its rest position, m.
    base_motion_removed : bool
        Whether the motion of the base was subtracted.
    frame : {"planar", "spatial"}
    """

    base: str
    origin: tuple[float, ...]
    rotation: tuple[tuple[float, ...], ...]
    tangent: str
    plane: str
    bending: int
    rest_s: tuple[float, float]
    flatness: float
    out_of_plane_rms_m: float
    out_of_plane_max_m: float
    out_of_plane_share: float
    base_travel_m: float
    base_motion_removed: bool
    frame: str = "planar"

    @property
    def normal(self) -> tuple[float, ...]:
        """Unit normal (3,) of the plane of bending, in tracker coordinates."""
        return self.rotation[0 if self.frame == "spatial" else 2]

    @property
    def base_tangent(self) -> tuple[float, ...]:
        """Unit tangent (3,) of the body at the base, in tracker coordinates."""
        return self.rotation[2 if self.frame == "spatial" else 1]


def alignment_of(recording: xr.Dataset) -> Alignment:
    """Return the report of the alignment (base frame, flatness, options) that is stored in an aligned recording. Raise
    InputError where the recording has none.
    """
    try:
        values = json.loads(recording.attrs["alignment"])
        rotation = tuple(tuple(row) for row in values["rotation"])
        pairs = {"origin": tuple(values["origin"]), "rest_s": tuple(values["rest_s"])}
        return Alignment(**(values | pairs | {"rotation": rotation}))
    except (KeyError, TypeError, ValueError):
        raise InputError("this recording has no report of an alignment: align it with pliant first") from None
