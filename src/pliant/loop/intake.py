"""Checks of incoming samples before they are used: unit, size, time, and whether the values ever change."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pliant.loop.sample import Sample
from pliant.units import METRE, NEWTON, PASCAL, RADIAN

Array = np.ndarray
OF_INPUT = {"Pa": PASCAL, "N": NEWTON, "m": METRE, "rad": RADIAN}  # units that a reading of an input may have


class Stream:
    """The readings of one sensor: newest first, each with the time of its stamp and that of its arrival.

    Parameters
    ----------
    units : mapping
        SI values of one unit, by name in lower case: what else comes is rejected.
    shape : bool
        Whether a reading is a row of points (S, axes), the same number each time; otherwise any numbers.
    skew : int
        ns by which a stamp may lie ahead of the loop's clock.
    now : int
        ns, when the loop began.

    Attributes
    ----------
    stamp, arrival : int
        ns, of the newest whole reading.
    repeats : int
        Readings in a row that equal the one before them in every number.
    rejected, ahead, late : int
        Readings of another unit or size; of a time that has not come; not newer than one before. None is used.
    """

    def __init__(self, units: Mapping[str, float], *, shape: bool, skew: int, now: int, axes: int = 2) -> None:
        self._units, self._shape, self._skew, self._axes = units, shape, skew, axes
        self._newest, self._last, self._points = now - 1, np.empty(0), 0
        self.stamp = self.arrival = now
        self.repeats = self.rejected = self.ahead = self.late = 0

    def take(self, arrived: Sample, now: int) -> Array | None:
        """The reading in SI, or None where it is not to be used; `now` [ns] is when it arrived."""
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

    def whole(self, now: int) -> None:
        """The reading that was taken last has all its numbers."""
        self.stamp, self.arrival = self._newest, now

    @property
    def seen(self) -> int:
        """Time from which the newest whole reading ages, ns: its stamp, or its arrival where that is earlier."""
        return min(self.stamp, self.arrival)

    def _fits(self, array: Array) -> bool:
        if not self._shape:
            return bool(array.size) and array.ndim <= 1
        known = array.ndim == 2 and array.shape[1] == self._axes
        return known and len(array) > 0 and self._points in (0, len(array))


def streams(skew: int, now: int, axes: int = 2, unit: str = "Pa") -> tuple[Stream, Stream]:
    """The streams of shapes, of so many coordinates a point, and of inputs in `unit`; the loop begins `now` [ns]."""
    shapes = Stream(METRE, shape=True, skew=skew, now=now, axes=axes)
    return shapes, Stream(OF_INPUT[unit], shape=False, skew=skew, now=now)
