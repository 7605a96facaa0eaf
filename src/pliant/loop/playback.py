"""Play a recording back to the control loop in real time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pliant.errors import InputError
from pliant.loop.clock import Clock
from pliant.loop.sample import PRESSURE, SHAPE, Sample, nanoseconds, sample

if TYPE_CHECKING:
    import xarray as xr


class Playback:
    """Source that returns a recording's shapes and pressures when the clock reaches their times.

    Parameters
    ----------
    recording : xarray.Dataset
        Recording in the schema of `pliant.recording.schema`, with positions.
    clock : Clock
    speed : float
        Speed relative to the recording; 1 is real time.

    Raises
    ------
    InputError
        When the recording holds no positions, or the speed is not positive.
    """

    def __init__(self, recording: xr.Dataset, clock: Clock, *, speed: float = 1.0) -> None:
        if not (np.isfinite(speed) and speed > 0):
            raise InputError(f"the speed of a playback must be finite and > 0, got {speed}")
        if "position" not in recording:
            raise InputError("this recording has no positions: choose one with positions for the playback")
        self._clock, self._next = clock, 0
        time = np.asarray(recording["time"].values, dtype=float)
        rows = [(t, SHAPE, x) for t, x in zip(time, recording["position"].values, strict=True)]
        if "pressure" in recording:
            clock_p = np.asarray(recording["pressure_time"].values, dtype=float)
            rows += [(t, PRESSURE, p) for t, p in zip(clock_p, recording["pressure"].values, strict=True)]
        rows.sort(key=lambda row: row[0])
        origin = rows[0][0]
        self._rows = [sample(name, value, nanoseconds((t - origin) / speed)) for t, name, value in rows]
        self._start = clock.now()

    def read(self) -> Sample | None:
        """Return the next sample that is due, or None."""
        if self.finished or self._rows[self._next].time_ns > self._clock.now() - self._start:
            return None
        self._next += 1
        due = self._rows[self._next - 1]
        return due._replace(time_ns=due.time_ns + self._start)

    @property
    def finished(self) -> bool:
        """Whether all samples of the recording have been read."""
        return self._next >= len(self._rows)

    def close(self) -> None:
        """Do nothing: a playback holds no resources."""
