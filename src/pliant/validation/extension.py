"""Lengthening of a body as it bends, measured and modelled."""

from __future__ import annotations

import numpy as np

from pliant.identification.experiment import Experiment
from pliant.numerics.arcs import arc_lengths

Array = np.ndarray
LONGEST = 0.02  # of the frames, those that are longest or shortest
FEWEST = 5  # frames
NAMES = ("extension_mm", "extension_percent")
MODELLED = ("extension_modelled_mm", "extension_modelled_percent")


def extension(exp: Experiment, modelled: Array) -> dict[str, float | None]:
    """Largest change of the measured body's length, and the modelled motion's (T, S, 2) [m] in the same frames."""
    seen = np.isfinite(exp.position).all(axis=(1, 2))
    measured = growth(exp.position[seen], NAMES)
    if measured[NAMES[0]] is None:
        return {**measured, **dict.fromkeys(MODELLED)}
    frames = extreme_frames(arc_lengths(exp.position[seen]))
    return {**measured, **change(arc_lengths(modelled[seen]), frames, MODELLED)}


def growth(position: Array, names: tuple[str, str]) -> dict[str, float | None]:
    """Largest change of a body's length from its first frames, by its points (T, S, 2) [m].

    The length is that of circular arcs through the points (`pliant.numerics.arcs`). The change is the median of the
    frames in which the body is longest, or shortest where it shortens by more: one frame in fifty, five at least.

    Returns
    -------
    dict
        In mm and in % of the length in the first frames, by `names`; None for a body seen at one point, whose tilt
        would pass for a change of length.
    """
    if position.shape[1] < 2 or len(position) < 2 * FEWEST or np.ptp(position[:, -1], axis=0).max() == 0:
        return dict.fromkeys(names)
    length = arc_lengths(position)
    return change(length, extreme_frames(length), names)


def extreme_frames(length: Array) -> Array:
    """Frames in which a length (T,) is farthest from its first ones, to the side on which it is farther."""
    away = length - np.median(length[:FEWEST])
    count = max(FEWEST, round(LONGEST * length.size))
    order = np.argsort(away)
    low, high = order[:count], order[-count:]
    return np.asarray(high if np.median(away[high]) >= -np.median(away[low]) else low)


def change(length: Array, frames: Array, names: tuple[str, str]) -> dict[str, float | None]:
    """Change of a length (T,) [m] from its first frames to `frames`, in mm and in %, by `names`."""
    rest, there = float(np.median(length[:FEWEST])), float(np.median(length[frames]))
    return dict(zip(names, (1e3 * (there - rest), 100 * (there / rest - 1)), strict=True))
