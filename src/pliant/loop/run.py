"""The loop: read, estimate, check, control, write, log; every period, whatever happens."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from pliant.loop.clock import Clock, Timing
from pliant.loop.log import LoopLog
from pliant.loop.sample import COMMAND, PRESSURE, SHAPE, Sample, Sink, Source, nanoseconds, sample
from pliant.loop.watchdog import Watchdog

Array = np.ndarray
MOST = 256  # samples read in one period: a flood cannot hold up the loop
COLUMNS = (
    "time_s", "shape_time_s", "pressure_pa", "command_pa", "target_m", "error_m", "vented", "work_us", "lateness_us",
)


class EstimatorLike(Protocol):
    """What turns shapes into a state; `drive(time_s, pressure)` and `consistent` are used where they exist."""

    def update(self, time_s: float, measurement: Array) -> tuple[Array, Array]:
        """Absolute link angles and rates (n,), rad and rad/s."""


class ControllerLike(Protocol):
    """What turns a state into a command."""

    def step(self, time_s: float, angle: Array, rate: Array, pressure: float) -> float:
        """Command for the coming period, Pa."""


class ControlLoop:
    """A control loop of fixed period with a watchdog.

    A fault of any kind, an exception of the estimator or the controller included, sends a command of 0 Pa in the period
    in which it is seen, and from then on.

    Parameters
    ----------
    sources : sequence of Source
        Of samples named "shape" (S, 2) [m] and "pressure" [Pa].
    sink : Sink
        Takes samples named "command" [Pa].
    estimator, controller : EstimatorLike, ControllerLike
    watchdog : Watchdog
    period : float
        s
    clock : Clock
    log : LoopLog, optional
        With the columns `COLUMNS`, then phi_1 ... phi_n.

    Attributes
    ----------
    timing : Timing
    frames, lost, late : int
        Whole shapes, shapes with missing points, and shapes older than one seen before: the last two are not used.

    Examples
    --------
    >>> clock = SystemClock()  # doctest: +SKIP
    >>> arm = VirtualActuator(plant, clock)  # doctest: +SKIP
    >>> loop = ControlLoop([arm], arm, estimator, controller, Watchdog(Bounds(220e3)), 4e-3, clock)  # doctest: +SKIP
    >>> loop.run(duration=2.0)  # doctest: +SKIP
    """

    def __init__(
        self, sources: Sequence[Source], sink: Sink, estimator: EstimatorLike, controller: ControllerLike,
        watchdog: Watchdog, period: float, clock: Clock, log: LoopLog | None = None,
    ) -> None:
        self.sources, self.sink, self.estimator, self.controller = list(sources), sink, estimator, controller
        self.watchdog, self.clock, self.log = watchdog, clock, log
        self.timing = Timing(nanoseconds(period))
        self.frames = self.lost = self.late = 0
        self.command, self.pressure = 0.0, 0.0
        self._shape_time = self._pressure_time = self._seen = clock.now()
        self._began = clock.now()
        self._state: tuple[Array, Array] | None = None

    @property
    def finished(self) -> bool:
        """Whether all sources have ended."""
        return all(source.finished for source in self.sources)

    def run(self, duration: float | None = None) -> str:
        """Run for `duration` [s], or until the sources end; returns the watchdog's fault, empty when there was none.

        Whatever ends the run, the last command is 0.
        """
        deadline = self.clock.now()
        stop = None if duration is None else deadline + nanoseconds(duration)
        try:
            while (stop is None or deadline < stop) and not self.finished:
                self.clock.sleep_until(deadline)
                began = self.clock.now()
                self.timing.begin(deadline, began)
                self.period(began, deadline)
                deadline = self.timing.end(began, deadline, self.clock.now())
        finally:
            self.sink.write(sample(COMMAND, 0.0, self.clock.now()))
        return self.watchdog.fault

    def period(self, now: int, deadline: int) -> None:
        """One period that begins at `now` [ns]."""
        try:
            self._read()
            self.watchdog.readings(now, self._shape_time, self._pressure_time, self.pressure)
            wish = self._control(now)
        except Exception as error:  # noqa: BLE001  whatever it is, the pressure must go
            self.watchdog.trip(f"{type(error).__name__}: {error}", now)
            wish = 0.0
        self.command = self.watchdog.command(now, wish)
        self.sink.write(sample(COMMAND, self.command, now))
        if self.log is not None:
            self._write(self.log, now, deadline)

    def _control(self, now: int) -> float:
        if self._state is None or self.watchdog.fault:
            return 0.0
        self.watchdog.estimate(now, *self._state, bool(getattr(self.estimator, "consistent", True)))
        if self.watchdog.fault:
            return 0.0
        return float(self.controller.step((now - self._began) * 1e-9, *self._state, self.pressure))

    def _read(self) -> None:
        for source in self.sources:
            for _ in range(MOST):
                arrived = source.read()
                if arrived is None:
                    break
                self._take(arrived)

    def _take(self, arrived: Sample) -> None:
        """Shapes go to the estimator in the order of their times; a pressure is in force until the next one."""
        if arrived.name == PRESSURE:
            self.pressure, self._pressure_time = float(arrived.array[0]), max(self._pressure_time, arrived.time_ns)
            return
        if arrived.name != SHAPE:
            return
        if arrived.time_ns <= self._seen:
            self.late += 1
            return
        self._seen = arrived.time_ns
        if hasattr(self.estimator, "drive"):
            self.estimator.drive(arrived.time, self.pressure)
        if np.isfinite(arrived.array).all():
            self.frames += 1
            self._shape_time = arrived.time_ns
        else:
            self.lost += 1
            if self._state is None or not hasattr(self.estimator, "drive"):
                return  # an estimator that does not predict is not shown what is not there
        self._state = self.estimator.update(arrived.time, arrived.array)

    def _write(self, log: LoopLog, now: int, deadline: int) -> None:
        angle = self._state[0] if self._state is not None else np.full(len(log.columns) - len(COLUMNS), np.nan)
        target = getattr(self.controller, "target", np.nan)
        error = getattr(self.controller, "error", np.nan)
        log.write((
            now * 1e-9, self._shape_time * 1e-9, self.pressure, self.command, target, error, bool(self.watchdog.fault),
            (self.clock.now() - now) * 1e-3, (now - deadline) * 1e-3, *angle,
        ))

    def summary(self) -> dict[str, float | str]:
        """Counters of the loop, its frames and its fault."""
        counted: dict[str, float | str] = {**self.timing.summary()}
        counted |= {"frames": self.frames, "frames_lost": self.lost, "frames_late": self.late}
        counted |= {"fault": self.watchdog.fault, "fault_time_s": self.watchdog.fault_time * 1e-9}
        return counted
