"""Sources of samples for a control loop without hardware: a recording that is played back, or a simulated plant."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from pliant.errors import InputError
from pliant.loop.clock import Clock
from pliant.loop.sample import COMMAND, PRESSURE, SHAPE, Sample, nanoseconds, sample
from pliant.recording.inputs import recorded_inputs

if TYPE_CHECKING:
    import xarray as xr

Array = np.ndarray
BEHIND = 50  # most periods simulated at once; if the plant is slower than the clock, the others are skipped


class Playback:
    """Source that returns a recording's shapes and inputs when the clock reaches their times. Recorded tensions,
    displacements or angles are sent as samples named "pressure" in their own unit, as from `VirtualActuator`.

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
        When the recording holds no positions, inputs of several units, or the speed is not positive.
    """

    def __init__(self, recording: xr.Dataset, clock: Clock, *, speed: float = 1.0) -> None:
        if not (np.isfinite(speed) and speed > 0):
            raise InputError(f"the speed of a playback must be finite and > 0, got {speed}")
        if "position" not in recording:
            raise InputError("this recording has no positions: choose one with positions for the playback")
        self._clock, self._next = clock, 0
        time = np.asarray(recording["time"].values, dtype=float)
        rows = [(t, SHAPE, x) for t, x in zip(time, recording["position"].values, strict=True)]
        variables = [name for name in ("pressure", "actuation") if name in recording]
        units = list(dict.fromkeys(entry.unit for entry in recorded_inputs(recording)))
        if len(units) > 1:
            raise InputError(f"a playback sends inputs of one unit, and this recording has {', '.join(units)}: drop "
                             f"{' or '.join(variables)}")  # fmt: skip
        for name in variables:
            clock_p = np.asarray(recording[f"{'pressure' if name == 'pressure' else 'input'}_time"].values, dtype=float)
            rows += [(t, PRESSURE, p) for t, p in zip(clock_p, recording[name].values, strict=True)]
        rows.sort(key=lambda row: row[0])
        origin = rows[0][0]
        self._rows = [sample(name, value, nanoseconds((t - origin) / speed), units[0] if name == PRESSURE else None)
                      for t, name, value in rows]  # fmt: skip
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


class PlantLike(Protocol):
    """Interface of a plant that advances one period at a time while its command is held constant."""

    period: float  # s, of its frames
    time: float  # s, on its own clock
    arc_length: Any  # (S,) m, of the points along the body; for `prepare_plant`
    # rides: bool, optional: whether its points are material points that move with the stretching body, as markers do

    def advance(self, command: Any) -> Any:
        """Simulate the plant for one period with the commands (C,) [Pa] of its C chambers held constant, and return the
        sensors' readings.

        Returns the time of the shape [s], the shape (S, 2) [m] in the base frame with NaN for lost points, and the
        pressures (C,) [Pa], or a number for one chamber. A command of shape (1,) that is 0 vents all chambers.
        """


class VirtualActuator:
    """Connects a simulated plant to a control loop: source of its sensor readings and sink of its commands. The plant
    advances with the clock, and is vented when the hold time of a command is over.

    Parameters
    ----------
    plant : PlantLike
        Plant to simulate, e.g. `pliant.testbed.plant.Plant`.
    clock : Clock
    unit : str
        SI unit of the plant's inputs: "Pa", of tendons "N", "m" or "rad".

    Attributes
    ----------
    behind : int
        Number of periods that were skipped because the plant was slower than the clock.
    """

    def __init__(self, plant: PlantLike, clock: Clock, unit: str = "Pa") -> None:
        self.plant, self._clock, self._unit = plant, clock, unit
        self._queue: deque[Sample] = deque()
        self._period = nanoseconds(plant.period)
        self._done = self._start = clock.now()
        self._begin, self.behind = plant.time, 0
        self._command: Array = np.zeros(1)
        self._until: int | None = None
        self.finished = False

    def read(self) -> Sample | None:
        """Advance the plant to the present time and return its oldest unread sample, or None."""
        now = self._clock.now()
        owed = (now - self._done) // self._period
        if owed > BEHIND:
            self.behind += owed - BEHIND
            self._done += (owed - BEHIND) * self._period
        while self._done + self._period <= now:
            self._done += self._period
            if self._until is not None and self._done > self._until:
                self._command, self._until = 0.0 * self._command, None  # no command has arrived since
            taken, shape, pressure = self.plant.advance(self._command)
            self._queue.append(sample(PRESSURE, pressure, self._done, self._unit))
            self._queue.append(sample(SHAPE, shape, self._start + nanoseconds(taken - self._begin)))
        return self._queue.popleft() if self._queue else None

    def write(self, sample: Sample) -> None:
        """Apply the command in the sample to the plant from now on. If the sample has a hold time, the plant is vented
        when this time is over.
        """
        if sample.name == COMMAND:
            self._command = sample.array
            self._until = self._clock.now() + nanoseconds(sample.hold) if sample.hold else None

    def close(self) -> None:
        """Mark the source as finished; there are no resources to release."""
        self.finished = True
