"""The control loop: in each period it reads sensors, estimates the state, checks it, and sends and logs a command."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence

import numpy as np

from pliant.control.contract import Pipeline
from pliant.errors import InputError
from pliant.estimation.contract import State
from pliant.loop.clock import Clock, Timing
from pliant.loop.log import LoopLog
from pliant.loop.sample import COMMAND, PRESSURE, SHAPE, Sample, Sink, Source, nanoseconds, sample
from pliant.loop.watchdog import Watchdog, ended_by_signals
from pliant.text import escaped
from pliant.units import KIND_OF, METRE, NEWTON, PASCAL, RADIAN

Array = np.ndarray
MOST = 256  # most samples read in one period, so that a flood cannot delay the loop
HOLD_PERIODS, LEAST_HOLD = 5, 0.02  # periods and least time [s] for which a command is held without a newer one
STREAMS = ("shapes", "pressures")
COLUMNS = (
    "time_s", "shape_time_s", "pressure_pa", "command_pa", "target_m", "error_m", "vented", "work_us", "lateness_us",
)


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


def log_columns(links: int, chambers: int = 1, outputs: Sequence[str] = (), unit: str = "Pa") -> list[str]:
    """Return the column names of a loop's log for `links` links and `chambers` chambers.

    They are `COLUMNS`, with pressure and command for each chamber, and with target and error for each of `outputs`,
    such as tip_x or angle_sum. The angle, the disturbance torque and its standard deviation of each joint follow. The
    disturbance torques are NaN if the estimator does not compute them. In space `links` is the number of joint
    coordinates, which take the place of the angles. `unit` is that of the inputs: those of tendons are named tension,
    displacement or angle, in N, m or rad.
    """
    names, ending = list(COLUMNS), unit.lower()
    for name, word in (("command_pa", "command"), ("pressure_pa", KIND_OF[unit])):
        k = names.index(name)
        each_input = [f"_{c + 1}" for c in range(chambers)] if chambers > 1 else [""]
        names[k : k + 1] = [f"{word}{number}_{ending}" for number in each_input]
    if outputs:
        units = {"angle_sum": "rad"}
        for name in ("target", "error"):
            k = names.index(f"{name}_m")
            names[k : k + 1] = [f"{name}_{output}_{units.get(output, 'm')}" for output in outputs]
    each = ("phi_{}_rad", "torque_{}_nm", "torque_sd_{}_nm")
    return [*names, *(name.format(i + 1) for name in each for i in range(links))]


def unexplained(state: State | None, links: int) -> tuple[Array, Array, Array]:
    """Return three arrays (n,) for the n links of an estimated state: angles [rad], disturbance torques [N m] and their
    standard deviations [N m].

    Without a state, or with an estimator that does not compute disturbances, the missing values are NaN.
    """
    none = np.full(links, np.nan)
    if state is None:
        return none, none, none
    first = 2 * (links + len(state.strain))  # strains stand behind the angles, and behind the rates
    if len(state.covariance) <= first:
        return state.angle, none, none
    return state.angle, state.disturbance, np.sqrt(np.diag(state.covariance)[first : first + links])


class ControlLoop:
    """A control loop with a fixed period and a watchdog.

    After a fault of any kind, including an exception of the estimator or controller, the command is 0 Pa from the same
    period on. Every command carries a hold time, so that a receiver vents when this program has ended
    (`ValveReceiver`).

    Parameters
    ----------
    sources : sequence of Source
        Sources of samples named "shape", (S, 2) or in space (S, 3) [m], and "pressure" [Pa].
    sink : Sink
        Sink that receives samples named "command" [Pa].
    pipeline : Pipeline
        Measurement, estimator and controller, which turn a shape into a command.
    watchdog : Watchdog
    period : float
        Period of the loop [s].
    clock : Clock
    log : LoopLog, optional
        Log with the columns `log_columns`.
    log_needed : bool
        If True, the loop vents when the log cannot be written, e.g. on a full disk. Default: the loop goes on and
        reports it.

    Attributes
    ----------
    timing : Timing
    frames, lost : int
        Number of complete shapes, and of shapes with missing points.
    shapes, pressures : Stream
        Incoming readings, with the counts of those that were rejected.
    hold : float
        Hold time [s] of each command.
    chambers_left_out, pressures_left_out : int
        Largest number of surplus chambers in a pressure sample, and total number of surplus pressures.

    Examples
    --------
    >>> clock = SystemClock()  # doctest: +SKIP
    >>> arm = VirtualActuator(plant, clock)  # doctest: +SKIP
    >>> ready = prepare_control(model, plant.arc_length, frames, task, limits, 4e-3)  # doctest: +SKIP
    >>> loop = ControlLoop([arm], arm, ready.pipeline, Watchdog(Bounds(220e3)), 4e-3, clock)  # doctest: +SKIP
    >>> loop.run(duration=2.0)  # doctest: +SKIP
    """

    def __init__(
        self, sources: Sequence[Source], sink: Sink, pipeline: Pipeline, watchdog: Watchdog, period: float,
        clock: Clock, log: LoopLog | None = None, *, log_needed: bool = False,
    ) -> None:
        self.sources, self.sink, self.pipeline = list(sources), sink, pipeline
        self.watchdog, self.clock, self.log = watchdog, clock, log
        self.timing = Timing(nanoseconds(period))
        self.frames = self.lost = 0
        self.hold, self._log_needed, self._log_told = max(HOLD_PERIODS * period, LEAST_HOLD), log_needed, False
        self.chambers_left_out = self.pressures_left_out = 0
        self._vent = np.zeros(pipeline.controller.chambers)  # Pa, the command that vents
        self._vent.setflags(write=False)
        self.command = self.pressure = self._vent
        self._began = clock.now()
        self.shapes, self.pressures = streams(
            nanoseconds(watchdog.bounds.clock_skew), self._began, pipeline.axes, watchdog.bounds.unit
        )
        self._state: State | None = None
        self._fault_told = False

    @property
    def finished(self) -> bool:
        """Whether all sources have ended."""
        return all(source.finished for source in self.sources)

    def run(self, duration: float | None = None) -> str:
        """Run the loop for `duration` [s], or until the sources end; return a description of the fault, or "".

        The description is the reason why the watchdog vented or, if it did not, the periods in which the controller
        reported a fault.

        Whatever ends the run (the time, an exception, any signal that can be caught), the last command is 0. After a
        SIGKILL, a crash or a power loss the receiver vents within `hold`.
        """
        deadline = self.clock.now()
        stop = None if duration is None else deadline + nanoseconds(duration)
        with ended_by_signals():
            try:
                while (stop is None or deadline < stop) and not self.finished:
                    self.clock.sleep_until(deadline)
                    began = self.clock.now()
                    self.timing.begin(deadline, began)
                    self.period(began, deadline)
                    deadline = self.timing.end(began, deadline, self.clock.now())
            finally:
                self.command = self._vent
                self._send(self.clock.now())
        return self.watchdog.summary[0]

    def period(self, now: int, deadline: int) -> None:
        """Run one period of the control loop, which starts at `now` [ns] and was due at `deadline` [ns]."""
        try:
            self._read()
            self.watchdog.stalled(now, self.clock.now(), "reading the sources and updating the estimator")
            self.watchdog.readings(now, self.shapes.reference_time, self.pressures.reference_time, self.pressure)
            self.watchdog.frozen(now, self.shapes.repeats, self.pressures.repeats)
            self._check_log(now)
            wish = self._control(now)
        except Exception as error:  # noqa: BLE001  after any error the pressure must be released
            self.watchdog.trip(f"{type(error).__name__}: {error}", now)
            wish = self._vent
        self.command = self.watchdog.command(now, wish)
        ready = self.clock.now()
        self._send(now)
        if self.log is not None:
            self._write(self.log, now, deadline)
        self.watchdog.stalled(ready, self.clock.now(), "sending the command and logging")

    def _send(self, now: int) -> None:
        self.sink.write(sample(COMMAND, self.command, now, self.watchdog.bounds.unit, self.hold))

    def _check_log(self, now: int) -> None:
        """Report once that the log cannot be written, and vent if the log is needed."""
        if self.log is None or not self.log.fault or self._log_told:
            return
        self._log_told = True
        logging.getLogger(__name__).error("%s", escaped(self.log.fault, "line"))
        if self._log_needed:
            self.watchdog.trip(self.log.fault, now)

    def _control(self, now: int) -> Array:
        if not self.frames or self.watchdog.fault:
            return self._vent
        began = self.clock.now()
        self._state = self.pipeline.estimator.state(now * 1e-9)
        began = self.watchdog.stalled(began, self.clock.now(), "the estimator")
        self.watchdog.estimate(now, self._state)
        if self.watchdog.fault:
            return self._vent
        controller = self.pipeline.controller
        commands = controller.step((now - self._began) * 1e-9, self._state, self.pressure)
        self.watchdog.stalled(began, self.clock.now(), "the controller")
        wish = np.array(commands, dtype=float, ndmin=1)  # another package's controller may give a number
        if np.size(wish) != controller.chambers:
            raise InputError(f"the controller returned {np.size(wish)} command(s) for {controller.chambers} "
                             "chamber(s): its step must return one command for each")
        if self.watchdog.controller(now, controller.fault) and self.log is not None:
            self.log.remark(f"fault at {now * 1e-9:.3f} s: {controller.fault}")
        return wish

    def _read(self) -> None:
        for source in self.sources:
            for _ in range(MOST):
                arrived = source.read()
                if arrived is None:
                    break
                self._take(arrived)

    def _take(self, arrived: Sample) -> None:
        """Pass a new sample on: shapes and pressures to the estimator, in the order of their arrival."""
        now = self.clock.now()
        if arrived.name == PRESSURE:
            taken = self.pressures.accept(arrived, now)
            if taken is not None:
                self._take_pressure(arrived, taken, now)
            return
        if arrived.name != SHAPE or (shape := self.shapes.accept(arrived, now)) is None:
            return
        frame = self.pipeline.measure(shape)
        if np.isfinite(frame.values).all():
            self.frames += 1
            self.shapes.mark_complete(now)
        else:
            self.lost += 1
        self.pipeline.estimator.push_frame(arrived.time, *frame)

    def _take_pressure(self, arrived: Sample, taken: Array, now: int) -> None:
        chambers, came = self.pipeline.controller.chambers, taken.size
        if came < chambers:
            raise InputError(f"a pressure sample has {came} chamber(s), the controller needs {chambers}: send a "
                             "pressure for each chamber")
        if came > chambers:
            self.chambers_left_out = max(self.chambers_left_out, came - chambers)
            self.pressures_left_out += came - chambers
        pressures = self.pressure = taken[:chambers]
        self.watchdog.pressure(now, self.pressure)  # check each sample: a good one may follow in the same period
        if np.isfinite(pressures).all():
            self.pressures.mark_complete(now)
            self.pipeline.estimator.push_pressure(arrived.time, self.pressure)

    def _write(self, log: LoopLog, now: int, deadline: int) -> None:
        links = sum(name.startswith("phi_") for name in log.columns)
        estimated = np.concatenate(unexplained(self._state, links))
        each = estimated[: 3 * links if any(name.startswith("torque_") for name in log.columns) else links]
        if self.watchdog.fault and not self._fault_told:
            self._fault_told = True
            log.remark(f"fault at {self.watchdog.fault_time * 1e-9:.3f} s: {self.watchdog.fault}")
        controller = self.pipeline.controller
        log.write((
            now * 1e-9, self.shapes.stamp * 1e-9, *self.pressure, *self.command, *np.ravel(controller.target),
            *np.ravel(controller.error), bool(self.watchdog.fault), (self.clock.now() - now) * 1e-3,
            (now - deadline) * 1e-3, *each,
        ))

    def summary(self) -> dict[str, float | str]:
        """Return timing statistics, counts of samples and the fault as a dict."""
        counted: dict[str, float | str] = {**self.timing.summary()}
        counted |= {"frames": self.frames, "frames_lost": self.lost, "frames_late": self.shapes.late}
        for name, stream in zip(STREAMS, (self.shapes, self.pressures), strict=True):
            numbers = {"rejected": stream.rejected, "ahead": stream.ahead}
            numbers |= {"late": stream.late} if name == "pressures" else {}
            counted |= {f"{name}_{what}": count for what, count in numbers.items() if count}
        if self.log is not None and (self.log.fault or self.log.dropped):
            problem = self.log.fault or f"the log {self.log.path} lost rows: the disk fell behind"
            counted |= {"log_fault": problem, "log_rows_missing": self.log.dropped}
        if self.pressures_left_out:
            counted |= {"chambers_left_out": self.chambers_left_out, "pressures_left_out": self.pressures_left_out}
        if self.watchdog.controller_faults:
            counted |= {"controller_faults": self.watchdog.controller_faults}
        fault, since = self.watchdog.summary
        return counted | {"fault": fault, "fault_time_s": since * 1e-9}
