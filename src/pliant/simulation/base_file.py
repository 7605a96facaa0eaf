"""Read the prescribed motion of a base from a file of its poses."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pliant.errors import InputError, clipped
from pliant.preprocessing.rotations import continuous, from_matrix, to_matrix
from pliant.recording import read
from pliant.recording.columns import first_cells
from pliant.simulation.base_motion import BaseMotion
from pliant.units import METRE, RADIAN

Array = np.ndarray
FLAT = 0.01  # fraction of the motion, or rad, by which the base of a planar body may leave its plane
COLUMN = re.compile(r"(?:base_)?(?P<what>[xyz]|q_?[xyzw]|angle)(?:[ _]?[\[(]?(?P<unit>m|mm|cm|um|in|rad|deg)[\])]?)?",
                    re.IGNORECASE)  # fmt: skip
TURN = re.compile(r"(?:base_)?(theta|phi|psi|yaw|pitch|roll|heading|rot|r[xyz]|angle|q)(?![a-z])", re.IGNORECASE)


def read_base(
    path: str | Path, dimension: int, mapping: Mapping[str, Any] | None = None, cutoff: float | None = None,
) -> BaseMotion:
    """Read poses of a base over time, and return them relative to the first known pose, as a simulation takes them.

    Parameters
    ----------
    path : path
        File of one station that shows the poses of the base frame in any fixed axes: in space its z axis is along the
        body from its base, in the plane its y axis. A table has columns such as t_s, x_m, y_m, z_m, qx, qy, qz, qw; for
        a planar body x_m, y_m, angle_deg. Without orientations the base does not turn.
    dimension : {2, 3}
        Of the space in which the body moves.
    mapping : dict, optional
        Columns and units of the file, as for recordings.
    cutoff : float, Hz, optional
        For measured poses with noise, see `BaseMotion`.

    Raises
    ------
    InputError
        When the file shows no or several stations, or a motion out of the plane of a planar body.
    """
    path = Path(path)
    named = None if mapping else poses_by_name(path, dimension)
    time, position, axes = named or poses_of(read(path, mapping=dict(mapping) if mapping else None), path.name)
    known = np.isfinite(position).all(axis=1) & np.isfinite(axes).all(axis=(1, 2))
    if not known.any():
        raise InputError(f"{path.name} has no row with a complete pose of the base (position and angle, in space "
                         "position and quaternion): check its columns")
    first = int(np.argmax(known))
    moved, turned = (position - position[first]) @ axes[first], axes[first].T @ axes
    if dimension == 3:
        quaternion = np.full((len(time), 4), np.nan)
        quaternion[known] = continuous(from_matrix(turned[known])[:, None])[0][:, 0]
        return BaseMotion(time, moved, quaternion=quaternion, cutoff=cutoff)
    size = float(np.ptp(moved[known], axis=0).max())
    across = float(np.abs(moved[known, 2]).max())
    tilt = float(np.abs(turned[known][:, 2, :2]).max())
    if across > FLAT * max(size, 1e-9) or tilt > FLAT:
        raise InputError(f"the base of {path.name} leaves its x-y plane by {1e3 * across:.3g} mm and {tilt:.2g} rad, "
                         "but the body moves in a plane: use a model in space, or give the poses in this plane")
    angle = np.full(len(time), np.nan)
    angle[known] = np.unwrap(np.arctan2(turned[known, 1, 0], turned[known, 0, 0]))
    return BaseMotion(time, np.where(known[:, None], moved[:, :2], np.nan), angle=angle, cutoff=cutoff)


def poses_of(recording: xr.Dataset, file: str) -> tuple[Array, Array, Array]:
    """Return times (T,) [s], positions (T, 3) [m] and axes (T, 3, 3) of the only station of a recording."""
    if "position" not in recording or recording.sizes["station"] != 1:
        names = [str(n) for n in recording["station"].values] if "station" in recording.coords else []
        content = f"the stations {clipped(', '.join(names), 80)}" if names else "no positions"
        raise InputError(f"{file} must hold the poses of the base alone, but it holds {content}: name the base as the "
                         "only station in its mapping")
    position = recording["position"].values[:, 0]
    if position.shape[1] == 2:
        position = np.pad(position, ((0, 0), (0, 1)))
    axes = np.tile(np.eye(3), (len(position), 1, 1))
    if "quaternion" in recording:
        axes = to_matrix(recording["quaternion"].values[:, 0])
    return recording["time"].values, position, axes


def poses_by_name(path: Path, dimension: int) -> tuple[Array, Array, Array] | None:
    """Return times (T,) [s], positions (T, 3) [m] and axes (T, 3, 3) from the columns of a table whose names, such as
    x_mm, qx or angle_deg, are those of a single pose; None for any other file.
    """
    if path.is_dir() or path.suffix.lower() not in (".csv", ".txt", ".tsv", ".dat"):
        return None
    names = first_cells(path, {})
    columns = {match["what"].lower().replace("_", ""): (name, match["unit"] or "") for name in names
             if (match := COLUMN.fullmatch(name.strip()))}  # fmt: skip
    axis_columns = [columns[axis] for axis in "xyz" if axis in columns]
    if len(axis_columns) < 2:
        return None
    check_turns(path, names, columns)
    lengths, (angle, unit) = {length for _, length in axis_columns}, columns.get("angle", ("", ""))
    if len(lengths) > 1 or not lengths <= {*METRE} or (angle and unit not in RADIAN):
        raise InputError(f"{path.name}: name the units of the base's columns, such as x_m, y_m, angle_deg")
    station: dict[str, Any] = {"position": [name for name, _ in axis_columns]}
    if all(f"q{part}" in columns for part in "xyzw"):
        station["quaternion"] = [columns[f"q{part}"][0] for part in "xyzw"]
    if angle and dimension == 3:
        raise InputError(f"{path.name} states an angle in a plane, but the body moves in space: state qx, qy, qz, qw")
    recording = read(path, mapping={"stations": {"base": station}, "length_unit": lengths.pop()})
    if "quaternion" in station and "quaternion" not in recording:
        raise InputError(f"{path.name} has no valid quaternion of the base: check its columns, or leave them out")
    time, position, axes = poses_of(recording, path.name)
    if not angle:
        return time, position, axes
    turns = read(path, mapping={"angles": {"base": angle}, "angle_unit": unit})
    if not np.array_equal(time, turns["time"].values):
        raise InputError(f"{path.name} repeats times: leave one row for each time")
    c, s = np.cos(turns["angle"].values[:, 0]), np.sin(turns["angle"].values[:, 0])
    zero = 0.0 * c
    return time, position, np.moveaxis(np.array([[c, -s, zero], [s, c, zero], [zero, zero, zero + 1.0]]), -1, 0)


def check_turns(path: Path, names: Sequence[str], columns: Mapping[str, tuple[str, str]]) -> None:
    """Raise InputError if a table of a base's poses has columns of its rotation that are not read, or two rotations.

    `columns` holds the name and unit of each column that is read, by its meaning.
    """
    parts = [part for part in "xyzw" if f"q{part}" in columns]
    used = {name for name, _ in columns.values()}
    unread = [name for name in names if name not in used and TURN.match(name.strip())]
    if unread or len(parts) in (1, 2, 3) or (parts and "angle" in columns):
        raise InputError(f"{path.name} states the base's rotation in columns that are not read, or twice: name them "
                         "angle_deg, or qx, qy, qz, qw, or name them by --base-mapping")  # fmt: skip
