"""Times of events from the motion alone: the edges of a pulse or a step, a release."""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError
from pliant.identification.experiment import Experiment

Array = np.ndarray
HELD_S = 0.05  # s before a release, over which the held pose is a median
STILL = 0.03  # of the travel: what counts as not yet moved
SURE = 4.0  # standard deviations of the noise that must lie within STILL for a threshold to see the start
FIRST = 5  # frames that show where a body is at first


def displacement(exp: Experiment) -> Array:
    """Distance (T,) of the last station from where it is seen first, m (rad of angles); gaps and spikes bridged."""
    p = exp.steady
    seen = np.isfinite(p).all(axis=1)
    u = np.linalg.norm(p[seen] - np.median(p[seen][:FIRST], axis=0), axis=1)
    return np.interp(exp.time, exp.time[seen], u)


def edges(exp: Experiment) -> dict[str, float]:
    """Start and stop of a pulse, start of a step, or the release, found from the motion of the last station, s.

    The start is the last moment at which the point was within 3 % of its travel before it first passed 20 %; the stop
    likewise, seen from the end of the plateau. Where noise alone exceeds the 3 %, the start is that of a parabola that
    fits the rise best (`onset_in_noise`), and a plateau ends where the noise no longer explains the fall.
    """
    if exp.excitation == "trace":
        return {}
    t, sigma = exp.time, noise_of(exp)
    noisy = sigma > STILL / SURE * exp.travel
    u = advance(exp) if noisy else displacement(exp)
    first = int(np.argmax(smoothed(u) > 0.2 * exp.travel)) if noisy else int(np.argmax(u > 0.2 * exp.travel))
    if noisy:
        onset = onset_in_noise(t, u, first)
    else:
        still = np.flatnonzero(u[:first] < STILL * exp.travel)
        onset = float(t[still[-1]] if still.size else t[0])
    if exp.excitation in ("step", "release"):
        return {"start" if exp.excitation == "step" else "release": onset}
    u = smoothed(u) if noisy else u
    last = int(u.size - 1 - np.argmax(u[::-1] > 0.5 * exp.travel))
    high = u[last - max(3, u.size // 100) : last].max() * (1.0 - STILL)
    before = np.flatnonzero(u[:last] > high - (2.0 * sigma if noisy else 0.0))
    plateau = float(t[before[-1]]) if before.size else float(t[last])
    return {"start": onset, "stop": max(plateau, onset + 1e-3)}


def advance(exp: Experiment) -> Array:
    """Signed displacement (T,) of the last station along its main direction, m (rad of angles).

    Noise of a distance never averages to 0; that of a signed displacement does.
    """
    p = exp.steady
    seen = np.isfinite(p).all(axis=1)
    moved = p[seen] - np.median(p[seen][:FIRST], axis=0)
    far = moved[np.linalg.norm(moved, axis=1) > 0.5 * exp.travel]
    direction = far.mean(axis=0)
    along = moved @ direction / max(float(np.linalg.norm(direction)), 1e-300)
    return np.interp(exp.time, exp.time[seen], along)


def noise_of(exp: Experiment) -> float:
    """Standard deviation of the last station's noise along one axis, from its second differences, m (rad of angles)."""
    p = exp.steady
    p = p[np.isfinite(p).all(axis=1)]
    if len(p) < FIRST:
        return 0.0
    return float(np.median(np.abs(np.diff(p, 2, axis=0))) / 0.6745 / np.sqrt(6.0))


def smoothed(u: Array) -> Array:
    """Running mean (T,) of five samples."""
    return np.convolve(np.pad(u, 2, mode="edge"), np.full(5, 0.2), mode="valid")


def onset_in_noise(t: Array, u: Array, first: int) -> float:
    """Moment at which a body at rest begins to move with a uniform acceleration, as u (T,) up to `first` shows it best.

    Every sample is tried as the beginning; the parabola from there on is fitted by least squares.
    """
    begin, best = t[max(first - 1, 0)], np.inf
    level = float(np.median(u[: max(first // 2, 3)]))
    for k in range(max(first - 1, 1)):
        shape = np.clip(t[: first + 1] - t[k], 0.0, None) ** 2
        size = max(float(shape @ (u[: first + 1] - level) / (shape @ shape)), 0.0)
        missed = float(np.sum((u[: first + 1] - level - size * shape) ** 2))
        if missed < best:
            begin, best = t[k], missed
    return float(begin)


def held_pose(exp: Experiment) -> Array:
    """Places (S, 2) of the stations in the last moments before the body is let go, m."""
    if exp.excitation != "release" or exp.without_positions:
        raise InputError(f"experiment {exp.name}: a pose was held before a release, and places show it, but this is a "
                         f"{exp.excitation}{' seen by angles alone' if exp.without_positions else ''}")  # fmt: skip
    onset = edges(exp)["release"]
    held = exp.position[(exp.time <= onset) & (exp.time > onset - HELD_S)]
    if np.isnan(held).all(axis=0).any():  # always one frame: the onset is one
        raise InputError(f"experiment {exp.name}: not every station is seen in the {HELD_S} s before the release")
    return np.asarray(np.nanmedian(held, axis=0))
