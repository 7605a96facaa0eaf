"""Reader of Luna ODiSI 6xxx strain tables (.tsv): header lines ``Key:<TAB>value``, one row per time stamp.

The header ends with a line of dashes. Then come an optional row of gauge names, an optional ``Tare`` row, an ``x-axis``
row (metres) and the rows of measurements, whose first cell is a time stamp. Strain is in microstrain relative to the
tare. One file is one core. The layout is that of other readers of this format.
"""

from __future__ import annotations

import re
from datetime import datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError, clipped, inside
from pliant.recording.inputs import input_arguments
from pliant.recording.mapping import FileMapping
from pliant.recording.registry import ENDINGS, Reader
from pliant.recording.schema import append_history, make_recording
from pliant.recording.stated import Reading, Stated, stated_rate
from pliant.recording.tables import judge_end, parse_numbers, read_text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import xarray as xr

PITCH_TOLERANCE = 0.02  # of the pitch: the x-axis is rounded
LABEL_CELLS = 3  # time stamp, kind of row, quantity
AXIS_UNITS = ("", "m", "meters", "metres")
STRAIN_UNITS = {"microstrain": 1e-6, "ustrain": 1e-6, "με": 1e-6, "µε": 1e-6, "ue": 1e-6, "strain": 1.0}


class LunaMapping(FileMapping):
    """Option of the Luna reader: the name of the fibre core whose strain the file holds."""

    core: str = "core000"


def read_luna(path: Path, mapping: Mapping[str, Any] | None = None) -> Reading:
    """Read the strain of one fibre core from a Luna ODiSI table and return it as a recording; missing values become
    NaN.
    """
    options = LunaMapping.load(mapping, path.name)
    lines = read_text(path).split("\n")
    header, header_end = _header(lines, path.name)
    scale = _strain_scale(header, path.name)
    if (unit := header.get("x-axis units", "m").lower()) not in AXIS_UNITS:
        raise InputError(f"{path.name} states the x-axis in {clipped(unit, 20)!r}, not in metres: export it again with "
                         "the x-axis in m")
    gauges, first = _gauges(lines, header_end, path.name)
    body, findings = judge_end(lines[first:], "\t", path.name)
    rows = [(i, line.split("\t", LABEL_CELLS)) for i, line in enumerate(body, first) if line.strip()]
    if not rows:
        raise InputError(f"{path.name} holds no measurement after its x-axis row: export it again")
    if short := [number for number, cells in rows if len(cells) <= LABEL_CELLS]:
        raise InputError(f"line {short[0] + 1} of {path.name} holds no values: the file may be truncated, so copy or "
                         "export it again")
    strain_rows = [(number, cells) for number, cells in rows if cells[2].strip().lower() in ("strain", "")]
    if not strain_rows:
        raise InputError(f"none of the {len(rows)} rows of {path.name} holds strain: export strain from the Luna "
                         "software")
    stamps = [_time_stamp(cells[0], number, path.name) for number, cells in strain_rows]
    values = [cells[LABEL_CELLS] for _, cells in strain_rows]
    findings += _pitch(header, gauges)
    strain = _values(values, len(gauges), strain_rows[0][0] + 1, path.name) * scale
    if len(strain_rows) < len(rows):
        findings.append(f"{len(rows) - len(strain_rows)} row(s) hold another quantity than strain and were left out")
    time = np.array([(stamp - stamps[0]).total_seconds() for stamp in stamps])
    with inside(path.name):
        recording = make_recording(
            time, strain=strain[:, None, :], gauge_position=gauges, core=[options.core], history=findings,
            attrs={"start_time": stamps[0].isoformat(), "test_name": header.get("test name", "")},
        )  # fmt: skip
    return Reading(recording, tuple(_stated(header, time)))


def _stated(header: Mapping[str, str], time: np.ndarray) -> list[Stated]:
    """Return the rate that the header states, beside that of the rows."""
    rate = re.match(r"[0-9]+\.?[0-9]*", header.get("measurement rate per channel", ""))
    return stated_rate("rows", "Measurement Rate per Channel", float(rate[0]) if rate else np.nan, time)


