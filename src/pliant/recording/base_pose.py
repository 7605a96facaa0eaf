"""Recorded motion of the base, such as that of a robot's arm, as variables of an aligned recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.recording.rules import COMPONENTS, VARIABLES, check_recording

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import ArrayLike

POSES = ("base_position", "base_angle", "base_quaternion")
CUTOFF = "base_cutoff"  # attribute of a recording


def with_base_motion(
    recording: xr.Dataset, position: ArrayLike, *, angle: ArrayLike | None = None,
    quaternion: ArrayLike | None = None, cutoff: float | str | None = None,
) -> xr.Dataset:
    """Return an aligned recording with the motion of its base as an input of the body.

    The positions and angles of the stations are then relative to the moved base.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording in the frame planar or spatial.
    position : (T, 2), in space (T, 3) array, m
        Position of the base frame's origin in the axes of the base frame at rest; NaN marks an unknown pose.
    angle : (T,) array, rad, optional
        In the plane: angle of the base frame about +z since rest.
    quaternion : (T, 4) array, optional
        In space: rotation of the base frame since rest, x, y, z, w.
    cutoff : float (Hz), "auto" or None
        Smoothing of the motion for its derivatives, see `pliant.simulation.BaseMotion`.

    Raises
    ------
    InputError
        When the shapes or the frame do not match.
    """
    given: dict[str, Any] = {"base_position": position, "base_angle": angle, "base_quaternion": quaternion}
    added = recording.copy()
    for name, values in given.items():
        if values is not None:
            (dims,), units, long_name = VARIABLES[name]
            about = {"units": units, "long_name": long_name}
            added[name] = (dims, np.array(values, dtype=np.float64), about)
    if quaternion is not None:
        added = added.assign_coords(component=list(COMPONENTS))
    if cutoff is not None:
        added.attrs[CUTOFF] = cutoff
    return check_recording(added)


def base_moves(recording: xr.Dataset) -> bool:
    """Return whether a recording holds the motion of its base as an input."""
    return "base_position" in recording


def keep_base(before: xr.Dataset, after: xr.Dataset) -> xr.Dataset:
    """Return the recording `after`, of the same frames as `before`, with the base motion of `before`, if it has one."""
    kept = {name: before[name] for name in POSES if name in before}
    return after.assign(kept).assign_attrs({CUTOFF: before.attrs[CUTOFF]} if CUTOFF in before.attrs else {})
