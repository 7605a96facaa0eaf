"""Frequency and damping of the large and of the small swings of a free decay, from its turning points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

Array = np.ndarray
LARGE = 1.0 / 3.0  # of the first swing: larger swings count as large
SMALL = 1.0 / 6.0  # of the first swing: smaller swings count as small
NOISE = 6.0  # standard deviations of the noise: least size of a swing
LEAST = 0.01  # of the range of the signal: least size of a swing


class Swings(NamedTuple):
    """Frequency and damping of the swings of one size class; None where there are too few."""

    amplitude: float | None  # half of the mean swing, unit of the signal
    frequency: float | None  # Hz, from the mean time between turning points
    damping_ratio: float | None  # from the decrement of successive swings


NONE = Swings(None, None, None)


def swings(time: Array, signal: Array) -> tuple[Swings, Swings]:
    """Return frequency and damping of the large swings and of the small swings of a free decay.

    A swing is the motion between two successive turning points, so that the final position need not be known. Large
    swings exceed a third of the first one, small swings are below a sixth of it and clear of noise. The frequency is
    that of the half periods between turning points. A damping ratio needs two successive swings, whose decrement ln(A_k
    / A_{k+1}) is pi zeta / sqrt(1 - zeta^2).

    Parameters
    ----------
    time, signal : array (T,)
        Times in s and a signal of any unit, evenly sampled within a few per cent, from the release on.
    """
    t, y = np.asarray(time, dtype=float), np.asarray(signal, dtype=float)
    if t.size < 16 or np.ptp(y) == 0:
        return NONE, NONE
    noise = float(np.median(np.abs(np.diff(y, 2)))) / 0.6745 / np.sqrt(6.0)
    at, value = turning_points(t, y, max(NOISE * noise, LEAST * float(np.ptp(y))))
    way = np.abs(np.diff(value))
    if way.size == 0:
        return NONE, NONE
    large = way >= LARGE * way[0]
    end = int(np.argmin(large)) if not large.all() else way.size
    few = np.flatnonzero(way > SMALL * way[0])[-1] + 1
    return of_swings(at, way, 0, end), of_swings(at, way, int(few), way.size)


def of_swings(at: Array, way: Array, first: int, last: int) -> Swings:
    """Return frequency and damping of the swings first ... last - 1.

    `at` are the times of the turning points [s], `way` the sizes of the swings between them.
    """
    count = last - first
    if count < 1:
        return NONE
    half = float(at[last] - at[first]) / count
    ratio = None
    if count > 1:
        decrement = float(np.log(way[first] / way[last - 1])) / (count - 1) / np.pi
        ratio = decrement / float(np.hypot(1.0, decrement))
    return Swings(0.5 * float(way[first:last].mean()), 0.5 / half, ratio)


def turning_points(t: Array, y: Array, least: float) -> tuple[Array, Array]:
    """Return times and values of the extremes of y, at least `least` apart in value, beginning with the first sample.

    Each extreme is that of the parabola through the nearest three samples.
    """
    found, way = [0], 0.0
    for k in range(1, y.size):
        move = y[k] - y[found[-1]]
        if way == 0.0:
            if abs(move) >= least:
                way = float(np.sign(move))
                found.append(k)
        elif move * way >= 0:
            found[-1] = k
        elif abs(move) >= least:
            way = -way
            found.append(k)
    inner = [k for k in found[1:-1] if k > 0]  # the last one may not be a turning point
    at, value = [t[0]], [y[0]]
    for k in inner:
        bend = y[k - 1] - 2.0 * y[k] + y[k + 1]
        shift = 0.5 * (y[k - 1] - y[k + 1]) / bend if bend else 0.0
        at.append(t[k] + shift * (t[k + 1] - t[k]))
        value.append(y[k] - 0.25 * (y[k - 1] - y[k + 1]) * shift)
    return np.array(at), np.array(value)