def combine_cores(recordings: Sequence[xr.Dataset]) -> xr.Dataset:
    """Join recordings that hold the strain of one fibre core each, at equal times and gauge positions, into one
    recording of all cores. The actuation inputs are taken from the first recording.

    Raises
    ------
    InputError
        When times or gauge positions differ, or a core's name repeats.
    """
    if not recordings or any("strain" not in recording for recording in recordings):
        raise InputError("combine_cores needs one or more recordings, each with strain")
    first = recordings[0]
    for recording in recordings[1:]:
        for name in ("time", "gauge_position"):
            same = recording[name].shape == first[name].shape and np.allclose(
                recording[name], first[name], rtol=0, atol=1e-6
            )
            if not same:
                raise InputError(f"the recordings of the cores differ in {name}: resample them to the same {name} "
                                 "first")
    names = [str(c) for recording in recordings for c in recording["core"].values]
    if len(set(names)) != len(names):
        raise InputError(f"the core names must differ, but they are {', '.join(names)}: set core in the mapping of "
                         "each file")
    joined = make_recording(
        first["time"].values, strain=np.concatenate([recording["strain"].values for recording in recordings], 1),
        gauge_position=first["gauge_position"].values, core=names, attrs=dict(first.attrs),
        **input_arguments(first),
    )  # fmt: skip
    return append_history(joined, f"joined {len(names)} cores: {', '.join(names)}")


def _header(lines: list[str], name: str) -> tuple[dict[str, str], int]:
    header: dict[str, str] = {}
    for i, line in enumerate(lines[:500]):
        if line.strip() and not line.strip().strip("-"):
            return header, i + 1
        key, colon, value = line.partition(":")
        if colon:
            header[key.strip().lower()] = value.strip()
    raise InputError(f"{name} is not a Luna table: its header does not end with a line of dashes; export it again "
                     "from the Luna software")


def _strain_scale(header: Mapping[str, str], name: str) -> float:
    unit = header.get("units", "").lower()
    if unit not in STRAIN_UNITS:
        raise InputError(f"{name} must hold strain in microstrain, but its header line Units is "
                         f"{unit or 'not stated'!r}: export strain from the Luna software")
    return STRAIN_UNITS[unit]


def _gauges(lines: list[str], at: int, name: str) -> tuple[np.ndarray, int]:
    for i in range(at, min(at + 20, len(lines))):
        if lines[i].partition("\t")[0].strip().lower() == "x-axis":
            text = lines[i].rstrip().split("\t")[LABEL_CELLS:]
            if not text:
                break
            gauges = parse_numbers(["\t".join(text)], name=name, first_line=i + 1, delimiter="\t",
                                   columns=len(text))[0]  # fmt: skip
            if not np.isfinite(gauges).all() or (np.diff(gauges) <= 0).any():
                raise InputError(f"the x-axis of {name} must increase from gauge to gauge: export the file again")
            return gauges, i + 1
    raise InputError(f"{name} has no x-axis row with the positions of its gauges: export it again")


def _pitch(header: Mapping[str, str], gauges: np.ndarray) -> list[str]:
    """Return a sentence where the gauge spacing stated in the header differs from that of the x-axis."""
    try:
        stated = 1e-3 * float(header.get("gage pitch (mm)", "nan"))
    except ValueError:
        return []
    measured = float(np.median(np.diff(gauges))) if gauges.size > 1 else float("nan")
    if not abs(measured - stated) > PITCH_TOLERANCE * stated:
        return []
    return [f"the header states gauges {stated:g} m apart, but the x-axis has {measured:g} m; the x-axis was used"]


def _time_stamp(text: str, number: int, name: str) -> datetime:
    try:
        return datetime.fromisoformat(text.strip())
    except ValueError:
        raise InputError(f"line {number + 1} of {name} does not begin with a time stamp: {text[:40]!r}; export the "
                         "file again") from None


def _values(rows: list[str], gauges: int, first: int, name: str) -> np.ndarray:
    """Return the values (rows, gauges); empty cells at the end of a row become NaN."""
    for i, row in enumerate(rows):
        if row.count("\t") + 1 > gauges and row.rstrip("\t\n ").count("\t") + 1 <= gauges:
            rows[i] = "\t".join(row.split("\t")[:gauges])
        if not row.strip():
            rows[i] = "\t".join(["nan"] * gauges)
    return parse_numbers(rows, name=name, first_line=first, delimiter="\t", columns=gauges)


def _recognises(head: bytes) -> bool:
    start = head[:4000].lower()
    return start.startswith((b"test name:", b"\xef\xbb\xbftest name:")) or b"odisi" in start


READER = Reader("luna", ENDINGS["luna"], read_luna, _recognises)
