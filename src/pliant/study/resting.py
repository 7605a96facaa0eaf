"""Recordings of one body that rest in different places: moved to one rest, so that what is compared is the motion."""

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
    """One recording in the base frame, its pressure on the clock of its shape."""

    body: xr.Dataset
    findings: tuple[str, ...]  # of reading and aligning it
    tip: str = ""  # how the tip of a fibre was found; empty where stations are markers
    clocks: Clocks | None = None  # how they were compared, where they were
    doubts: Mapping[str, str] = MappingProxyType({})  # what looks wrong in it, by the name of the check


def rest_place(name: str, recording: xr.Dataset) -> Array:
    """Mean place (S, 2) [m] of the stations in the window that the alignment took for rest."""
    if "alignment" not in recording.attrs:
        raise InputError(f"recording {name} is not aligned by the study: common_rest needs the rest that it finds")
    start, stop = alignment_of(recording).rest_s
    window = (recording["time"].values >= start) & (recording["time"].values <= stop)
    return np.asarray(np.nanmean(recording["position"].values[window], axis=0))


def at_one_rest(recordings: Mapping[str, Aligned]) -> dict[str, Aligned]:
    """Every recording moved, station by station, to rest where the first one does; its findings say how far.

    Raises
    ------
    InputError
        When a recording was not aligned here, or has other stations than the first.
    """
    first, *_ = recordings
    stations = recordings[first].body.station.values.tolist()
    goal = rest_place(first, recordings[first].body)
    made = {}
    for name, one in recordings.items():
        if one.body.station.values.tolist() != stations:
            raise InputError(f"recording {name} has other stations than {first}: common_rest compares them one by one")
        move = goal - rest_place(name, one.body)
        far = 1e3 * float(np.linalg.norm(move, axis=1).max())
        moved = f"moved by up to {far:.3g} mm, station by station, to rest where {first} does"
        body = one.body.assign(position=one.body["position"] + move)
        made[name] = one._replace(body=body, findings=(*one.findings, moved)) if name != first else one
    return made
