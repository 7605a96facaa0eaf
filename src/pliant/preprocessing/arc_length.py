"""Arc length of the stations: the recording's own, or the time-mean sum of chords."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

STRETCH_WORTH_TELLING = 0.02


def chord_lengths(position: NDArray[np.float64]) -> NDArray[np.float64]:
    """LinkAngles (T, S - 1), m, between neighbouring stations of positions (T, S, d)."""
    squared = np.zeros((position.shape[0], position.shape[1] - 1))
    for axis in range(position.shape[2]):
        squared += np.square(np.diff(position[:, :, axis], axis=1))
    chords: NDArray[np.float64] = np.sqrt(squared, out=squared)
    return chords


def whole_frames(recording: xr.Dataset) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Positions (T, S, d) and times (T,) of the frames that have all stations, and how many have not.

    Raises
    ------
    InputError
        When there are no positions, or no frame is whole.
    """
    if "position" not in recording:
        raise InputError("a shape is needed, but the recording holds no position: compute it from strain first")
    position, time = recording["position"].values, recording["time"].values
    missing: NDArray[np.bool_] = np.isnan(position).any(axis=2)
    whole = ~missing.any(axis=1)
    if not whole.any():
        worst = missing.sum(axis=0)
        raise InputError(
            f"no frame has all stations: station {int(worst.argmax())} is missing in {int(worst.max())} of "
            f"{len(time)} frames; select stations or resample along arc length first"
        )
    dropped = int((~whole).sum())
    return (position[whole], time[whole], dropped) if dropped else (position, time, dropped)


def station_arc_length(
    recording: xr.Dataset, position: NDArray[np.float64], chords: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Arc length (S,) of the stations from the first one, m, and what a user should know about it.

    Parameters
    ----------
    recording : xarray.Dataset
    position : (T, S, d) array, m
        Its whole frames.
    chords : (T, S - 1) array, m, optional
        Their `chord_lengths`, where they are known.

    Raises
    ------
    InputError
        When stations coincide, or the recorded arc length does not increase.
    """
    chords = chord_lengths(position) if chords is None else chords
    same = (chords == 0).all(axis=0)
    if same.any():
        where = int(same.argmax())
        raise InputError(f"stations {where} and {where + 1} coincide in all frames: keep one of them")
    measured = np.concatenate(([0.0], np.cumsum(chords.mean(axis=0))))
    total = chords.sum(axis=1)
    findings = []
    variation = float(np.ptp(total) / total.mean())
    if variation > STRETCH_WORTH_TELLING:
        findings.append(f"the length varies by {100 * variation:.1f} % over the frames; one arc length serves them all")
    if "arc_length" not in recording.coords:
        return measured, ("arc length: time-mean sum of chords", *findings)
    given = recording["arc_length"].values
    if not np.isfinite(given).all() or (np.diff(given) <= 0).any():
        raise InputError("arc_length of the stations must increase strictly from base to tip")
    ratio = measured[-1] / (given[-1] - given[0])
    if abs(ratio - 1.0) > STRETCH_WORTH_TELLING:
        findings.append(f"the chords add up to {ratio:.3f} times the recorded arc length")
    return given - given[0], ("arc length: as recorded", *findings)
