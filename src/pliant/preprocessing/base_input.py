"""Motion of the base station as an input: its poses in the base frame, and whether it is one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pliant.preprocessing import detectors
from pliant.preprocessing.alignment import alignment_of
from pliant.preprocessing.rotations import angle_about, continuous, from_matrix
from pliant.recording import append_history
from pliant.recording.base_pose import with_base_motion

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

BASE_SHARE = 0.1  # of the largest peak displacement: a base that moves less is taken to be at rest
STILL_SHARE = 0.2  # of the base's peak displacement: a station that moves less is not carried by it


class BaseRest(NamedTuple):
    """The base station at rest, in the tracker's frame."""

    station: int  # its index
    position: NDArray  # (3,) m
    axes: Any  # (3, 3)


def with_base_input(
    aligned: xr.Dataset, tracked: tuple[NDArray, Any, BaseRest], cutoff: float | str,
) -> xr.Dataset:
    """Return an aligned recording with the motion of its base station as an input, see `with_base_motion`.

    Parameters
    ----------
    aligned : xarray.Dataset
        Positions and angles relative to the moved base.
    tracked : tuple
        Positions (T, S, 3) [m] and orientations (T, S, 3, 3) of the stations in the tracker's frame, and the base
        station at rest.
    cutoff : float (Hz) or "auto"
        Smoothing of the motion for its derivatives.
    """
    position, matrices, rest = tracked
    report = alignment_of(aligned)
    axes, origin = np.array(report.rotation), np.array(report.origin)
    turned = matrices[:, rest.station] @ rest.axes.T
    moved = (position[:, rest.station] + turned @ (origin - rest.position) - origin) @ axes.T
    rotation = axes @ turned @ axes.T
    unknown = int((~np.isfinite(moved).all(axis=1)).sum())
    lines = [f"the pose of the base is unknown in {unknown} of {len(moved)} frames"] if unknown else []
    if report.frame == "spatial":
        quaternion, _ = continuous(from_matrix(rotation)[:, None])
        done = with_base_motion(aligned, moved, quaternion=quaternion[:, 0], cutoff=cutoff)
        return append_history(done, *lines)
    angle = angle_about(rotation, np.array([0.0, 0.0, 1.0]))
    seen = np.isfinite(angle)
    angle[seen] = np.unwrap(angle[seen])
    tilt = np.degrees(np.arccos(np.clip(rotation[seen, 2, 2], -1.0, 1.0)).max(initial=0.0))
    lines.append(f"the base leaves the plane by up to {1e3 * np.nanmax(np.abs(moved[:, 2])):.3g} mm and {tilt:.3g} "
                 "degrees, which is left out")  # fmt: skip
    return append_history(with_base_motion(aligned, moved[:, :2], angle=angle, cutoff=cutoff), *lines)


def base_is_moved(stations: xr.Dataset, aligned: xr.Dataset) -> bool:
    """Return whether the base station of a recording, with an orientation, moves by more than a tenth of the largest
    peak displacement, and carries all other stations along. `stations` is the recording before its alignment.
    """
    base, names = alignment_of(aligned).base, [str(n) for n in stations["station"].values]
    if "quaternion" not in stations or len(names) < 2:
        return False
    if not np.isfinite(stations["quaternion"].values[:, names.index(base)]).all(axis=-1).any():
        return False
    travel = np.nan_to_num(detectors.travel(detectors.without_spikes(stations["position"].values)))
    own = travel[names.index(base)]
    return bool(own > BASE_SHARE * travel.max() and travel.min() >= STILL_SHARE * own)
