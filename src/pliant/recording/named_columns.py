"""Complete the mapping of a table by the names of its columns: times, stations and pressures that have standard names
need no entry.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pliant.recording.column_names import parted_clock, standard_names
from pliant.recording.tables import holds_number

if TYPE_CHECKING:
    from collections.abc import Sequence

CLOCKS = {"t": "s", "t_s": "s", "t_ms": "ms", "t_us": "us", "t_ns": "ns"}
SHAPES = ("stations", "points", "angles")


def completed(mapping: Mapping[str, Any], cells: Sequence[str], file: str) -> tuple[dict[str, Any], list[str]]:
    """Return the options of a table with the columns of its time and stations, where the mapping names none and the
    cells of its first row do, and sentences for the history.

    Stations are added if the mapping describes neither a shape nor a log, which has a time of its own.
    """
    options = dict(mapping)
    camera = options.get("camera")
    untimed = not {"time", "rate_hz"} & set(options) and not (isinstance(camera, Mapping) and "rate_hz" in camera)
    shapeless = not any(options.get(name) for name in SHAPES)
    alone = not untimed and (options.get("pressure") is not None or bool(options.get("inputs")))
    if any(map(holds_number, filter(None, cells))) or options.get("header") is False or not (untimed or shapeless):
        return options, []
    renamed = standard_names(list(cells), file)
    history = []
    if untimed:
        options |= clock_of(renamed.names, cells)
    if shapeless and not alone and (stations := stations_of(renamed.names, cells)):
        options["stations"] = stations
        if camera is None:
            options.setdefault("length_unit", renamed.length_unit or "m")
        history.append(f"stations of {file} by the names of its columns: {', '.join(stations)}")
    return options, history


def clock_of(names: Sequence[str], cells: Sequence[str]) -> dict[str, Any]:
    """Return the entries `time` and `time_unit` of a mapping for the column that the names say is the time; empty if
    there is none.
    """
    clock = next((k for k, name in enumerate(names) if name in CLOCKS), None)
    if clock is not None:
        return {"time": cells[clock], "time_unit": CLOCKS[names[clock]]}
    if parts := parted_clock(names):
        return {"time": (cells[parts.seconds], cells[parts.fraction]), "time_unit": parts.unit}
    return {}


def stations_of(names: Sequence[str], cells: Sequence[str]) -> dict[str, Any]:
    """Return the entry `stations` of a mapping for the columns whose standard names are coordinates of a station."""
    columns = dict(zip(names, cells, strict=True))
    stations: dict[str, Any] = {}
    for name in names:
        axis, _, station = name.partition("_")
        if axis != "x" or f"y_{station}" not in columns:
            continue
        label = f"s{station}" if station[0].isdigit() else station
        stations[label] = {"position": [columns[f"{a}_{station}"] for a in "xyz" if f"{a}_{station}" in columns]}
        turn = [columns[f"q{a}_{station}"] for a in "xyzw" if f"q{a}_{station}" in columns]
        stations[label] |= {"quaternion": turn} if len(turn) == 4 else {}
    return stations
