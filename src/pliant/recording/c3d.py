"""Reader of C3D motion-capture files: markers become stations, in metres; invalid points become NaN.

ezc3d reads the file in a separate process; `pliant.recording.c3d_facts` compares what the file states twice.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pliant.errors import InputError, inside
from pliant.recording.apart import read_apart
from pliant.recording.c3d_facts import (
    MOST_FRAMES,
    C3dHeader,
    compare_facts,
    frames_of,
    judge_layout,
    judge_residuals,
    read_header,
)
from pliant.recording.mapping import FileMapping, PressureChannels, shorten
from pliant.recording.registry import ENDINGS, Reader
from pliant.recording.schema import make_recording
from pliant.recording.stated import Reading, Stated
from pliant.units import metre_per, pascal_per

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray


class C3dContent(NamedTuple):
    """Content of a C3D file: coordinates (T, N, 3) of N points over T frames, values of C analog channels, rates [Hz]
    and parameters.

    `doubts` are sentences about contradictions, `remarks` about oddities that may be harmless.
    """

    parameters: dict[str, dict[str, list[Any]]]
    points: NDArray
    analog: NDArray
    rate: float
    analog_rate: float
    doubts: list[str]
    remarks: list[str]
    frames: int  # that the header states


class C3dMapping(FileMapping):
    """Options of the C3D reader: unit of length, whether to read a file that contradicts itself, and channels of
    pressure.

    Attributes
    ----------
    length_unit : str, optional
        Unit of the points; needed where the file does not state POINT:UNITS, and replaces it otherwise.
    trust_header : bool
        Whether to read a file that contradicts itself by its header; the contradictions are listed in the history.
        Default: such a file is refused.
    pressure : dict, optional
        Analog channels that hold gauge pressure: ``{channels = [...], unit = "kPa"}``.
    """

    length_unit: str | None = None
    trust_header: bool = False
    pressure: PressureChannels | None = None


def read_c3d(path: Path, mapping: Mapping[str, Any] | None = None) -> Reading:
    """Read the markers of a C3D file as stations, and pressure from its analog channels where the mapping names them;
    return a recording.
    """
    options = C3dMapping.load(mapping, path.name)
    content = _content(path)
    if content.doubts and not options.trust_header:
        raise InputError(f"{path.name} contradicts itself: {'; '.join(content.doubts)}. It is damaged or was written "
                         "incorrectly: export it again, or set trust_header = true in its mapping")  # fmt: skip
    position = content.points * _scale(content, options, path.name)
    lost = np.isnan(position).any(-1)
    position[lost] = np.nan
    history = [*content.doubts, *content.remarks]
    if lost.any():
        history.append(f"{int(lost.sum())} of {lost.size} points are marked invalid and became NaN")
    history += _unused(content, options)
    names, renamed = _names(content, position.shape[1])
    if renamed:
        history.append(f"{renamed} point(s) had no name or a repeated one and got a number")
    with inside(path.name):
        recording = make_recording(
            np.arange(len(position)) / content.rate, position, station=names, history=history,
            **_analog_pressure(content, options, path.name),
        )  # fmt: skip
    return Reading(recording, (Stated("frames", "its header", content.frames, len(position)),))


def _content(path: Path) -> C3dContent:
    """Return the content of a C3D file as ezc3d reads it, checked against its header and its length."""
    data = path.read_bytes()
    header = read_header(data, path.name)
    if header.last < MOST_FRAMES:
        _check_length(data, header, header.last - header.first + 1, path.name)
    arrays, facts = read_apart("c3d", path, "C3D")
    parameters, points, analog = facts["parameters"], arrays["points"], arrays["analog"]
    frames = frames_of(header, parameters)
    _check_length(data, header, frames, path.name)
    short = bool(header.analog) and len(analog) < frames * header.samples
    if points.shape[1] != header.points or short:
        raise InputError(f"{path.name} is damaged: it holds {len(points)} frames of {points.shape[1]} points, but its "
                         f"header states {frames} of {header.points}; export it again")  # fmt: skip
    doubts, remarks = judge_layout(data, header, frames)
    doubts = [*compare_facts(header, frames, parameters), *doubts, *judge_residuals(data, header, frames)]
    return C3dContent(parameters, points[:frames], analog[: frames * header.samples], header.rate,
                      header.rate * header.samples, doubts, remarks, frames)  # fmt: skip


def _check_length(data: bytes, header: C3dHeader, frames: int, name: str) -> None:
    if frames < 1:
        raise InputError(f"{name} holds {header.points} points in {max(frames, 0)} frames: export it again with frames")
    needed = header.end(frames)
    if needed > len(data):
        raise InputError(f"{name} is truncated: its header states {frames} frames of {header.points} points, {needed} "
                         f"bytes in all, but the file has {len(data)}; copy it again")  # fmt: skip


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
        raise InputError(f"{name} does not state the unit of its points (POINT:UNITS): set length_unit in its mapping")
    return metre_per(unit)


def _labels(content: C3dContent, group: str) -> list[str]:
    """Return the names in LABELS, LABELS2, ... of a group; each parameter holds at most 255 names."""
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
        raise InputError(f"{name} has no analog channel {', '.join(unknown)}: correct pressure.channels in its "
                         f"mapping; available: {available}")
    channels = [labels.index(c) for c in options.pressure.channels]
    values = content.analog[:, channels] * pascal_per(options.pressure.unit)
    clock = np.arange(len(values)) / content.analog_rate
    chamber = options.pressure.chamber or options.pressure.channels
    return {"pressure": values, "pressure_time": clock, "chamber": chamber if len(channels) > 1 else None}


READER = Reader("c3d", ENDINGS["c3d"], read_c3d)
