"""Functions that repair faults of a recording, such as gaps, and note each change in its history."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError
from pliant.preprocessing import detectors
from pliant.preprocessing.held import without_marked
from pliant.preprocessing.rotations import continuous, from_matrix, mean_rotation, to_matrix
from pliant.recording.schema import append_history, check_holds

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

SAME_SYMMETRY = np.deg2rad(25.0)


def leave_out_spikes(recording: xr.Dataset, like: xr.Dataset | None = None) -> xr.Dataset:
    """Return the recording with NaN where a station leaves its path for a single frame; the history counts them.

    Parameters
    ----------
    recording : xarray.Dataset
        A recording; without positions it is returned unchanged.
    like : xarray.Dataset, optional
        The same recording before its alignment, in which the spikes are detected.
    """
    like = recording if like is None else like
    shared = "position" in recording and "position" in like and recording.station.equals(like.station)
    if not shared or recording.sizes["time"] != like.sizes["time"]:
        return recording
    quaternion = like["quaternion"].values if "quaternion" in like else None
    marked = detectors.spiked_frames(like["position"].values, quaternion)
    return without_marked(recording, marked, "a station left its path for one frame")


def undo_orientation_jumps(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording with continuous orientations, where a tracker jumped between orientations that look alike on
    a symmetric cluster of markers.

    Such a tracker reports R S in place of R for a while, with the same rotation S of the cluster's symmetry each time.
    The rotations S are identified from the jumps (more than 30 degrees from frame to frame, there and back). Every
    frame takes the orientation that continues the previous frame.

    Raises
    ------
    InputError
        When a jump remains that no symmetry explains.
    """
    check_holds(recording, "quaternion", "undo_orientation_jumps")
    quaternion = recording["quaternion"].values.copy()
    changed = {}
    for s, name in enumerate(recording["station"].values):
        known = np.flatnonzero(np.isfinite(quaternion[:, s]).all(1))
        matrix, count = _continued(to_matrix(quaternion[known, s]), str(name))
        if count:
            changed[str(name)] = count
            quaternion[known, s] = from_matrix(matrix)
    quaternion, _ = continuous(quaternion)
    frames = ", ".join(f"{name} {count}" for name, count in changed.items()) or "none"
    line = f"undid jumps of orientation by the symmetry of the markers, frames rotated back: {frames}"
    return append_history(recording.assign(quaternion=recording["quaternion"].copy(data=quaternion)), line)


def _continued(matrix: NDArray, name: str) -> tuple[NDArray, int]:
    """Return rotations (T, 3, 3) without jumps, and the number of frames that were rotated back."""
    step = np.swapaxes(matrix[:-1], -1, -2) @ matrix[1:]
    jumps = np.flatnonzero(rotation_angle(step) > detectors.ORIENTATION_JUMP)
    if jumps.size == 0:
        return matrix, 0
    turns = [np.eye(3), *_symmetries(step[jumps])]
    result = matrix.copy()
    state = np.zeros(len(matrix), dtype=int)
    for begin, end in zip(jumps + 1, [*(jumps[1:] + 1), len(matrix)], strict=True):
        options = [matrix[begin] @ turn.T for turn in turns]
        away = [float(rotation_angle(result[begin - 1].T @ option)) for option in options]
        best = int(np.argmin(away))
        if away[best] > detectors.ORIENTATION_JUMP:
            raise InputError(
                f"the orientation of {name} jumps by {np.rad2deg(min(away)):.0f} degrees at frame {begin}, which "
                "no symmetry of its markers explains: leave its orientation out"
            )
        state[begin:end] = best
        result[begin:end] = matrix[begin:end] @ turns[best].T
    most = int(np.argmax(np.bincount(state)))
    return result @ turns[most], int((state != most).sum())


def _symmetries(jumps: NDArray) -> list[NDArray]:
    """Return the distinct rotations among the jumps and their inverses, each the mean of its group."""
    symmetries: list[NDArray] = []
    for jump in (*jumps, *np.swapaxes(jumps, -1, -2)):
        near = [g for g in symmetries if rotation_angle(g.T @ jump) < SAME_SYMMETRY]
        if not near:
            group = np.concatenate([jumps, np.swapaxes(jumps, -1, -2)])
            group = group[rotation_angle(jump.T @ group) < SAME_SYMMETRY]
            symmetries.append(mean_rotation(group))
    return symmetries


def rotation_angle(matrix: NDArray) -> NDArray:
    """Return the rotation angle [rad], 0 to pi, of each rotation matrix in an array (..., 3, 3)."""
    return np.arccos(np.clip(0.5 * (np.trace(matrix, axis1=-2, axis2=-1) - 1.0), -1.0, 1.0))
