"""Detection of when a pressure pulse or step begins and ends, or a body is let go, from the motion alone."""

from __future__ import annotations

import numpy as np

from pliant.errors import InputError
from pliant.identification.experiment import EDGES_OF, Experiment

Array = np.ndarray
EDGES = EDGES_OF["pulse"]  # of a pressure
HELD_S = 0.05  # s before a release over which the held pose is averaged (median)
STILL = 0.03  # of the peak displacement: smaller displacements count as no motion
SURE = 4.0  # standard deviations of the noise that must be smaller than STILL for the threshold method
FIRST = 5  # frames whose median is the first position


def displacement(exp: Experiment) -> Array:
    """Return how far the last station is from its first position in each of T frames (T,): a distance [m], or the
    change of an angle [rad] if only angles were recorded. Gaps are interpolated.
    """
    p = exp.steady
    complete = np.isfinite(p).all(axis=1)
    u = np.linalg.norm(p[complete] - np.median(p[complete][:FIRST], axis=0), axis=1)
    return np.interp(exp.time, exp.time[complete], u)


def edges(exp: Experiment) -> dict[str, float]:
    """Return the times [s], by parameter name, at which the pressure switched or the body was let go. They are found
    from the motion of the last station.

    The names are ``start`` and ``stop`` for a pulse, ``start`` for a step, ``release`` for a release; a measured
    pressure has none. The start is the last time at which the displacement was below 3 % of its peak before it first
    exceeds 20 %. The stop is found in the same way, backwards from the end of the plateau. If the noise exceeds the
    3 %, the start is that of the parabola that fits the rise best (`onset_in_noise`), and the plateau ends where the
    fall exceeds the noise.
    """
    if not (names := EDGES_OF[exp.excitation]):
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
    if len(names) == 1:
        return {names[0]: onset}
    u = smoothed(u) if noisy else u
    last = int(u.size - 1 - np.argmax(u[::-1] > 0.5 * exp.travel))
    high = u[last - max(3, u.size // 100) : last].max() * (1.0 - STILL)
    before = np.flatnonzero(u[:last] > high - (2.0 * sigma if noisy else 0.0))
    plateau = float(t[before[-1]]) if before.size else float(t[last])
    return {"start": onset, "stop": max(plateau, onset + 1e-3)}


def advance(exp: Experiment) -> Array:
    """Return the signed displacement (T,) [m; angles: rad] of the last station along its main direction of motion, in T
    frames.

    The noise of a signed displacement averages to 0, that of a distance does not.
    """
    p = exp.steady
    complete = np.isfinite(p).all(axis=1)
    moved = p[complete] - np.median(p[complete][:FIRST], axis=0)
    far = moved[np.linalg.norm(moved, axis=1) > 0.5 * exp.travel]
    direction = far.mean(axis=0)
    along = moved @ direction / max(float(np.linalg.norm(direction)), 1e-300)
    return np.interp(exp.time, exp.time[complete], along)


def noise_of(exp: Experiment) -> float:
    """Return the noise standard deviation [m; angles: rad] of the last station along each axis, from second differences
    in time.
    """
    p = exp.steady
    p = p[np.isfinite(p).all(axis=1)]
    if len(p) < FIRST:
        return 0.0
    return float(np.median(np.abs(np.diff(p, 2, axis=0))) / 0.6745 / np.sqrt(6.0))


def smoothed(u: Array) -> Array:
    """Return a signal u (T,) after a running mean over five samples."""
    return np.convolve(np.pad(u, 2, mode="edge"), np.full(5, 0.2), mode="valid")


def onset_in_noise(t: Array, u: Array, first: int) -> float:
    """Return the time [s] at which a body at rest starts to move, from a parabola fitted to its displacement u (T,).
    The fit uses u up to index `first`.

    Every sample is tried as the start. The motion has constant acceleration from there on.
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
    """Return the median positions (S, 2 or 3) [m] of S stations in the last 0.05 s before a held body is let go."""
    if exp.excitation != "release" or exp.without_positions:
        raise InputError(f"experiment {exp.name}: a held pose needs a release with positions, but this recording is a "
                         f"{exp.excitation}{' with angles only' if exp.without_positions else ''}: leave out "
                         "held = 'measured'")  # fmt: skip
    onset = edges(exp)["release"]
    before_release = exp.position[(exp.time <= onset) & (exp.time > onset - HELD_S)]
    unseen = np.isnan(before_release).all(axis=0).any(axis=1)  # always one frame: the onset is one
    if unseen.any():
        raise InputError(
            f"experiment {exp.name}: station {exp.stations[unseen.argmax()]!r} is not seen in the {HELD_S} s before "
            "the release: leave out this station, or held = 'measured'"
        )
    return np.asarray(np.nanmedian(before_release, axis=0))
