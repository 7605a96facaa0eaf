"""The report of an alignment: where the base frame lies in the tracker's, and how flat the motion is."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pliant.errors import InputError

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Alignment:
    """Results and choices of `align`; stored as JSON in the attribute ``alignment`` of the recording.

    Attributes
    ----------
    base : str
    origin : 3 floats, m
        In tracker coordinates.
    rotation : 3 x 3 floats
        Rows are the base frame's axes in tracker coordinates: in the plane x, y (base tangent) and z (normal of the
        plane); in space x (normal of the plane), y and z (base tangent).
    tangent, plane : str
        How they were found.
    bending : int
        Sign of the rotation about +z at the largest excursion, or under the highest pressure.
    rest_s : (start, end)
    flatness : float
        Second to first singular value across the tangent: 0 a plane, 1 none distinguished.
    out_of_plane_rms_m, out_of_plane_max_m : float
        Displacement along the normal from each station's mean place, over all stations and frames.
    out_of_plane_share : float
        Its share of the whole displacement (root mean squares).
    base_travel_m : float
        Largest distance of the base from its rest place.
    base_motion_removed : bool
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
        """Normal of the plane of bending, in tracker coordinates."""
        return self.rotation[0 if self.frame == "spatial" else 2]

    @property
    def base_tangent(self) -> tuple[float, ...]:
        """Direction of the body at the base, in tracker coordinates."""
        return self.rotation[2 if self.frame == "spatial" else 1]


def alignment_of(recording: xr.Dataset) -> Alignment:
    """Report of the alignment that made a recording; InputError when it was not aligned here."""
    try:
        values = json.loads(recording.attrs["alignment"])
        rotation = tuple(tuple(row) for row in values["rotation"])
        pairs = {"origin": tuple(values["origin"]), "rest_s": tuple(values["rest_s"])}
        return Alignment(**(values | pairs | {"rotation": rotation}))
    except (KeyError, TypeError, ValueError):
        raise InputError("this recording carries no report of an alignment") from None
