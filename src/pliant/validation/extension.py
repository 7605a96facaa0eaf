"""Metrics of the change of a body's length as it bends, measured and modelled."""

from __future__ import annotations

import numpy as np

from pliant.identification.experiment import Experiment
from pliant.numerics.arcs import arc_lengths

Array = np.ndarray
LONGEST = 0.02  # fraction of the frames that counts as longest or shortest
FEWEST = 5  # frames
NAMES = ("extension_mm", "extension_percent")
MODELLED = ("extension_modelled_mm", "extension_modelled_percent")


def extension(exp: Experiment, modelled: Array) -> dict[str, float | None]:
    """Return the largest change of the measured body's length, and that of the modelled motion in the same frames.

    `modelled` is (T, S, 2) [m].
    """
    seen = np.isfinite(exp.position).all(axis=(1, 2))
    measured = growth(exp.position[seen], NAMES)
    if measured[NAMES[0]] is None:
        return {**measured, **dict.fromkeys(MODELLED)}
    frames = extreme_frames(arc_lengths(exp.position[seen]))
    return {**measured, **change(arc_lengths(modelled[seen]), frames, MODELLED)}


def growth(position: Array, names: tuple[str, str]) -> dict[str, float | None]:
    """Return the largest change of a body's length from its first frames, computed from its points (T, S, 2) [m].

    The length is that of circular arcs through the points (`pliant.numerics.arcs`). The change is the median over the
    2 % of the frames (at least five) in which the body is longest, or shortest if it shortens by more.

    Returns
    -------
    dict
        Change in mm and in % of the length in the first frames, under the two `names`. None for a body measured at a
        single point, since its tilt would look like a change of length.
    """
    if position.shape[1] < 2 or len(position) < 2 * FEWEST or np.ptp(position[:, -1], axis=0).max() == 0:
        return dict.fromkeys(names)
    length = arc_lengths(position)
    return change(length, extreme_frames(length), names)


def extreme_frames(length: Array) -> Array:
    """Return the indices of the 2 % of frames (at least 5) in which a length (T,) differs most from its first frames.

    They are the longest or the shortest frames, whichever differ more.
    """
    away = length - np.median(length[:FEWEST])
    count = max(FEWEST, round(LONGEST * length.size))
    order = np.argsort(away)
    low, high = order[:count], order[-count:]
    return np.asarray(high if np.median(away[high]) >= -np.median(away[low]) else low)


def change(length: Array, frames: Array, names: tuple[str, str]) -> dict[str, float | None]:
    """Return the change of a length (T,) [m] from its first frames to the given frames, in mm and in %,
    under `names`.
    """
    rest, there = float(np.median(length[:FEWEST])), float(np.median(length[frames]))
    return dict(zip(names, (1e3 * (there - rest), 100 * (there / rest - 1)), strict=True))
