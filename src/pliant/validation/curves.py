"""Computation of the curves that figures show: thinned lines, autocorrelation, frames to draw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from pliant.identification import Experiment
from pliant.model import ActuationInput
from pliant.validation.outcome import FitOutcome

Array = np.ndarray


def thin(time: Array, value: Array, most: int = 1200) -> tuple[Array, Array]:
    """Return a line reduced to about `most` points, such that it looks the same when drawn.

    The extremes of each short interval and the gaps are kept.

    Parameters
    ----------
    time, value : array (T,)
        NaN where nothing was measured.
    """
    if time.size <= most:
        return time, value
    cuts = np.linspace(0, time.size, most // 2 + 1).astype(int)
    keep: list[int] = [0, time.size - 1]
    for a, b in pairwise(cuts):
        measured = np.flatnonzero(np.isfinite(value[a:b]))
        if measured.size:
            stretch = value[a:b][measured]
            keep += [a + int(measured[stretch.argmin()]), a + int(measured[stretch.argmax()])]
        if measured.size < b - a:
            keep.append(a + int(np.flatnonzero(~np.isfinite(value[a:b]))[0]))
    index = np.unique(keep)
    return time[index], value[index]


def autocorrelation(time: Array, value: Array) -> tuple[Array, Array]:
    """Return the lags [s] and the autocorrelation of a signal, up to a quarter of its length and 400 lags.

    Parameters
    ----------
    time, value : array (T,)
        NaN samples are left out of every product. The lag is the number of samples times the median interval: jitter
        of the clock is neglected.

    Returns
    -------
    lag, correlation : array (L,)
        Lags [s] and biased estimate of the correlation: sums are divided by that of the whole length, so that large
        lags with few products tend to zero.
    """
    measured = np.isfinite(value)
    r = np.where(measured, value - (value[measured].mean() if measured.any() else 0.0), 0.0)
    lags = np.arange(min(time.size // 4, 400) + 1)
    power = float(r @ r)
    if power <= 0.0:
        return lags * 0.0, lags * 0.0
    correlation = np.array([r[: r.size - k] @ r[k:] for k in lags]) / power
    return lags * float(np.median(np.diff(time))), correlation


def evenly_spaced(count: int, most: int = 6) -> list[int]:
    """Return at most `most` of `count` indices, evenly spread and always with the last one."""
    if count <= most:
        return list(range(count))
    return sorted({round(i) - 1 for i in np.linspace(count / most, count, most)})


def instants(path: Array, most: int = 4) -> list[int]:
    """Return the indices of a few frames that show a point's motion: the first measured frame, and the frames in which
    the point's distance from its first position first reaches equal fractions of the largest distance.

    Parameters
    ----------
    path : array (T, 2)
    """
    measured = np.flatnonzero(np.isfinite(path).all(axis=1))
    away = np.linalg.norm(path[measured] - path[measured[0]], axis=1)
    farthest = int(away.argmax())
    reached = [int(np.argmax(away >= share * away[farthest])) for share in np.linspace(0, 1, most)]
    return [int(measured[k]) for k in dict.fromkeys(reached)]


def axes_of(exp: Experiment) -> tuple[tuple[str, ...], str, float]:
    """Return the axis names, the unit and the factor from SI to this unit for a figure of what an experiment compares:
    positions in mm, angles or inclination in degrees.
    """
    return exp.axes, *exp.shown_in


def laws_of(fit: FitOutcome) -> list[tuple[str, ActuationInput, dict[float, str]]]:
    """Return (title of its plot, chamber, marks) for each pressure chamber of a fit. `marks` maps the pressure farthest
    from 0 [Pa] in each recording to the role of the recording, such as training.

    Tendons are left out, since they have no torque law.
    """
    chambers = fit.result.model.chambers
    if fit.result.model.actuation.count == 1 and chambers[0].kind == "pressure":
        return [(fit.title, chambers[0], {r.experiment.peak: r.role for r in fit.records})]
    laws = []
    for c in (c for c in chambers if c.kind == "pressure"):
        driven = [r for r in fit.records if c.name in r.experiment.drives]
        marks: dict[float, str] = {r.experiment.drives[c.name].peak: r.role for r in driven}
        laws.append((f"{fit.title}, {c.name}", c, marks))
    return laws


def pressures_of(laws: Sequence[tuple[str, ActuationInput, Mapping[float, str]]], count: int) -> Array:
    """Return `count` evenly spaced pressures [Pa] at which to draw torque laws. They cover 0 Pa and the peak pressures
    of all recordings, with a margin of 5 %.
    """
    levels = [0.0, *(p for _, _, marks in laws for p in marks)]
    low, high = min(levels), max(levels)
    return np.linspace(1.05 * low, 1.05 * (high if low < 0.0 else max(high, 1.0)), count)


def slenderness(measured: Array, modelled: Array, body: bool) -> float:
    """Return the ratio of height to width of a figure that shows the paths (T, S, 2) of S stations over T frames. The
    ratio is kept between 0.3 and 1.1.
    """
    points = [measured[:, -1], modelled[:, -1]] if not body else [
        measured.reshape(-1, 2), modelled.reshape(-1, 2), np.zeros((1, 2))]
    width, height = np.ptp([np.nanmin(p, axis=0) for p in points] + [np.nanmax(p, axis=0) for p in points], axis=0)
    return float(np.clip(height / max(width, 1e-9), 0.3, 1.1))
