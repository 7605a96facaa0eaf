"""Search for a rest in recordings that show none at once: a station appears late, or the body never comes to rest."""

from __future__ import annotations

import numpy as np
import xarray as xr

from pliant.errors import InputError
from pliant.preprocessing.cut import cut_time
from pliant.preprocessing.rest import rest_window

END, CALM = 0.1, 0.5  # last part of a recording, in which a body has nearly come to rest if it moves half as far
FIRST_FRAMES = 5  # in which a body that is moved at once is still at rest
NEAR = 0.2  # of the range of the last station's motion: it rests where it rested first
TRIES = 10


def later_rest(recording: xr.Dataset) -> list[float] | None:
    """Return the first rest [start, end] [s] at which all stations are labelled and the last one is where it began.

    None if all stations are labelled from the first frame on, or there is no such rest.
    """
    time, position = recording["time"].values, recording["position"].values
    complete = np.isfinite(position).all(axis=2)
    start = int(np.argmax(complete.all(axis=1)))
    tip = position[complete[:, -1], -1]
    if not start or not complete.all(axis=1).any() or len(tip) < 10:
        return None
    widest = float(np.linalg.norm(np.ptp(tip, axis=0)))
    shape = recording.drop_vars([name for name in ("pressure", "actuation") if name in recording])
    for _ in range(TRIES):
        try:
            begin, end = rest_window(cut_time(shape, float(time[start]), float(time[-1])))
        except InputError:
            return None
        still = position[(time >= begin) & (time <= end), -1]
        away = np.linalg.norm(np.nanmedian(still, axis=0) - np.median(tip[:10], axis=0))
        if away < NEAR * widest:
            return [round(begin, 3), round(end, 3)]
        start = int(np.searchsorted(time, end, side="right")) + 1
        if start >= len(time) - 10:
            return None
    return None


def nearest_rest(recording: xr.Dataset) -> list[float] | None:
    """Return the times [start, end] [s] at which a body that is never at rest is nearest to it: the end of a decay,
    else the first frames. None if the body is at rest at some time.
    """
    try:
        rest_window(recording)
    except InputError:
        time, tip = recording["time"].values, recording["position"].values[:, -1]
        last = time > time[-1] - END * (time[-1] - time[0])
        spread = [float(np.linalg.norm(np.nanstd(part, axis=0))) for part in (tip[last], tip)]
        calm = time[last] if spread[0] < CALM * spread[1] else time[:FIRST_FRAMES]
        return [round(float(calm[0]), 3), round(float(calm[-1]), 3)]
    return None
