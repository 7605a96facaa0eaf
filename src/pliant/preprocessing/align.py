"""Transform the positions and orientations of a recording from tracker coordinates to the base frame of the models.

The base is at the origin. The base tangent points along +y in a planar recording and along +z in a spatial one. Both
are the same frame with renamed axes: (x, y, z) in space is (z, x, y) of the plane. A body that bends about +x in space
therefore bends about +z in the plane.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pliant.errors import InputError
from pliant.preprocessing.base import (
    BaseRest,
    base_is_moved,
    base_rotation_at_rest,
    base_tangent,
    bending_normal,
    input_normal,
    is_turned,
    named_axis,
    still_noise,
    turns_of_base,
    with_base_input,
)
from pliant.preprocessing.detectors import BLOCK_FRAMES, mean_place, orientation_jumps, seen_points
from pliant.preprocessing.repair import undo_orientation_jumps
from pliant.preprocessing.rest import clock_finding, rest_window
from pliant.preprocessing.rotations import angle_about, continuous, from_matrix, mean_rotation, to_matrix
from pliant.preprocessing.side import Alignment, alignment_of, bending_sign, half_turn, planar_side
from pliant.recording import append_history, check_recording, make_recording
from pliant.recording.rules import shape_variable
from pliant.recording.schema import refuse_loss

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray as xr
    from numpy.typing import ArrayLike, NDArray

__all__ = ["Alignment", "align", "alignment_of"]

DENSE_STATIONS = 8
VAGUE_PLANE = 0.5
Bend = Literal["positive", "negative"]


def align(
    recording: xr.Dataset,
    *,
    base: str | None = None,
    tangent: str | ArrayLike = "chord",
    plane: str | ArrayLike = "motion",
    bend: Bend | None = "positive",
    rest: Sequence[float] | None = None,
    origin_offset: float | Sequence[float] = 0.0,
    origin: Sequence[float] | None = None,
    clamp_length: float | None = None,
    remove_base_motion: bool = False,
    base_motion: bool = False,
    base_cutoff: float | Literal["auto"] = "auto",
    undo_jumps: bool = False,
    arc_length: Sequence[float] | None = None,
    space: bool = False,
) -> xr.Dataset:
    """Transform the positions and orientations of a tracked recording to the base frame of the models: origin at the
    base, base tangent along +y (planar) or +z (spatial).

    Parameters
    ----------
    recording : xarray.Dataset
        Recording in frame ``tracker``. A ``planar`` recording, whose base and tangent are known, is turned by pi about
        the base tangent where it bends to the side opposite to `bend`.
    base : str, optional
        Station at the base. Default: ``base`` when there is one, else the first station.
    tangent : str or 3 numbers
        Direction of the body at the base; see `pliant.preprocessing.base.base_tangent`.
    plane : {"motion", "body", "input"}, an axis such as "+x" or "base:+x", or 3 numbers
        Plane of bending, which contains the tangent. ``"motion"``: plane of the displacements from the mean positions.
        ``"body"``: plane of all points of the body. ``"input"``: plane in which the first measured input bends the
        body. Otherwise the normal of the plane: an axis of the tracker, an axis of the base station's orientation at
        rest, or a vector. In a spatial recording the normal is the axis x.
    bend : {"positive", "negative"} or None
        Sign of the normal: the body bends about +z (tip toward -x) or -z under the highest pressure or, where no
        pressure was measured, at the largest displacement. With ``plane="input"`` the first input decides. None
        keeps the normal; a given normal of a spatial recording is always kept.
    rest : (start, end), s, optional
        Time during which the body is at rest. Default: `rest_window`.
    origin_offset : float or 3 floats, m
        Offset from the base station to the origin: along the tangent, or as a vector in tracker coordinates.
    origin : 3 floats, m, optional
        The origin in tracker coordinates, where no station shows the base; instead of `origin_offset`.
    clamp_length : float, m, optional
        Length of the clamp, for ``tangent="clamp"``.
    remove_base_motion : bool
        Whether to subtract the motion of the base station, which must have an orientation, from every frame.
    base_motion : bool
        Whether to do the same, and to keep the motion of the base as an input of the body: as ``base_position``, and
        ``base_angle`` or ``base_quaternion``. A model then feels the acceleration and the turn of its base. A base
        without an orientation does not turn.
    base_cutoff : float (Hz) or "auto"
        Smoothing of this motion for its derivatives, see `pliant.simulation.BaseMotion`.
    undo_jumps : bool
        Whether to undo jumps of orientation first; see `pliant.preprocessing.repair.undo_orientation_jumps`. With
        False, a recording with such jumps is refused, since its angles would be wrong.
    arc_length : floats, m, optional
        Arc length of each station. Default: that of the recording or, with eight stations or more, of the polyline at
        rest.
    space : bool
        Whether to keep three dimensions.

    Returns
    -------
    xarray.Dataset
        Planar recording with positions (T, S, 2) and `angle`, the rotation of each station about +z since rest; or a
        spatial one (frame ``spatial``) with positions (T, S, 3) and `quaternion`, the rotation of each station since
        rest in the base frame. `alignment_of` returns the report.

    Raises
    ------
    InputError
        When the recording does not determine base, tangent or plane.
    """
    _check_positions(recording)
    if recording.attrs["frame"] == "planar":
        return half_turn(recording) if bend is not None and planar_side(recording) == -_wanted_sign(bend) else recording
    recording = _without_jumps(recording if arc_length is not None else without_unseen(recording), undo=undo_jumps)
    window, span = _rest(recording, rest, index := _base_index(recording, base))
    position = recording["position"].values
    matrices = to_matrix(recording["quaternion"].values) if "quaternion" in recording else None
    pose = _rest_pose(position[window], recording)
    base_rotation = base_rotation_at_rest(matrices, index, window)
    base_travel = float(np.nanmax(np.linalg.norm(position[:, index] - pose[index], axis=1)))
    raw = position, matrices, BaseRest(index, pose[index], base_rotation)
    if remove_base_motion or base_motion:
        position, matrices = _without_base_motion(*raw, "base_motion" if base_motion else "remove_base_motion")
        pose = mean_place(position[window])
    offset = _offset(origin_offset, origin, pose[index])
    _check_only_station(recording, offset)
    y = base_tangent(tangent, pose, index, base_rotation, clamp_length)
    zero = pose[index] + (offset * y if offset.ndim == 0 else offset)
    about = {"motion": mean_place(position), "body": zero}  # the mean: a rest pose outside the plane must not tilt it
    method = plane if isinstance(plane, str) else "stated"
    direction = input_normal(recording, y, position, pose) if method == "input" else named_axis(plane, base_rotation)
    noise = 0.0 if rest is not None and window.all() else still_noise(position)  # of poses, differences are no noise
    normal, flatness = bending_normal(plane if direction is None else direction, y, position, about, noise)
    sign = 1 if method == "input" else bending_sign(recording, position, pose, zero, np.cross(y, normal))
    straight = bend is None or (space and method not in ("motion", "body", "input"))
    if not straight and sign not in (0, _wanted_sign(str(bend))):
        normal, sign = -normal, -sign
    rotation = np.roll(np.stack([np.cross(y, normal), y, normal]), int(space), axis=0)
    report = Alignment(
        base=str(recording["station"].values[index]), origin=tuple(zero.tolist()),
        rotation=tuple(tuple(row) for row in rotation.tolist()), tangent=_named(tangent), plane=_named(plane),
        bending=sign, rest_s=span, flatness=flatness, base_travel_m=base_travel,
        base_motion_removed=remove_base_motion or base_motion, frame="spatial" if space else "planar",
        **_out_of_plane(position, about["motion"], normal),
    )  # fmt: skip
    in_frame = _turned(position, zero, rotation if space else rotation[:2])
    turned = _orientations(matrices, window, rotation) if space else _angles(matrices, window, normal)
    arc = _arc_length(recording, arc_length, pose, index, offset)
    aligned = _aligned(recording, in_frame, {"quaternion" if space else "angle": turned}, arc, report)
    return with_base_input(aligned, raw, base_cutoff) if base_motion else aligned


def _check_positions(recording: xr.Dataset) -> None:
    check_recording(recording)
    if "position" not in recording and (shown := shape_variable(recording)):
        alone = "angles" if shown == "angle" else shown
        raise InputError(f"align needs positions, and the recording holds {alone} alone, which need no alignment: use "
                         "it as it is in a study, or in `pliant estimate` and `pliant contact`")
    if "position" not in recording or recording.attrs["frame"] == "spatial":
        raise InputError("align needs positions in the tracker's frame: pass the recording as read, not an aligned one")


def _check_only_station(recording: xr.Dataset, offset: NDArray) -> None:
    if recording.sizes["station"] == 1 and not offset.any():
        raise InputError(f"the only station, {recording['station'].values[0]}, cannot be base and tip at once: set "
                         "origin, the position of the base in tracker coordinates, and tangent")


def _without_jumps(recording: xr.Dataset, *, undo: bool) -> xr.Dataset:
    if "quaternion" not in recording:
        return recording
    if undo:
        return undo_orientation_jumps(recording)
    counts = orientation_jumps(recording["quaternion"].values)
    if counts.any():
        jumps = ", ".join(f"{n} {c}" for n, c in zip(recording["station"].values, counts, strict=True) if c)
        raise InputError(
            f"the orientation jumps by more than 30 degrees from frame to frame ({jumps}): for symmetric marker "
            "clusters set undo_jumps = true, otherwise leave the orientation out"
        )
    return recording


def _base_index(recording: xr.Dataset, base: str | None) -> int:
    names = [str(n) for n in recording["station"].values]
    if base is None:
        return names.index("base") if "base" in names else 0
    if base not in names:
        raise InputError(f"base is {base!r}, but there is no such station: set base to one of {', '.join(names)}")
    return names.index(base)


def _rest(
    recording: xr.Dataset, rest: Sequence[float] | None, index: int
) -> tuple[NDArray, tuple[float, float]]:
    time = recording["time"].values
    start, end = rest_window(seen_from_base(recording, index)) if rest is None else _pair(rest)
    window = (time >= start) & (time <= end)
    if not window.any():
        raise InputError(f"the rest window {start:g} to {end:g} s contains no frame: set rest within "
                         f"{time[0]:g} to {time[-1]:g} s, the time of the recording")  # fmt: skip
    return window, (float(start), float(end))


def _pair(rest: Sequence[float]) -> tuple[float, float]:
    try:
        start, end = (float(value) for value in rest)
    except (TypeError, ValueError):
        raise InputError(f"rest must be two times in seconds, start and end, not {rest!r}") from None
    return start, end


def _offset(value: float | Sequence[float], origin: Sequence[float] | None, base: NDArray) -> NDArray:
    """Return the offset from the base station (3,) to the origin: a length along the tangent (), or a vector (3,)."""
    if origin is not None:
        if not (isinstance(value, int | float) and value == 0.0):
            raise InputError("origin and origin_offset are both set: remove one of the two")
        if np.shape(origin) != (3,):
            raise InputError(f"origin must be three numbers in metres, not {origin!r}")
        return np.asarray(origin, dtype=np.float64) - base
    try:
        offset = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        offset = np.array([])
    if offset.shape not in ((), (3,)) or not np.isfinite(offset).all():
        raise InputError(f"origin_offset must be a length along the tangent or three numbers, in metres, not {value!r}")
    return offset


def _turned(position: NDArray, origin: NDArray, rows: NDArray) -> NDArray:
    """Return positions (T, S, d) relative to the origin in the directions of `rows` (d, 3)."""
    result = np.empty((*position.shape[:2], len(rows)))
    for i in range(0, len(position), BLOCK_FRAMES):
        result[i : i + BLOCK_FRAMES] = (position[i : i + BLOCK_FRAMES] - origin) @ rows.T
    return result


def without_unseen(recording: xr.Dataset) -> xr.Dataset:
    """Return the recording without the stations that no frame shows, named in its history; as it is if no frame shows
    any station, or all are shown.
    """
    seen = np.isfinite(recording["position"].values).all(axis=2).any(axis=0)
    if seen.all() or not seen.any():
        return recording
    unseen = ", ".join(str(name) for name in recording["station"].values[~seen])
    return append_history(recording.isel(station=seen), f"{unseen}: never labelled, left out")


def _rest_pose(position: NDArray, recording: xr.Dataset) -> NDArray:
    pose = mean_place(position)
    unseen = [str(n) for n, p in zip(recording["station"].values, pose, strict=True) if not np.isfinite(p).all()]
    if unseen:
        raise InputError(f"{', '.join(unseen)} is never seen in the rest window, which must show each "
                         "station at least once: choose another rest window")
    return pose


def seen_from_base(recording: xr.Dataset, index: int) -> xr.Dataset:
    """Return the recording with its positions relative to a base that moves as that of a robot does, from which a body
    on it may rest; the recording itself if its base stands still.
    """
    if not base_is_moved(recording, index):
        return recording
    position = recording["position"].values
    matrices = to_matrix(recording["quaternion"].values) if is_turned(recording, index) else None
    axes = None if matrices is None else base_rotation_at_rest(matrices, index, np.ones(len(position), bool))
    shape, _ = _without_base_motion(position, matrices, BaseRest(index, np.zeros(3), axes), "base_motion")
    return recording.assign(position=recording["position"].copy(data=shape))


def _without_base_motion(
    position: NDArray, matrices: Any, rest: BaseRest, option: str
) -> tuple[NDArray, NDArray | None]:
    if rest.axes is None and (option == "remove_base_motion" or matrices is not None):
        raise InputError(f"{option} needs the orientation of the base station, which this recording lacks at rest: "
                         f"leave {option} out")
    back, base = np.swapaxes(turns_of_base(position, matrices, rest), -1, -2), position[:, rest.station, None]
    turned = None if matrices is None else back[:, None] @ matrices
    return np.einsum("tij,tsj->tsi", back, position - base) + rest.position, turned


def _wanted_sign(bend: str) -> int:
    if bend not in ("positive", "negative"):
        raise InputError(f"bend must be 'positive', 'negative' or None, not {bend!r}")
    return 1 if bend == "positive" else -1


def _named(option: Any) -> str:
    return option if isinstance(option, str) else f"given {[float(f'{v:.4g}') for v in option]}"


def _out_of_plane(position: NDArray, middle: NDArray, normal: NDArray) -> dict[str, float]:
    whole = square = largest = count = 0.0
    for moved in seen_points(position, middle):
        out = moved @ normal
        count += len(moved)
        whole += float((moved**2).sum())
        square += float(out @ out)
        largest = max(largest, float(np.abs(out).max(initial=0.0)))
    whole, rms = math.sqrt(whole / max(count, 1.0)), math.sqrt(square / max(count, 1.0))
    return {
        "out_of_plane_rms_m": rms, "out_of_plane_max_m": largest,
        "out_of_plane_share": rms / whole if whole > 0 else 0.0,
    }  # fmt: skip


def _angles(matrices: NDArray | None, window: NDArray, normal: NDArray) -> NDArray | None:
    """Return the rotation (T, S) [rad] about the normal since rest, without jumps by a full turn."""
    if matrices is None:
        return None
    start = mean_rotation(matrices[window])
    angle = angle_about(matrices @ np.swapaxes(start, -1, -2), normal)
    for s in range(angle.shape[1]):
        known = np.flatnonzero(np.isfinite(angle[:, s]))
        angle[known, s] = np.unwrap(angle[known, s])
    return angle if np.isfinite(angle).any() else None


def _orientations(matrices: NDArray | None, window: NDArray, rotation: NDArray) -> NDArray | None:
    """Return the rotation (T, S, 4) since rest in the axes of the base frame, without sign changes along time."""
    if matrices is None:
        return None
    since = matrices @ np.swapaxes(mean_rotation(matrices[window]), -1, -2)
    quaternion, _ = continuous(from_matrix(rotation @ since @ rotation.T))
    return quaternion if np.isfinite(quaternion).any() else None


def _arc_length(
    recording: xr.Dataset, given: Sequence[float] | None, pose: NDArray, index: int, offset: NDArray
) -> ArrayLike | None:
    if given is not None:
        return given
    if "arc_length" in recording.coords:
        return recording["arc_length"].values
    if len(pose) < DENSE_STATIONS:
        return None
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(pose, axis=0), axis=1))])
    return arc - arc[index] - (float(offset) if offset.ndim == 0 else 0.0)


def _aligned(
    recording: xr.Dataset, place: NDArray, turned: dict[str, Any], arc: ArrayLike | None, report: Alignment
) -> xr.Dataset:
    attrs = dict(recording.attrs) | {"frame": report.frame, "alignment": json.dumps(asdict(report))}
    result = make_recording(
        recording["time"].values, place, station=[str(n) for n in recording["station"].values], **turned,
        arc_length=arc, frame=report.frame, attrs=attrs,
    )  # fmt: skip
    others = recording.drop_dims("station").drop_vars(["axis", "component"], errors="ignore")
    result = result.assign({n: others[n] for n in others.data_vars}).assign_attrs(attrs)
    refuse_loss(recording, result, "align", ("quaternion", "angle"))
    space = report.frame == "spatial"
    frame = f"base {report.base} at the origin, tangent {report.tangent} along +{'z' if space else 'y'}, "
    frame += f"plane {report.plane}{' normal to x' if space else ''}"
    rest = f"rest {report.rest_s[0]:.3g} to {report.rest_s[1]:.3g} s, bending sign {report.bending:+d}"
    out = f"{1e3 * report.out_of_plane_rms_m:.3g} mm rms ({100 * report.out_of_plane_share:.2g} % of the motion)"
    lines = [f"aligned: {frame}, {rest}", f"out of plane {out}, {'kept' if space else 'left out'}"]
    lines += clock_finding(seen_from_base(recording, _base_index(recording, report.base)))
    if report.flatness > VAGUE_PLANE:
        lines.append(f"the plane of bending is uncertain: the motion across it is {100 * report.flatness:.0f} % of "
                     "the motion in it")
    if report.base_travel_m > 0:
        what = "removed" if report.base_motion_removed else "kept as part of the motion"
        lines.append(f"the base moved up to {1e3 * report.base_travel_m:.3g} mm; its motion is {what}")
    return check_recording(append_history(result, *lines))
