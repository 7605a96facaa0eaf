"""Convert columns of a table to the arrays of a recording: stations, orientations and inputs in SI units."""

from __future__ import annotations

import re
from collections import defaultdict
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from pliant.errors import InputError, clipped
from pliant.recording.arrays import INPUT_SI
from pliant.recording.camera import Camera
from pliant.recording.clock import SECONDS
from pliant.recording.column_names import COUNTERS, WORDS, parted
from pliant.recording.inclination import InclinationMapping
from pliant.recording.mapping import FileMapping, shorten
from pliant.units import PASCAL, DrivenBy, metre_per, pascal_per, radian_per

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

Column = int | str
COMPONENT = re.compile(r"(?:.*(?:[\W_]|q))?([xyzw])", re.IGNORECASE)  # at the end of the name of a quaternion's column

RENAMED = "yzwx"  # names, in the order x, y, z, w, of columns w, x, y, z that are named x, y, z, w


class EulerColumns(FileMapping):
    """Columns of the three Euler angles of a station, in the order of the rotations, with their unit.

    `order` names the axes: lower case, such as "xyz", for rotations about fixed axes, upper case, such as "ZYX" (yaw,
    pitch, roll), for rotations about the body's own axes.
    """

    columns: list[Column] = Field(min_length=3, max_length=3)
    order: str = Field(pattern="^([xyz]{3}|[XYZ]{3})$")
    unit: Literal["deg", "rad"]

    @field_validator("order")
    @classmethod
    def _turns(cls, value: str) -> str:
        if value[0] == value[1] or value[1] == value[2]:
            raise ValueError(f"{value!r} turns twice about one axis in a row: name three rotations, such as 'ZYX'")
        return value


class StationColumns(FileMapping):
    """Columns of one station in a table: its position x, y, z (or x, y) and, optionally, its orientation, as a
    quaternion x, y, z, w or as Euler angles.

    With `status`, rows in which this column holds none of the words `valid` are gaps of the station.
    """

    position: list[Column] = Field(min_length=2, max_length=3)
    quaternion: list[Column] | None = Field(default=None, min_length=4, max_length=4)
    euler: EulerColumns | None = None
    status: Column | None = None
    valid: list[str | float] = Field(default=["OK"])

    @field_validator("euler", mode="before")
    @classmethod
    def _as_table(cls, value: Any) -> Any:
        if value is not None and not hasattr(value, "items") and not isinstance(value, EulerColumns):
            raise ValueError('write a table, as { columns = ["yaw", "pitch", "roll"], order = "ZYX", unit = "deg" }')
        return value

    @model_validator(mode="after")
    def _one_orientation(self) -> Self:
        if self.quaternion is not None and self.euler is not None:
            raise ValueError("give either quaternion or euler, not both")
        named = [COMPONENT.fullmatch(c.partition(" [")[0]) for c in self.quaternion or [] if isinstance(c, str)]
        letters = "".join(match[1].lower() for match in named if match)
        if sorted(letters) == sorted("xyzw") and letters not in ("xyzw", RENAMED):
            raise ValueError(f"quaternion lists {', '.join(letters)}, as the names of its columns say: list them in "
                             "the order x, y, z, w or, if the names are wrong, by the indices of the columns")
        return self


class Points(FileMapping):
    """Columns of a table that hold `count` stations side by side: the first column and the order of the coordinates."""

    count: int = Field(gt=0)
    order: Literal["xyz", "xy", "yx", "xzy", "yxz", "yzx", "zxy", "zyx"] = "xyz"
    first: int = Field(default=0, ge=0)


class PressureColumns(FileMapping):
    """Columns of a table that hold gauge pressure, with their unit and the names of the chambers.

    Raw counts become pressures by (counts - `zero`) * `scale`, in `unit`; one number, or one for each column.
    """

    columns: list[Column] = Field(min_length=1)
    unit: str
    chamber: list[str] | None = None
    scale: float | list[float] = 1.0
    zero: float | list[float] = 0.0


class InputColumns(FileMapping):
    """Columns of a table that hold actuation inputs other than pressure: their kind (tension, displacement or angle),
    unit and names.

    Steps or counts become values by (counts - `zero`) * `scale`, in `unit`; one number, or one for each column.
    """

    columns: list[Column] = Field(min_length=1)
    kind: DrivenBy
    unit: str
    names: list[str] | None = None
    scale: float | list[float] = 1.0
    zero: float | list[float] = 0.0


class Select(FileMapping):
    """Filter that keeps the table rows in which `column` equals `value`, a number or a text, such as one trial of
    several. Without `value`, `pliant new` makes a recording of each value.
    """

    column: Column
    value: float | str | None = None


