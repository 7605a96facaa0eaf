"""C3D: markers of a motion-capture system become stations, in metres; invalid points become NaN."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.recording.c3d_sections import decode_c3d
from pliant.recording.mapping import FileMapping, PressureChannels, shorten
from pliant.recording.registry import ENDINGS, Reader
from pliant.recording.schema import make_recording
from pliant.units import metre_per, pascal_per

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import xarray as xr

    from pliant.recording.c3d_sections import C3dContent


class C3dMapping(FileMapping):
    """Options of the C3D reader.

    Attributes
    ----------
    length_unit : str, optional
        Unit of the points; needed where the file does not state POINT:UNITS, and otherwise goes before it.
    trust_header : bool
        Read a file whose facts contradict each other by its header, and tell the contradictions. Default: refuse it.
    pressure : dict, optional
        Analog channels that hold gauge pressure: ``{channels = [...], unit = "kPa"}``.
    """

    length_unit: str | None = None
    trust_header: bool = False
    pressure: PressureChannels | None = None


def read_c3d(path: Path, mapping: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Read markers (and, by mapping, analog pressure) of a C3D file; options are those of `C3dMapping`."""
    options = C3dMapping.load(mapping, path.name)
    with np.errstate(all="ignore"):  # damaged floats; what they lead to is refused below
        content = decode_c3d(path.read_bytes(), path.name)
    if not 0 < content.rate < np.inf:
        raise InputError(f"{path.name} states a frame rate of {content.rate:g} Hz: the file is damaged")
    if content.doubts and not options.trust_header:
        raise InputError(f"{path.name} contradicts itself: {'; '.join(content.doubts)}. It is damaged, or was written "
                         "wrongly: export it again, or give trust_header = true in a mapping")  # fmt: skip
    position = content.points * _scale(content, options, path.name)
    lost = ~content.valid | np.isnan(position).any(-1)
    position[lost] = np.nan
    history = list(content.doubts)
    if lost.any():
        history.append(f"{int(lost.sum())} of {lost.size} points are marked invalid and became NaN")
    history += _unused(content, options)
    names, renamed = _names(content, position.shape[1])
    if renamed:
        history.append(f"{renamed} point(s) had no name or a repeated one and got a number")
    try:
        return make_recording(
            np.arange(len(position)) / content.rate, position, station=names, history=history,
            **_analog_pressure(content, options, path.name),
        )  # fmt: skip
    except InputError as error:
        raise InputError(f"{path.name}: {error}") from None


def _unused(content: C3dContent, options: C3dMapping) -> list[str]:
    used = options.pressure.channels if options.pressure else []
    labels = _labels(content, "ANALOG")[: content.analog.shape[1]]
    labels += [f"channel {i + 1}" for i in range(len(labels), content.analog.shape[1])]
    left = [label for label in labels if label not in used]
    return [f"{len(left)} analog channel(s) were not used: {shorten(left)}"] if left else []


def _scale(content: C3dContent, options: C3dMapping, name: str) -> float:
    stated = next((str(unit) for unit in content.parameters.get("POINT", {}).get("UNITS", []) if unit), None)
    unit = options.length_unit or stated
    if unit is None:
        raise InputError(f"{name} does not state the unit of its points (POINT:UNITS): give length_unit")
    return metre_per(unit)


def _labels(content: C3dContent, group: str) -> list[str]:
    """LABELS, LABELS2, ...: one parameter holds at most 255 names."""
    values = content.parameters.get(group, {})
    labels = [str(label) for label in values.get("LABELS", [])]
    for part in range(2, 258):
        labels += [str(label) for label in values.get(f"LABELS{part}", [])]
    return labels


def _names(content: C3dContent, count: int) -> tuple[list[str], int]:
    labels = _labels(content, "POINT")[:count]
    labels += [""] * (count - len(labels))
    names: list[str] = []
    renamed = 0
    for i, label in enumerate(labels):
        name = label or f"point {i + 1}"
        if not label or name in names:
            renamed += 1
        while name in names:
            name += f" #{i + 1}"
        names.append(name)
    return names, renamed


def _analog_pressure(content: C3dContent, options: C3dMapping, name: str) -> dict[str, Any]:
    if options.pressure is None:
        return {}
    labels = _labels(content, "ANALOG")[: content.analog.shape[1]]
    unknown = [c for c in options.pressure.channels if c not in labels]
    if unknown:
        available = ", ".join(labels) or "none"
        raise InputError(f"{name} has no analog channel {', '.join(unknown)}; available: {available}")
    channels = [labels.index(c) for c in options.pressure.channels]
    values = content.analog[:, channels] * pascal_per(options.pressure.unit)
    clock = np.arange(len(values)) / content.analog_rate
    if len(channels) == 1:
        return {"pressure": values[:, 0], "pressure_time": clock}
    chamber = options.pressure.chamber or options.pressure.channels
    return {"pressure": values, "pressure_time": clock, "chamber": chamber}


READER = Reader("c3d", ENDINGS["c3d"], read_c3d)
