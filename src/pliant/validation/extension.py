"""How much a body lengthens as it bends, measured and modelled."""

from __future__ import annotations

import numpy as np

from pliant.identification.experiment import Experiment
from pliant.numerics.arcs import arc_lengths

Array = np.ndarray
FAR = 0.9  # of the travel: frames that count as bent
NAMES = ("extension_mm", "extension_percent")
MODELLED = ("extension_modelled_mm", "extension_modelled_percent")


def extension(exp: Experiment, modelled: Array) -> dict[str, float | None]:
    """Growth of the body as it was seen, and of the modelled motion (T, S, 2) [m] in the same frames; see `growth`."""
    seen = np.isfinite(exp.position).all(axis=(1, 2))
    return {**growth(exp.position[seen], NAMES), **growth(modelled[seen], MODELLED)}


def growth(position: Array, names: tuple[str, str]) -> dict[str, float | None]:
    """Growth of a body's length from its first frames to where the last of its points (T, S, 2) is displaced most.

    The length is that of circular arcs through the points (`pliant.numerics.arcs`).

    Returns
    -------
    dict
        In mm and in % of the length in the first frames, by `names`; None for a body seen at one point, whose tilt
        would pass for growth.
    """
    length, tip = arc_lengths(position), position[:, -1]
    moved = np.linalg.norm(tip - np.median(tip[:5], axis=0), axis=1) if length.size else np.zeros(0)
    if position.shape[1] < 2 or length.size < 10 or moved.max() == 0:
        return dict.fromkeys(names)
    rest, bent = float(np.median(length[:5])), float(np.median(length[moved > FAR * moved.max()]))
    return dict(zip(names, (1e3 * (bent - rest), 100 * (bent / rest - 1)), strict=True))
