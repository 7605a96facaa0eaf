"""Apply a scale and an offset to channels of a recording, such as raw counts or absolute pressures.

A mapping of any format may hold them, by variable (``pressure``, ``actuation``, ``angle``, ``position``, ``strain``) or
by the name of one chamber, input, station or core::

    [linear.pressure]
    scale = 0.0244      # value = scale * what the file holds + offset
    offset = -12.2
    unit = "kPa"        # of the offset
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from pydantic import Field

from pliant.errors import InputError
from pliant.recording.mapping import FileMapping
from pliant.units import input_per, metre_per, pascal_per, radian_per

if TYPE_CHECKING:
    import xarray as xr

CHANNELS: dict[str, tuple[str, Callable[[str], float] | None]] = {  # variable -> dimension of its channels, its units
    "pressure": ("chamber", pascal_per), "angle": ("station", radian_per), "position": ("station", metre_per),
    "strain": ("core", None), "actuation": ("input", input_per),
}  # fmt: skip
KEY = "linear"


class LinearScale(FileMapping):
    """Conversion of one recorded channel: value = scale * stored value + offset, with the offset in `unit`."""

    scale: float = Field(default=1.0, allow_inf_nan=False)
    offset: float = Field(default=0.0, allow_inf_nan=False)
    unit: str | None = None


def without_lines(mapping: Mapping[str, Any] | None) -> tuple[Mapping[str, Any] | None, Mapping[str, Any]]:
    """Split the options of a file into those of its reader and the table ``linear`` (scale and offset of channels), and
    return both.
    """
    if mapping is None or KEY not in mapping:
        return mapping, {}
    return {k: v for k, v in mapping.items() if k != KEY} or None, mapping[KEY]


def scaled(recording: xr.Dataset, lines: Mapping[str, Any], file: str) -> xr.Dataset:
    """Apply the scales and offsets in `lines`, a dict by channel name, to the channels of a recording. Return a new
    recording whose history lists them.

    Raises
    ------
    InputError
        When an entry names no channel of the recording, scales by 0, or has an offset without a unit.
    """
    if not hasattr(lines, "items"):
        raise InputError(f"the mapping for {file}: {KEY} must be a table by channel, such as [{KEY}.pressure]")
    for name, entry in lines.items():
        line = LinearScale.load(entry if hasattr(entry, "items") else {"scale": entry}, file)
        variable, where = channel(recording, str(name), file)
        added = line.offset * factor(variable, line, str(name), file)
        values = recording[variable].copy(deep=True)
        values[where] = line.scale * values[where] + added
        finding = f"{name} is {line.scale:g} times the stored value, plus {line.offset:g} {line.unit or ''}".rstrip()
        history = "\n".join(filter(None, [str(recording.attrs.get("history", "")), finding]))
        recording = recording.assign({variable: values}).assign_attrs(history=history)
    return recording


def channel(recording: xr.Dataset, name: str, file: str) -> tuple[str, dict[str, Any]]:
    """Find the variable of a recording that contains the channel `name`, and return the variable's name and the
    channel's index in it. The index is empty if `name` is the name of the variable itself.
    """
    if name in CHANNELS and name in recording:
        return name, {}
    for variable, (dimension, _) in CHANNELS.items():
        divided = variable in recording and dimension in recording[variable].dims
        names = [str(n) for n in recording[dimension].values] if divided else []
        if name in names:
            return variable, {dimension: names.index(name)}
    held = ", ".join(v for v in CHANNELS if v in recording)
    raise InputError(f"the mapping for {file}: {KEY} names {name!r}, but the recording has no such channel: correct "
                     f"the name; its variables are {held}")


def factor(variable: str, line: LinearScale, name: str, file: str) -> float:
    """Return the factor that converts a channel's offset from its stated unit to the SI unit, such as 1000 for kPa."""
    per = CHANNELS[variable][1]
    if line.scale == 0:
        raise InputError(f"the mapping for {file}: {KEY}.{name} has scale = 0, which would erase the channel: give "
                         "another scale")
    if per is None or (line.unit is None and line.offset == 0):
        return 1.0
    if line.unit is None:
        raise InputError(f"the mapping for {file}: {KEY}.{name} has an offset without a unit: add unit")
    return per(line.unit)
