"""Alignment of a study's recordings on one clock and in one rest position, with sentences on each recording for the
report.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pliant.errors import InputError, inside
from pliant.preprocessing.align import alignment_of
from pliant.preprocessing.side import x_sign
from pliant.preprocessing.sync import shift_pressure, sync
from pliant.recording import append_history, read
from pliant.recording.inputs import inputs_on_one_clock
from pliant.recording.rules import shape_values, shape_variable
from pliant.recording.typed_steps import prolonged
from pliant.simulation.forces import PointForce
from pliant.study.body import in_base_frame
from pliant.study.schema import Recording
from pliant.units import input_words
from pliant.validation.outcome import Clocks

Array = np.ndarray
LAST, BACK = 5, 0.1  # frames at the end; of the largest motion: a body that is less far from its begin is back there


class Aligned(NamedTuple):
    """One recording in the base frame, with its pressure on the clock of its shape."""

    body: xr.Dataset
    findings: tuple[str, ...]  # sentences on reading and aligning the recording
    tip: str = ""  # how the tip of a fibre was found; empty for markers
    clocks: Clocks | None = None  # the comparison of the clocks, if one was made
    doubts: Mapping[str, str] = MappingProxyType({})  # warnings by the name of the check


def rest_place(name: str, recording: xr.Dataset) -> Array:
    """Return the mean position (S, 2) [m] of the S stations of a recording during the time at rest that its alignment
    used.
    """
    if "alignment" not in recording.attrs:
        raise InputError(f"recording {name} was aligned before the study, but common_rest needs positions in the "
                         "tracker's frame: use the recording before its alignment, or remove common_rest")
    start, stop = alignment_of(recording).rest_s
    window = (recording["time"].values >= start) & (recording["time"].values <= stop)
    return np.asarray(np.nanmean(recording["position"].values[window], axis=0))


def at_common_rest(recordings: Mapping[str, Aligned]) -> dict[str, Aligned]:
    """Return every recording shifted, station by station, to the rest position of the first one.

    Raises
    ------
    InputError
        When a recording was not aligned by the study, or has other stations than the first.
    """
    first, *_ = recordings
    stations = recordings[first].body.station.values.tolist()
    goal = rest_place(first, recordings[first].body)
    shifted = {}
    for name, aligned in recordings.items():
        if aligned.body.station.values.tolist() != stations:
            raise InputError(f"recording {name} has other stations than {first}, but common_rest needs the same ones: "
                             "remove common_rest, or state the same stations in [alignment]")
        move = goal - rest_place(name, aligned.body)
        far = 1e3 * float(np.linalg.norm(move, axis=1).max())
        moved = f"shifted by up to {far:.3g} mm, station by station, to the rest position of {first}"
        body = aligned.body.assign(position=aligned.body["position"] + move)
        shifted[name] = aligned._replace(body=body, findings=(*aligned.findings, moved)) if name != first else aligned
    return shifted


def with_pressure(recording: xr.Dataset, log: xr.Dataset, name: str, file: str) -> xr.Dataset:
    """Return the recording with the pressure, and other inputs, added from a separate log file. They stay on the log's
    own clock.
    """
    if ends_at_zero(log) or not returns(recording):
        log = prolonged(log, float(np.ptp(recording["time"].values)))
    inputs = {variable: log[variable] for variable in ("pressure", "actuation") if variable in log}
    if not inputs:
        raise InputError(f"recording {name}: {file} holds no pressure or other input: state its columns in "
                         "pressure_mapping")  # fmt: skip
    if already := [variable for variable in ("pressure", "actuation") if variable in recording]:
        raise InputError(f"recording {name} holds inputs already ({already[0]}): remove pressure_file, or the inputs "
                         "in its mapping")  # fmt: skip
    joined = recording.assign(inputs)
    digest = log.attrs.get("source_sha256", "")
    lines = str(log.attrs.get("history", "")).splitlines()
    added = f"{' and '.join(inputs)} from {file} sha256 {digest}"
    return append_history(joined, *(f"{file}: {line}" for line in lines), added)


def ends_at_zero(log: xr.Dataset) -> bool:
    """Return whether the inputs of a log begin and end at 0, so that its last row lets them off."""
    return not any(log[v].values[[0, -1]].any() for v in ("pressure", "actuation") if v in log)


def returns(recording: xr.Dataset) -> bool:
    """Return whether the shape is at the end where it was at first, as when a last level was let off that no table of
    steps holds.
    """
    if not shape_variable(recording):
        return True
    rows = shape_values(recording).reshape(recording.sizes["time"], -1)
    away = rows[np.isfinite(rows).all(axis=1)]
    away = away - away[:1]
    most = np.linalg.norm(away, axis=1).max(initial=0.0)
    return not most or bool(np.linalg.norm(np.median(away[-LAST:], axis=0)) <= BACK * most)


def with_log(
    recording: xr.Dataset, log: Path, name: str, mapping: Mapping[str, Any] | None = None
) -> tuple[xr.Dataset, str]:
    """Return the recording with the pressures of a separate log on the clock of the shape, and "". If the offset
    between the two clocks cannot be estimated, return the pressures on the log's own clock, and the reason.
    """
    joined = with_pressure(recording, read(log, mapping=mapping), name, log.name)
    try:
        offset = sync(joined, drift=True)
    except InputError as error:
        return joined, f"the clock of {log.name} cannot be moved to that of the shape: {error}"
    return shift_pressure(joined, offset.delay_s, offset.drift), ""


def on_one_clock(
    recording: xr.Dataset, entry: Recording, name: str
) -> tuple[xr.Dataset, Clocks | None, tuple[str, ...]]:
    """Return the recording with its inputs moved to the shape's clock, the estimated offset between the two clocks,
    and sentences on this offset for the report.

    The offset is None if nothing was estimated, since the clocks are stated to be equal or the offset is stated.
    """
    wanted = entry.clock if entry.clock is not None else "align" if entry.pressure_file else "same"
    if wanted == "same":
        return recording, None, ()
    if not (inputs := inputs_on_one_clock(recording)):
        raise InputError(f"recording {name}: clock is stated, but there is no measured pressure or other input: remove "
                         "clock")  # fmt: skip
    if not isinstance(wanted, str):
        word = input_words([signal.unit for signal in inputs])[0]
        finding = f"the {word}'s clock is moved by {1e3 * wanted:+.6g} ms, as stated"
        return shift_pressure(recording, wanted), None, (finding,)
    with inside(f"recording {name}"):
        offset = sync(recording, drift=True)
    moved = shift_pressure(recording, offset.delay_s, offset.drift)
    return moved, Clocks.of(recording, offset), (offset.summary(),)


def known_values(entry: Recording, recording: xr.Dataset) -> dict[str, float]:
    """Return the parameters of a recording that are known: the stated ones, and its own gravity in its base frame."""
    if entry.gravity is None:
        return entry.known
    rotation = np.array(alignment_of(recording).rotation) if "alignment" in recording.attrs else None
    size = 3 if recording.attrs["frame"] == "spatial" else 2
    gravity = in_base_frame(np.array(entry.gravity, dtype=float), rotation, x_sign(recording), size)
    return {**entry.known, **{f"gravity_{axis}": float(g) for axis, g in zip("xyz", gravity, strict=False)}}


def known_forces(entry: Recording, recording: xr.Dataset) -> list[PointForce]:
    """Return the known forces of a recording in its base frame."""
    rotation = np.array(alignment_of(recording).rotation) if "alignment" in recording.attrs else None
    return [f.in_base_frame(x_sign(recording), rotation) for f in entry.forces]