class ColumnMapping(FileMapping):
    """Options that describe a plain table of numbers: which columns hold time, stations, angles and inputs, and in
    which units.

    Attributes
    ----------
    delimiter : str, optional
        One character, or ``"space"`` for any white space. Default: the first of ``; tab | ,`` in the first row, or
        white space.
    header : bool, optional
        Whether the first row holds the names of the columns. Default: whether it holds texts and no number.
    skip_lines : int, optional
        Lines before the table. Default: those with at most half as many cells as its rows.
    time : column or two columns, optional
        Column of time in `time_unit` (default: the unit in its name, or s), or a column of seconds and one of their
        fraction in `time_unit`. Times of day, such as 10:11:12.5, are read as they are. Without it `rate_hz` is needed.
    time_unit : {"s", "ms", "us", "ns", "100ns", "min", "h"}
        Unit of the column of time, or of the column of the fraction.
    input_time : column, optional
        Column of the times of pressure and inputs, where they have a clock of their own in the table.
    na : list of str or float
        Marks of missing values, beside empty cells and NaN.
    rate_hz : float, optional
        Frame rate of a table without a time column.
    length_unit : str
        Unit of the positions: m, cm, mm, um or in.
    camera : Camera, optional
        Instead of `length_unit`, where positions are in pixels, x to the right and y down.
    stations : dict of StationColumns, optional
        Columns by the name of the station, from base to tip.
    points : Points, optional
        Instead of `stations`: ``{ count = 20, order = "xyz", first = 0 }``, points side by side from one column on. A
        table without `stations`, `points` and `angles` is a log of inputs.
    arc_length : list of float, m, optional
        Arc length of each station, from base to tip.
    angles : dict of columns, optional
        Instead of positions: one column for each station of which only the angle was measured, from base to tip; or
        the three columns of its acceleration x, y, z, which show the direction of gravity; or the four of its
        quaternion x, y, z, w.
    angle_unit : {"deg", "rad"}
        Unit of `angles`; needed with a single column for each.
    inclination : InclinationMapping, optional
        For accelerations or quaternions of sensors on a body in space: takes the direction of gravity in the axes of
        the links in place of angles in a plane.
    pressure : PressureColumns, optional
        Gauge pressures in Pa, hPa, kPa, MPa, bar, mbar, psi, mmHg, inHg, cmH2O, atm or kgf/cm2.
    inputs : InputColumns or list of them, optional
        Tensions or displacements of tendons, angles of motors.
    select : Select, optional
        Trial to read, of several in the table, by a number or a text.
    rows : (first, last), optional
        Rows to keep after `select`, counted from 0, the last excluded.
    left_handed : bool
        Whether the axes of the positions and orientations are left-handed, as those of Unity are: z is reversed, which
        makes them right-handed.
    """

    delimiter: str | None = None
    header: bool | None = None
    skip_lines: int | None = Field(default=None, ge=0)
    time: Column | tuple[Column, Column] | None = None
    input_time: Column | None = None
    na: list[str | float] = Field(default=[])
    time_unit: Literal["s", "ms", "us", "ns", "100ns", "min", "h"] = "s"
    rate_hz: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    length_unit: str = ""
    camera: Camera | None = None
    stations: dict[str, StationColumns] | None = None
    points: Points | None = None
    angles: dict[str, Column | list[Column]] | None = None
    angle_unit: Literal["deg", "rad", "rev"] | None = None
    inclination: InclinationMapping | None = None
    arc_length: list[float] | None = None
    pressure: PressureColumns | None = None
    inputs: list[InputColumns] = Field(default=[])
    select: Select | None = None
    rows: tuple[int, int] | None = None
    left_handed: bool = False

    @field_validator("inputs", mode="before")
    @classmethod
    def _as_list(cls, value: Any) -> Any:
        return [value] if hasattr(value, "items") else value

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        rate = self.rate_hz or (self.camera.rate_hz if self.camera and self.time is None else None)
        if (self.time is None) == (rate is None):
            raise ValueError("give either time (the column of time) or rate_hz")
        if self.stations and self.points is not None:
            raise ValueError("give either stations or points, not both")
        placed = bool(self.stations) or self.points is not None
        if not placed and not self.angles and self.pressure is None and not self.inputs:
            raise ValueError("give stations, points or angles; or, for a log without a shape, pressure or inputs")
        widths = {len(columns) if isinstance(columns, list) else 1 for columns in (self.angles or {}).values()}
        if self.angles and (placed or self.left_handed):
            raise ValueError("angles cannot be combined with stations or points: leave out one of them" if placed else
                             "left_handed is for positions: remove it, and state the axes of sensors by inclination")
        if self.angles and self.angle_unit is None and widths == {1}:
            raise ValueError("angles need angle_unit: 'deg', 'rad' or 'rev'")
        if widths - {1} and widths not in ({3}, {4}, {3, 4}):
            raise ValueError("angles need one column for each station, or the 3 of its acceleration or the 4 of its "
                             "quaternion")
        if self.inclination is not None and (not self.angles or 1 in widths):
            raise ValueError("inclination needs angles with the 3 columns of an acceleration or the 4 of a quaternion "
                             "for each station")
        if placed and bool(self.length_unit) == (self.camera is not None):
            raise ValueError("positions need length_unit, such as 'mm', or camera where they are in pixels, not both")
        if self.delimiter not in (None, "space") and len(self.delimiter or "") != 1:
            raise ValueError('delimiter is one character, or "space" for any white space')
        return self


