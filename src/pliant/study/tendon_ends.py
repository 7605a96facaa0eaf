"""Where tendons end along a body, from how far each draws the stations to its side."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
LOWEST = 0.05  # of the highest station: below it a station does not show where a tendon ends


def even_bend(height: np.ndarray, begin: float, end: float | np.ndarray) -> np.ndarray:
    """Return the small sideways displacements [m] of points at the heights (S,) [m] along the base tangent, for a body
    with a curvature of 1/m between the heights `begin` and `end` [m] that is straight elsewhere.
    """
    bent = np.clip(height, begin, end) - begin
    return np.asarray(bent * (height - begin - 0.5 * bent))


def end_of_bend(gain: Array, height: Array) -> tuple[float, float]:
    """Return the azimuth [degrees] of a tendon, and the height [m] at which it ends.

    A tendon is assumed to bend the body towards itself, evenly from the base to one of the stations, and to leave it
    straight beyond. The end is the station with which this best explains the displacements of all stations.

    Parameters
    ----------
    gain : array (S, 2)
        Displacement of each station across the base tangent, per unit of the input [m per unit].
    height : array (S,)
        Height of each station along the base tangent at rest [m].
    """
    ends = np.sort(height[height > LOWEST * np.nanmax(height)])
    shapes = even_bend(height, 0.0, ends[:, None])  # (E, S)
    measured = np.isfinite(gain).all(axis=1) & np.isfinite(height)
    curvature = shapes[:, measured] @ gain[measured] / (shapes[:, measured] ** 2).sum(axis=1)[:, None]  # (E, 2)
    squared_error = ((gain[measured] - shapes[:, measured, None] * curvature[:, None]) ** 2).sum(axis=(1, 2))
    best = int(np.argmin(squared_error))
    towards = curvature[best]
    return float(np.degrees(np.arctan2(towards[1], towards[0])) % 360.0), float(ends[best])
