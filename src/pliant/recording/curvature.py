"""Reader of curvature tables, as fibre Bragg grating interrogators export: curvature is integrated to a shape.

The first row names the columns: one time (``t``, ``t_ms``, ``time``) and curvatures ``k_<arc length>``. A body that
leaves the plane also has directions of bending ``a_<arc length>``, or two components of curvature. The mapping states
the unit. Set ``format = "curvature"`` for a file with other names. The base is at the origin, its tangent along +y.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from pliant.errors import InputError, clipped, inside
from pliant.numerics.curve import planar_curve, spatial_curve
from pliant.recording.clock import SECONDS, unwrapped
from pliant.recording.column_arrays import pressure_unit, pressures_of
from pliant.recording.column_names import bracketed_unit, is_time, parted, pressures_named, standard_names
from pliant.recording.mapping import FileMapping, shorten
from pliant.recording.registry import ENDINGS, Reader
from pliant.recording.schema import make_recording
from pliant.recording.tables import find_delimiter, preamble_of, read_rows, read_text, split_cells
from pliant.units import metre_per, radian_per

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    import xarray as xr
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

ARC = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(mm|cm|m)?\s*(?:[\[(][^\[\]()]*[\])])?", re.IGNORECASE)
PER_METRE = {"1/m": 1.0, "1/cm": 1e2, "1/mm": 1e3}


class CurvatureMapping(FileMapping):
    """Options of the reader of curvature tables: units and names of the columns, and the frame rate.

    Attributes
    ----------
    curvature_unit : {"1/m", "1/cm", "1/mm"}
        Unit of the curvatures.
    arc_unit : str
        Unit of the arc lengths in the column names.
    curvature, direction : str
        Beginning of the names of these columns, before the arc length.
    direction_unit : {"deg", "rad"}, optional
        Default: the unit in the names of these columns, such as ``Angle 10 mm (rad)``, else degrees.
    components : (str, str), optional
        Beginning of the names of the two components of curvature, in place of `curvature` and `direction`. They are
        the components in the directions of 0 and 90 degrees of a frame that does not twist about the body.
    pressure_unit : str, optional
        Unit of columns whose names say pressure and no unit.
    time_unit : {"s", "ms", "us"}, optional
        Default: the unit in the name of the time column, else seconds.
    rate_hz : float, optional
        Frame rate of a table without a column of time.
    skip_lines : int, optional
        Lines before the row of names. Default: those with at most half as many cells as its rows.
    """

    curvature_unit: Literal["1/m", "1/cm", "1/mm"]
    arc_unit: str = "mm"
    curvature: str = "k_"
    direction: str = "a_"
    direction_unit: Literal["deg", "rad"] | None = None
    components: tuple[str, str] | None = None
    pressure_unit: str | None = None
    time_unit: Literal["s", "ms", "us"] | None = None
    rate_hz: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    skip_lines: int | None = Field(default=None, ge=0)


def read_curvature(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read a table of curvature along a fibre, integrate it to a shape and return the shape as a recording."""
    options = CurvatureMapping.load(mapping, path.name)
    lines = read_text(path).split("\n")
    first_line = preamble_of(lines) if options.skip_lines is None else options.skip_lines
    if len(lines) <= first_line or not lines[first_line].strip():
        raise InputError(f"{path.name} has no row of column names after its first {first_line} line(s): "
                         "reduce skip_lines in its mapping")
    delimiter = find_delimiter(lines[first_line], path.name)
    names = split_cells(lines[first_line], delimiter)
    table, history = read_rows(lines, first_line + 1, delimiter, path.name, len(names))
    first, second = options.components or (options.curvature, options.direction)
    columns = arcs_of(names, first, options.arc_unit, path.name)
    if len(columns) < 2:
        raise InputError(f"{path.name} has {len(columns)} columns of curvature, named {first}<arc length>, "
                         f"but needs two or more: set curvature in its mapping. Its columns are {shorten(names, 8)}")
    arc = np.array(sorted(columns))
    kappa = table[:, [columns[s] for s in arc.tolist()]] * PER_METRE[options.curvature_unit]
    turning = arcs_of(names, second, options.arc_unit, path.name)
    if (turning or options.components) and sorted(turning) != arc.tolist():
        what = f"columns {second}<arc length>" if options.components else "directions"
        raise InputError(f"{path.name} must have {what} at the same arc lengths as curvatures: correct its columns")
    other = table[:, [turning[s] for s in arc.tolist()]] if turning else None
    unit = options.direction_unit or unit_in(names, turning.values(), path.name)
    position = integrated(kappa, other, arc, options.model_copy(update={"direction_unit": unit}))
    time, wrapped = time_of(table, names, options, path.name)
    used = {*columns.values(), *turning.values()}
    other_names = {k: n for k, n in enumerate(names) if k not in used and not is_time(n)}
    standard = standard_names(list(other_names.values()), path.name).names
    if options.pressure_unit:
        standard, named = pressures_named(standard, options.pressure_unit, path.name)
        history += named
    pressures = {n: table[:, k] for k, n in zip(other_names, standard, strict=True) if pressure_unit(n)}
    pressure, chamber = pressures_of(pressures)
    left = [n for n, label in zip(other_names.values(), standard, strict=True) if label not in pressures]
    history += [f"{len(left)} column(s) of {path.name} were left out: {shorten(left)}"] if left else []
    history.append(f"integrated curvature at {len(arc)} stations, {1e3 * (arc[-1] - arc[0]):.1f} mm, to a shape")
    with inside(path.name):
        return make_recording(
            time, position, arc_length=arc - arc[0], history=[*history, *wrapped], pressure=pressure,
            pressure_time=None if pressure is None else time, chamber=chamber,
        )  # fmt: skip


