"""A plant that moves with the loop's clock, as source of its sensor readings and sink of its commands."""

from __future__ import annotations

from collections import deque
from typing import Any, Protocol

import numpy as np

from pliant.loop.clock import Clock
from pliant.loop.sample import COMMAND, PRESSURE, SHAPE, Sample, nanoseconds, sample

Array = np.ndarray
BEHIND = 50  # most periods simulated at once; if the plant is slower than the clock, the others are skipped


class PlantLike(Protocol):
    """Interface of a plant that advances one period at a time under a constant command."""

    period: float  # s, of its frames
    time: float  # s, on its own clock
    arc_length: Any  # (S,) m, of the points along the body; for `prepare_plant`
    # rides: bool, optional: whether its points are material points that move with the stretching body, as markers do

    def advance(self, command: Any) -> Any:
        """Hold the commands (C,) [Pa] for one period and return the sensors' readings.

        Returns the time of the shape [s], the shape (S, 2) [m] in the base frame with NaN for lost points, and the
        pressures (C,) [Pa], or a number for one chamber. A command of shape (1,) that is 0 vents all chambers.
        """


class VirtualActuator:
    """Source and sink of a plant that advances with the clock and vents when a command's hold time is over.

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
        """Hold the command of the sample from now on, for its hold time if it has one."""
        if sample.name == COMMAND:
            self._command = sample.array
            self._until = self._clock.now() + nanoseconds(sample.hold) if sample.hold else None

    def close(self) -> None:
        """Mark the source as finished; there are no resources to release."""
        self.finished = True