class ColumnHeader:
    """Header of a table: its file name, its column names (empty where the first row holds numbers) and the number of
    columns.
    """

    def __init__(self, names: list[str], width: int, file: str) -> None:
        self.names, self.width, self.file = names, width, file
        self.in_seconds: set[int] = set()  # columns of times of day, whose unit no name states
        self.where: dict[str, list[int]] = defaultdict(list)
        for k, name in enumerate(names):
            self.where[name].append(k)

    def index(self, column: Column) -> int:
        """Return the index of a table column that is given by index or name; raise InputError where none or several
        match.
        """
        if isinstance(column, str):
            matches = self.where.get(column, []) or [k for k, n in enumerate(self.names) if n.startswith(f"{column} [")]
            if not matches:
                available = shorten(self.names, 40) or "none, since its first row holds numbers: use indices from 0"
                raise InputError(f"{self.file} has no column {clipped(column)!r}: correct the mapping; available: "
                                 f"{available}")
            if len(matches) > 1:
                raise InputError(f"{self.file} has {len(matches)} columns named {clipped(column)!r}: give the index of "
                                 "one in the mapping")
            return matches[0]
        if not 0 <= column < self.width:
            raise InputError(f"{self.file} has no column {column}, since its columns are 0 to {self.width - 1}: "
                             "correct the mapping")
        return column

    def unit_of_time(self, column: Column, options: ColumnMapping) -> str:
        """Return the unit of a column of time: as the mapping states it, or else as the name of the column does.

        Raises
        ------
        InputError
            When the mapping names the column without the unit in its name, and states another.
        """
        index = self.index(column)
        if index in self.in_seconds:
            return "s"
        name = self.names[index] if self.names else ""
        unit = COUNTERS.get(name.lower(), parted(name)[1])
        if unit not in SECONDS or "time_unit" not in options.model_fields_set:
            return unit if unit in SECONDS else options.time_unit
        if isinstance(column, str) and column != name and unit != options.time_unit:
            raise InputError(f"the mapping states time_unit = {options.time_unit!r}, but the column {clipped(name)!r} "
                             f"of {self.file} is in {unit}: correct time_unit, or write the whole name as time")
        return options.time_unit


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
    if options.left_handed:
        position, quaternion = position * [1.0, 1.0, -1.0], quaternion * [-1.0, -1.0, 1.0, 1.0]
        history.append("z of the left-handed axes is reversed, which makes them right-handed")
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
        labels = group.names or [header.names[i] if header.names else f"column_{i}" for i in indices]
        if len(labels) != len(indices):
            raise InputError(f"the mapping for {header.file} gives {len(labels)} names to {len(indices)} columns of "
                             "inputs: give one name to each column")  # fmt: skip
        stored = from_counts(table[:, indices], group.scale, group.zero, header.file)
        values.append(stored * INPUT_SI[group.kind](group.unit))
        names += labels
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


def pressure_unit(name: str) -> str | None:
    """Return the unit in the name of a pressure column, such as ``p_kpa``; None for any other column."""
    parts = name.split("_")
    if name.lower() in PASCAL:  # a small logger's psi, kPa or mbar
        return name
    return parts[1] if len(parts) >= 2 and parts[0] == "p" and parts[1].lower() in {*PASCAL} - WORDS else None


def pressures_of(columns: dict[str, NDArray]) -> tuple[NDArray | None, list[str] | None]:
    """Return the pressures [Pa] in the pressure columns of a table with T rows, and the names of the chambers. A single
    column without a chamber name, such as ``p_kpa``, gives (T,) and no names. C columns, such as ``p_kpa_left``, give
    (T, C) and C names.
    """
    units = {name: unit for name in columns if (unit := pressure_unit(name))}
    if "p" in columns:
        raise InputError("the column p does not state its unit: rename it p_kpa, p_bar, p_psi or p_pa")
    if not units:
        return None, None
    values = [columns[name] * pascal_per(unit) for name, unit in units.items()]
    if len(units) == 1 and next(iter(units)).count("_") <= 1:
        return values[0], None
    return np.stack(values, -1), ["_".join(name.split("_")[2:]) or "p" for name in units]
