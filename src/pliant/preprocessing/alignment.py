"""Report of an alignment: position of the base frame in tracker coordinates, and flatness of the motion."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pliant.errors import InputError

if TYPE_CHECKING:
    import xarray as xr


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
