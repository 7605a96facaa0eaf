"""Compute the arc length of the stations along the body: as recorded, or from the mean distances of neighbouring
stations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

STRETCH_WORTH_TELLING = 0.02


def chord_lengths(position: Array) -> Array:
    """Return the distances (T, S - 1) [m] between neighbouring stations, from the positions (T, S, d) [m] of S stations
    in d dimensions over T frames.
    """
    squared = np.zeros((position.shape[0], position.shape[1] - 1))
    for axis in range(position.shape[2]):
        squared += np.square(np.diff(position[:, :, axis], axis=1))
    return np.sqrt(squared, out=squared)


def whole_frames(recording: xr.Dataset) -> tuple[Array, Array, int]:
    """Return the positions (T, S, d) [m] of S stations in d dimensions and the times (T,) [s], for the T frames in
    which no station is missing. Also return the number of frames left out.

    Raises
    ------
    InputError
        When there are no positions, or no frame has all stations.
    """
    if "position" not in recording:
        raise InputError("the recording has no positions: compute the shape from strain first")
    position, time = recording["position"].values, recording["time"].values
    missing: NDArray[np.bool_] = np.isnan(position).any(axis=2)
    whole = ~missing.any(axis=1)
    if not whole.any():
        worst = missing.sum(axis=0)
        raise InputError(
            f"no frame has all stations: station {int(worst.argmax())}, counted from 0, is missing in "
            f"{int(worst.max())} of {len(time)} frames; leave these stations out"
        )
    dropped = int((~whole).sum())
    return (position[whole], time[whole], dropped) if dropped else (position, time, dropped)


def station_arc_length(
    recording: xr.Dataset, position: Array, chords: Array | None = None
) -> tuple[Array, tuple[str, ...]]:
    """Return the arc lengths (S,) [m] of S stations, 0 at the first one, and sentences that say how they were
    determined.

    Parameters
    ----------
    recording : xarray.Dataset
    position : (T, S, d) array, m
        Positions in the frames that have all stations.
    chords : (T, S - 1) array, m, optional
        `chord_lengths` of `position`, where they are known already.

    Raises
    ------
    InputError
        When stations coincide, or the recorded arc length does not increase.
    """
    chords = chord_lengths(position) if chords is None else chords
    same = (chords == 0).all(axis=0)
    if same.any():
        where = int(same.argmax())
        raise InputError(f"stations {where} and {where + 1}, counted from 0, coincide in all frames: keep one of them")
    measured = np.concatenate(([0.0], np.cumsum(chords.mean(axis=0))))
    total = chords.sum(axis=1)
    findings = []
    variation = float(np.ptp(total) / total.mean())
    if variation > STRETCH_WORTH_TELLING:
        findings.append(f"the length varies by {100 * variation:.1f} % over the frames; the arc lengths are those "
                        "of the mean")
    if "arc_length" not in recording.coords:
        return measured, ("arc length: time-mean sum of chords", *findings)
    stated = recording["arc_length"].values
    if not np.isfinite(stated).all() or (np.diff(stated) <= 0).any():
        raise InputError("arc_length of the stations must increase strictly from base to tip: correct it, or leave "
                         "it out to use the sum of chords")
    ratio = measured[-1] / (stated[-1] - stated[0])
    if abs(ratio - 1.0) > STRETCH_WORTH_TELLING:
        findings.append(f"the chords add up to {ratio:.3f} times the recorded arc length")
    return stated - stated[0], ("arc length: as recorded", *findings)
