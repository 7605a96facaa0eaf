"""Convert columns of a table to the arrays of a recording: stations, orientations and inputs in SI units."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError, clipped
from pliant.recording.arrays import INPUT_SI
from pliant.recording.mapping import shorten
from pliant.units import metre_per, pascal_per, radian_per

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from pliant.recording.column_mapping import Column, ColumnMapping, EulerColumns, PressureColumns, StationColumns



class ColumnHeader:
    """Header of a table: its file name, its column names (empty where the first row holds numbers) and the number of
    columns.
    """

    def __init__(self, names: list[str], width: int, file: str) -> None:
        self.names, self.width, self.file = names, width, file
        self.where: dict[str, list[int]] = defaultdict(list)
        for k, name in enumerate(names):
            self.where[name].append(k)

    def index(self, column: Column) -> int:
        """Return the index of a table column that is given by index or name; raise InputError where none or several
        match.
        """
        if isinstance(column, str):
            held = self.where.get(column, [])
            if not held:
                available = shorten(self.names, 40) or "none, since its first row holds numbers: use indices from 0"
                raise InputError(f"{self.file} has no column {clipped(column)!r}: correct the mapping; available: "
                                 f"{available}")
            if len(held) > 1:
                raise InputError(f"{self.file} has {len(held)} columns named {clipped(column)!r}: give the index of "
                                 "one in the mapping")
            return held[0]
        if not 0 <= column < self.width:
            raise InputError(f"{self.file} has no column {column}, since its columns are 0 to {self.width - 1}: "
                             "correct the mapping")
        return column


def station_arrays(
    table: NDArray, header: ColumnHeader, stations: Mapping[str, StationColumns], options: ColumnMapping
) -> tuple[dict[str, Any], list[str]]:
    """Return the arguments of `make_recording` for the stations of a table, and sentences for the history."""
    position = np.zeros((len(table), len(stations), 3))
    quaternion = np.full((len(table), len(stations), 4), np.nan)
    history = []
    for s, (name, columns) in enumerate(stations.items()):
        indices = [header.index(c) for c in columns.position]
        position[:, s, : len(indices)] = table[:, indices] * metre_per(options.length_unit or "m")
        if columns.quaternion is not None:
            quaternion[:, s] = table[:, [header.index(c) for c in columns.quaternion]]
        elif columns.euler is not None:
            angles = table[:, [header.index(c) for c in columns.euler.columns]]
            quaternion[:, s] = euler_quaternions(angles, columns.euler)
            frame = "the body's own, turned" if columns.euler.order.isupper() else "fixed"
            history.append(f"orientation of {name} from Euler angles {columns.euler.order}, about {frame} axes")
    if any(len(c.position) == 2 for c in stations.values()):
        history.append("stations with two coordinates got z = 0")
    arrays: dict[str, Any] = {"position": position, "station": list(stations), "arc_length": options.arc_length}
    if not np.isnan(quaternion).all():
        arrays["quaternion"] = quaternion
    return arrays, history


def euler_quaternions(angles: NDArray, columns: EulerColumns) -> NDArray:
    """Return the quaternions (T, 4) x, y, z, w of Euler angles (T, 3) in the order of their columns; NaN for gaps."""
    from scipy.spatial.transform import Rotation

    quaternion = np.full((len(angles), 4), np.nan)
    known = np.isfinite(angles).all(axis=1)
    if known.any():
        turned = Rotation.from_euler(columns.order, angles[known] * radian_per(columns.unit))
        quaternion[known] = turned.as_quat()
    return quaternion


def pressure_arrays(table: NDArray, header: ColumnHeader, columns: PressureColumns | None) -> dict[str, Any]:
    """Return the arguments of `make_recording` for the gauge pressures of a table."""
    if columns is None:
        return {}
    indices = [header.index(c) for c in columns.columns]
    values = from_counts(table[:, indices], columns.scale, columns.zero, header.file) * pascal_per(columns.unit)
    chamber = [str(c) for c in columns.columns] if len(indices) > 1 else None
    return {"pressure": values, "chamber": columns.chamber or chamber}


def input_arrays(table: NDArray, header: ColumnHeader, options: ColumnMapping) -> dict[str, Any]:
    """Return the arguments of `make_recording` for the inputs other than pressure."""
    if not options.inputs:
        return {}
    values, names, kinds = [], [], []
    for group in options.inputs:
        indices = [header.index(c) for c in group.columns]
        given = group.names or [header.names[i] if header.names else f"column_{i}" for i in indices]
        if len(given) != len(indices):
            raise InputError(f"the mapping for {header.file} gives {len(given)} names to {len(indices)} columns of "
                             "inputs: give one name to each column")  # fmt: skip
        stored = from_counts(table[:, indices], group.scale, group.zero, header.file)
        values.append(stored * INPUT_SI[group.kind](group.unit))
        names += given
        kinds += [group.kind] * len(indices)
    return {"actuation": np.concatenate(values, axis=1), "input_names": names, "input_kind": kinds}


def from_counts(
    stored: NDArray, scale: float | Sequence[float], zero: float | Sequence[float], file: str
) -> NDArray:
    """Return (stored - zero) * scale for the values (T, C) of C columns, with one number or C numbers each."""
    for name, entry in (("scale", scale), ("zero", zero)):
        if np.ndim(entry) and np.shape(entry) != stored.shape[1:]:
            raise InputError(f"the mapping for {file} gives {np.size(entry)} numbers in {name} to {stored.shape[1]} "
                             "columns: give one for all, or one for each")
    if not np.all(scale):
        raise InputError(f"the mapping for {file} has scale = 0, which would erase a column: give another scale")
    return np.asarray((stored - np.asarray(zero, float)) * np.asarray(scale, float))


def calibrated(names: Sequence[Any], scale: Any, zero: Any, unit: str) -> list[str]:
    """Return a sentence for the history on the scale and zero that a mapping states for inputs; none for 1 and 0."""
    if (scale, zero) == (1.0, 0.0):
        return []
    listed = ", ".join(clipped(str(name), 40) for name in names)
    return [f"{listed}: value = (stored value - {zero}) * {scale} {unit}"]
