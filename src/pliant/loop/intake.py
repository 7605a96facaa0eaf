"""Check incoming samples of a sensor: unit, size, time stamp, and whether the values ever change."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pliant.loop.sample import Sample
from pliant.units import METRE, NEWTON, PASCAL, RADIAN

Array = np.ndarray
OF_INPUT = {"Pa": PASCAL, "N": NEWTON, "m": METRE, "rad": RADIAN}  # units that a reading of an input may have


class Stream:
    """Checks the readings that arrive from one sensor and rejects invalid ones. It keeps the time of the newest
    complete reading, i.e. one without NaN.

    Parameters
    ----------
    units : mapping
        Accepted units (lower case) and their values in SI. Readings in another unit are rejected.
    shape : bool
        If True, a reading must be an array of points (S, axes) with the same S each time. Otherwise it is a 1-D array.
    skew : int
        Time [ns] by which a time stamp may be ahead of the loop's clock.
    now : int
        Start time of the loop [ns].

    Attributes
    ----------
    stamp, arrival : int
        Time stamp and arrival time [ns] of the newest complete reading.
    repeats : int
        Number of consecutive readings that are identical to the reading before.
    rejected, ahead, late : int
        Numbers of readings that were not used: wrong unit or size (`rejected`), time stamp in the future (`ahead`), not
        newer than an earlier one (`late`).
    """

    def __init__(self, units: Mapping[str, float], *, shape: bool, skew: int, now: int, axes: int = 2) -> None:
        self._units, self._shape, self._skew, self._axes = units, shape, skew, axes
        self._newest, self._last, self._points = now - 1, np.empty(0), 0
        self.stamp = self.arrival = now
        self.repeats = self.rejected = self.ahead = self.late = 0

    def accept(self, arrived: Sample, now: int) -> Array | None:
        """Return the reading in SI units, or None if it fails a check; `now` [ns] is its arrival time."""
        factor = self._units.get(arrived.unit.lower())
        array = arrived.array
        if factor is None or not self._fits(array):
            self.rejected += 1
            return None
        if arrived.time_ns > now + self._skew:
            self.ahead += 1
            return None
        if arrived.time_ns <= self._newest:
            self.late += 1
            return None
        self._newest = arrived.time_ns
        self.repeats = self.repeats + 1 if np.array_equal(array, self._last) else 0
        self._last = array
        if self._shape:
            self._points = len(array)
        return array if factor == 1.0 else array * factor

    def mark_complete(self, now: int) -> None:
        """Mark the last accepted reading as complete (all values finite); `now` [ns] is its arrival time."""
        self.stamp, self.arrival = self._newest, now

    @property
    def reference_time(self) -> int:
        """Time [ns] from which the age of the newest complete reading is counted: the earlier of its time stamp and its
        arrival.
        """
        return min(self.stamp, self.arrival)

    def _fits(self, array: Array) -> bool:
        if not self._shape:
            return bool(array.size) and array.ndim <= 1
        known = array.ndim == 2 and array.shape[1] == self._axes
        return known and len(array) > 0 and self._points in (0, len(array))


def streams(skew: int, now: int, axes: int = 2, unit: str = "Pa") -> tuple[Stream, Stream]:
    """Return two `Stream` objects for a loop that starts at `now` [ns]: one checks the measured shapes, the other the
    measured actuation inputs in the SI unit `unit`, e.g. pressures in Pa.

    `axes` is the number of coordinates of a point, and `skew` [ns] the time by which stamps may be ahead.
    """
    shapes = Stream(METRE, shape=True, skew=skew, now=now, axes=axes)
    return shapes, Stream(OF_INPUT[unit], shape=False, skew=skew, now=now)
