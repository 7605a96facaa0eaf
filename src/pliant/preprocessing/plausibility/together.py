"""Checks of several recordings of one body: copies of a recording, and exchanged pressure logs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np
import xarray as xr

from pliant.numerics.ringdown import peak
from pliant.preprocessing import detectors
from pliant.recording.rules import shape_values

COPIED, FEWEST = 0.5, 10  # of the frames of the shorter one, and at least this many: frames at rest may repeat
PLATEAU, LEAST_S = 0.9, 0.15  # of the highest pressure; s that it must last for the body to follow
MORE, LESS = 1.15, 0.85  # ratio of pressures above the first, yet ratio of displacements below the second


def beside(recordings: Mapping[str, xr.Dataset]) -> list[str]:
    """Return one sentence for each pair of recordings of one body that contradict each other: equal numbers, or
    exchanged pressure logs.

    Parameters
    ----------
    recordings : mapping of str to xarray.Dataset
        Recordings of one body in one frame and experimental set-up, by name.
    """
    return [*copies(recordings), *exchanged(recordings)]


def copies(recordings: Mapping[str, xr.Dataset]) -> Iterator[str]:
    """Yield a sentence for each pair of recordings that contain the same numbers, so that one seems to be a copy.

    A held-out copy of a training recording validates nothing.
    """
    for *pair, shared in alike(recordings):
        first, other = sorted(pair, key=[*recordings].index)
        yield (f"{first} and {other} hold the same numbers in {shared} frames: is one a copy of the other? Leave the "
               "copy out: a recording cannot validate a model that was fitted to it")  # fmt: skip


def alike(recordings: Mapping[str, xr.Dataset]) -> Iterator[tuple[str, str, int]]:
    """Yield the names of each pair of recordings that share most frames of the shorter one, and how many they share.
    The shorter one, or the later of two equal ones, is named first.
    """
    shapes = {n: shape_values(r) for n, r in recordings.items()}
    rows = {n: {row.tobytes() for row in s.reshape(len(s), -1) if np.isfinite(row).any()} for n, s in shapes.items()}
    for first, second in combinations(recordings, 2):
        smaller, other = (first, second) if len(rows[first]) < len(rows[second]) else (second, first)
        shared = len(rows[smaller] & rows[other])
        if shared >= max(FEWEST, COPIED * len(rows[smaller])):
            yield smaller, other, shared


def exchanged(recordings: Mapping[str, xr.Dataset]) -> Iterator[str]:
    """Yield a sentence for each pair of recordings in which the one with the higher pressure has the smaller
    displacement.

    Their pressure logs may be exchanged.
    """
    plateaus = {n: level for n, r in recordings.items() if (level := plateau(r)) is not None}
    for first, other in combinations(plateaus, 2):
        low, high = sorted((first, other), key=lambda n: abs(plateaus[n][0]))
        (p, u), (higher, less) = plateaus[low], plateaus[high]
        if p * higher > 0 and abs(higher) > MORE * abs(p) and less < LESS * u:
            yield (f"{high} moves by {1e3 * less:.3g} mm under {higher / 1e3:.3g} kPa, but {low} by {1e3 * u:.3g} mm "
                   f"under only {p / 1e3:.3g} kPa: are their pressure logs exchanged, or was the body in {high} "
                   "loaded or touched?")  # fmt: skip


def plateau(recording: xr.Dataset) -> tuple[float, float] | None:
    """Return the highest pressure [Pa] of a recording, and the distance [m] of the last station from its initial
    position when that pressure ends. Return None where the pressure is held too briefly.
    """
    if "position" not in recording or "pressure" not in recording or recording["pressure"].ndim != 1:
        return None
    clock, measured = recording["pressure_time"].values, recording["pressure"].values
    time, tip = recording["time"].values, detectors.without_spikes(recording["position"].values[:, -1:])[:, 0]
    known, complete = np.isfinite(measured), np.isfinite(tip).all(axis=1)
    if known.sum() < 2 or complete.sum() < 2:
        return None
    pressure = np.interp(time, clock[known], measured[known])
    level = peak(pressure)
    on = np.flatnonzero((pressure / level > PLATEAU) & complete) if level else np.empty(0, dtype=int)
    if not on.size or time[on[-1]] - time[on[0]] < LEAST_S:
        return None
    rest, end = np.median(tip[complete][:5], axis=0), np.median(tip[on[-max(3, on.size // 3):]], axis=0)
    return level, float(np.linalg.norm(end - rest))