def integrated(kappa: Array, other: Array | None, arc: Array, options: CurvatureMapping) -> Array:
    """Integrate the curvature (T, S) [1/m] at S arc lengths `arc` [m] over T frames, and return the positions (T, S, 3)
    [m] of the curve.

    `other` (T, S) is None for a planar body, else the second component of curvature or the direction of bending, as the
    options say.
    """
    if other is None:
        return np.pad(planar_curve(kappa, arc), ((0, 0), (0, 0), (0, 1)))
    if options.components:
        return spatial_curve(np.stack([kappa, other * PER_METRE[options.curvature_unit]], axis=-1), arc)[0]
    angle = other * radian_per(options.direction_unit or "deg")
    return spatial_curve(kappa[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1), arc)[0]


def arcs_of(names: list[str], start: str, unit: str, file: str) -> dict[float, int]:
    """Return a dict from arc length [m] to column index, for the columns whose name is `start` followed by an arc
    length, such as ``k_10``.
    """
    arcs: dict[float, int] = {}
    for k, name in enumerate(names):
        if not name.startswith(start):
            continue
        match = ARC.fullmatch(name[len(start) :])
        if not match:
            continue
        arc = metre_per(match[2] or unit) * float(match[1])
        if not np.isfinite(arc) or arc in arcs:
            problem = "of another column, too" if arc in arcs else "that is not finite"
            raise InputError(f"{file} states in column {clipped(name)!r} an arc length {problem}: rename the column")
        arcs[arc] = k
    return arcs


def unit_in(names: Sequence[str], columns: Iterable[int], file: str) -> str:
    """Return the unit, deg or rad, that the names of columns of directions state in brackets; deg where none does."""
    stated = {unit for k in columns if (unit := bracketed_unit(names[k]))} & {"deg", "rad"}
    if len(stated) > 1:
        raise InputError(f"{file} states directions in deg and in rad: set direction_unit in its mapping")
    return next(iter(stated), "deg")


def time_of(table: Array, names: list[str], options: CurvatureMapping, file: str) -> tuple[Array, list[str]]:
    """Return the times (T,) [s] of the T rows of a curvature table, and lines for the history. The times are those of
    its time column or, if it has none, follow from the frame rate.
    """
    clocks = [k for k, name in enumerate(names) if is_time(name)]
    if not clocks and options.rate_hz:
        return np.arange(len(table)) / options.rate_hz, []
    if len(clocks) != 1:
        raise InputError(f"{file} has {len(clocks)} columns of time: it needs exactly one, or rate_hz in its mapping")
    named = parted(names[clocks[0]])[1]
    return unwrapped(table[:, clocks[0]], options.time_unit or (named if named in SECONDS else "s"), file)


def recognises(head: bytes) -> bool:
    """Return whether the first row of a file names a time and at least two curvatures as ``k_<arc length>``."""
    line = head.removeprefix(b"\xef\xbb\xbf").split(b"\n", 1)[0].decode("utf-8", "replace").strip()
    cells = split_cells(line, find_delimiter(line[:10_000], "the file"))
    return any(is_time(c) for c in cells) and sum(c.startswith("k_") for c in cells) >= 2


READER = Reader("curvature", ENDINGS["curvature"], read_curvature, recognises)
