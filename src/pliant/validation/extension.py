"""How much a body lengthens as it bends: the models do not, so it is told beside their errors."""

from __future__ import annotations

import numpy as np

from pliant.identification.experiment import Experiment
from pliant.numerics.arcs import arc_lengths

Array = np.ndarray
FAR = 0.9  # of the travel: frames that count as bent


def extension(exp: Experiment) -> dict[str, float | None]:
    """Growth of the body's length from its first frames to where the last station is displaced most.

    The length is that of circular arcs through the stations, each beginning along the end of the one before, the first
    along +y at the origin: exact where the curvature between stations is constant.

    Returns
    -------
    dict
        ``extension_mm`` and ``extension_percent``; None for a body seen at one point, whose tilt would pass for growth.
    """
    none: dict[str, float | None] = {"extension_mm": None, "extension_percent": None}
    if len(exp.stations) < 2:
        return none
    seen = np.isfinite(exp.position).all(axis=(1, 2))
    length = arc_lengths(exp.position[seen])
    tip = exp.last_station[seen]
    moved = np.linalg.norm(tip - np.median(tip[:5], axis=0), axis=1) if length.size else np.zeros(0)
    if length.size < 10 or moved.max() == 0:
        return none
    rest, bent = float(np.median(length[:5])), float(np.median(length[moved > FAR * moved.max()]))
    return {"extension_mm": 1e3 * (bent - rest), "extension_percent": 100 * (bent / rest - 1)}
