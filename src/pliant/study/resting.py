"""Alignment of recordings of one body at rest: each is shifted to the rest position of the first one."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import xarray as xr

from pliant.errors import InputError
from pliant.preprocessing.align import alignment_of
from pliant.validation.outcome import Clocks

Array = np.ndarray


class Aligned(NamedTuple):
    """One recording in the base frame, with its pressure on the clock of its shape."""

    body: xr.Dataset
    findings: tuple[str, ...]  # sentences on reading and aligning the recording
    tip: str = ""  # how the tip of a fibre was found; empty for markers
    clocks: Clocks | None = None  # the comparison of the clocks, if one was made
    doubts: Mapping[str, str] = MappingProxyType({})  # warnings by the name of the check


def rest_place(name: str, recording: xr.Dataset) -> Array:
    """Return the mean position (S, 2) [m] of the stations in the rest window of the alignment."""
    if "alignment" not in recording.attrs:
        raise InputError(f"recording {name} was aligned before the study: common_rest needs the tracker's recording")
    start, stop = alignment_of(recording).rest_s
    window = (recording["time"].values >= start) & (recording["time"].values <= stop)
    return np.asarray(np.nanmean(recording["position"].values[window], axis=0))


def at_one_rest(recordings: Mapping[str, Aligned]) -> dict[str, Aligned]:
    """Return every recording shifted, station by station, to the rest position of the first one.

    Raises
    ------
    InputError
        When a recording was not aligned by the study, or has other stations than the first.
    """
    first, *_ = recordings
    stations = recordings[first].body.station.values.tolist()
    goal = rest_place(first, recordings[first].body)
    made = {}
    for name, one in recordings.items():
        if one.body.station.values.tolist() != stations:
            raise InputError(f"recording {name} has other stations than {first}: common_rest needs the same ones")
        move = goal - rest_place(name, one.body)
        far = 1e3 * float(np.linalg.norm(move, axis=1).max())
        moved = f"shifted by up to {far:.3g} mm, station by station, to the rest position of {first}"
        body = one.body.assign(position=one.body["position"] + move)
        made[name] = one._replace(body=body, findings=(*one.findings, moved)) if name != first else one
    return made
