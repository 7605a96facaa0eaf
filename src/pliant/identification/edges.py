"""When something happened, from the motion alone: the edges of a pulse or a step, a release."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError
from pliant.preprocessing.detectors import without_spikes

if TYPE_CHECKING:
    from pliant.identification.experiment import Experiment

Array = np.ndarray
HELD_S = 0.05  # s before a release, over which the held pose is a median


def displacement(exp: Experiment) -> Array:
    """Distance (T,) of the last station from where it is seen first, m (rad of angles); gaps and spikes bridged."""
    p = steady(exp)
    seen = np.isfinite(p).all(axis=1)
    u = np.linalg.norm(p[seen] - np.median(p[seen][:5], axis=0), axis=1)
    return np.interp(exp.time, exp.time[seen], u)


def steady(exp: Experiment) -> Array:
    """What was observed of the last station (T, 2), m, or (T, 1), rad, with spikes of single frames made NaN."""
    return without_spikes(exp.last_station[:, None])[:, 0]


def edges(exp: Experiment) -> dict[str, float]:
    """Start and stop of a pulse, start of a step, or the release, found from the motion of the last station, s.

    The start is the last moment at which the point was within 3 % of its travel before it first passed 20 %; the stop
    likewise, seen from the end of the plateau.
    """
    u = displacement(exp)
    t = exp.time
    if exp.excitation == "trace":
        return {}
    first = int(np.argmax(u > 0.2 * exp.travel))
    still = np.flatnonzero(u[:first] < 0.03 * exp.travel)
    onset = float(t[still[-1]] if still.size else t[0])
    if exp.excitation in ("step", "release"):
        return {"start" if exp.excitation == "step" else "release": onset}
    last = int(u.size - 1 - np.argmax(u[::-1] > 0.5 * exp.travel))
    before = np.flatnonzero(u[:last] > u[last - max(3, u.size // 100) : last].max() * 0.97)
    plateau = float(t[before[-1]]) if before.size else float(t[last])
    return {"start": onset, "stop": max(plateau, onset + 1e-3)}


def held_pose(exp: Experiment) -> Array:
    """Places (S, 2) of the stations in the last moments before the body is let go, m."""
    if exp.excitation != "release" or exp.placeless:
        raise InputError(f"experiment {exp.name}: a pose was held before a release, and places show it, but this is a "
                         f"{exp.excitation}{' seen by angles alone' if exp.placeless else ''}")  # fmt: skip
    onset = edges(exp)["release"]
    held = exp.position[(exp.time <= onset) & (exp.time > onset - HELD_S)]
    if np.isnan(held).all(axis=0).any():  # always one frame: the onset is one
        raise InputError(f"experiment {exp.name}: not every station is seen in the {HELD_S} s before the release")
    return np.asarray(np.nanmedian(held, axis=0))
