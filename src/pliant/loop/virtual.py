"""A plant on the loop's clock: as source of its sensors and as sink of the command."""

from __future__ import annotations

from collections import deque
from typing import Any, Protocol

import numpy as np

from pliant.loop.clock import Clock
from pliant.loop.sample import COMMAND, PRESSURE, SHAPE, Sample, nanoseconds, sample

Array = np.ndarray
BEHIND = 50  # periods: a plant that cannot keep up gives up the rest


class PlantLike(Protocol):
    """The interface of a plant: it moves one period at a time under a command that is held."""

    period: float  # s, of its frames
    time: float  # s, on its own clock
    arc_length: Any  # (S,) m, of the points along the body; for `prepare_plant`
    # rides: bool, may be left out: whether its points ride on the body as it stretches, as markers do

    def advance(self, command: Any) -> Any:
        """Hold commands (C,) [Pa] for a period; (1,) of 0 is no pressure in any of several chambers.

        Returns (time of the shape [s], shape (S, 2) [m] in the base frame, a lost point NaN, pressures (C,) [Pa]; a
        number is enough for one).
        """


class VirtualActuator:
    """Source and sink of a plant that moves as the clock does, and vents when a command has held its time.

    Parameters
    ----------
    plant : PlantLike
        E.g. `pliant.testbed.plant.Plant`.
    clock : Clock
    unit : str
        SI unit of the plant's inputs: "Pa", of tendons "N", "m" or "rad".

    Attributes
    ----------
    behind : int
        Periods that the plant left out because it was slower than the clock.
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
        """Move the plant to the present, then the oldest reading."""
        now = self._clock.now()
        owed = (now - self._done) // self._period
        if owed > BEHIND:
            self.behind += owed - BEHIND
            self._done += (owed - BEHIND) * self._period
        while self._done + self._period <= now:
            self._done += self._period
            if self._until is not None and self._done > self._until:
                self._command, self._until = 0.0 * self._command, None  # nobody has commanded since
            taken, shape, pressure = self.plant.advance(self._command)
            self._queue.append(sample(PRESSURE, pressure, self._done, self._unit))
            self._queue.append(sample(SHAPE, shape, self._start + nanoseconds(taken - self._begin)))
        return self._queue.popleft() if self._queue else None

    def write(self, sample: Sample) -> None:
        """Hold a command from now on."""
        if sample.name == COMMAND:
            self._command = sample.array
            self._until = self._clock.now() + nanoseconds(sample.hold) if sample.hold else None

    def close(self) -> None:
        """Nothing is held."""
        self.finished = True
