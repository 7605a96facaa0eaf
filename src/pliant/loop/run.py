"""The loop: read, estimate, check, control, write, log; every period, whatever happens."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from pliant.control.contract import Pipeline
from pliant.errors import InputError
from pliant.estimation.contract import State
from pliant.loop.clock import Clock, Timing
from pliant.loop.endings import ended_by_signals
from pliant.loop.intake import streams
from pliant.loop.log import LoopLog
from pliant.loop.sample import COMMAND, PRESSURE, SHAPE, Sample, Sink, Source, nanoseconds, sample
from pliant.loop.watchdog import Watchdog
from pliant.text import escaped
from pliant.units import KIND_OF

Array = np.ndarray
MOST = 256  # samples read in one period: a flood cannot hold up the loop
HOLD_PERIODS, LEAST_HOLD = 5, 0.02  # periods, and s, that a command is in force without a newer one
STREAMS = ("shapes", "pressures")
COLUMNS = (
    "time_s", "shape_time_s", "pressure_pa", "command_pa", "target_m", "error_m", "vented", "work_us", "lateness_us",
)


def log_columns(links: int, chambers: int = 1, outputs: Sequence[str] = (), unit: str = "Pa") -> list[str]:
    """Columns of a loop's log: `COLUMNS`, pressure and command once for each chamber, angles, torques of touch.

    Target and error stand once for each output that several chambers bring to its place, such as tip_x or angle_sum.

    `unit` is that of the inputs: what tendons take is named tension, displacement or angle, in N, m or rad.
    The torques are those of each joint that the model does not explain, with their standard deviation: of an estimator
    that finds them, NaN otherwise. In space `links` is the number of joint coordinates, which stand for the angles.
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
    """Angles [rad], torques that the model does not explain and their standard deviations [N m], (n,) each."""
    none = np.full(links, np.nan)
    if state is None:
        return none, none, none
    first = 2 * (links + len(state.strain))  # strains stand behind the angles, and behind the rates
    if len(state.covariance) <= first:
        return state.angle, none, none
    return state.angle, state.disturbance, np.sqrt(np.diag(state.covariance)[first : first + links])


class ControlLoop:
    """A control loop of fixed period with a watchdog.

    A fault of any kind, an exception of the estimator or the controller included, sends a command of 0 Pa in the period
    in which it is seen, and from then on. Every command says how long it holds, so that a receiver vents by itself when
    this program is gone (`ValveReceiver`).

    Parameters
    ----------
    sources : sequence of Source
        Of samples named "shape" (S, 2), in space (S, 3) [m], and "pressure" [Pa].
    sink : Sink
        Takes samples named "command" [Pa].
    pipeline : Pipeline
        From the shape to the command: how a shape is measured, estimator and controller.
    watchdog : Watchdog
    period : float
        s
    clock : Clock
    log : LoopLog, optional
        With the columns `log_columns`.
    log_needed : bool
        Whether a log that stops, on a full disk, vents. Default: the loop goes on, and tells it at once and in the end.

    Attributes
    ----------
    timing : Timing
    frames, lost : int
        Whole shapes, and shapes with missing points: of those the estimator learns at most that they were lost.
    shapes, pressures : Stream
        What arrived, and how much of it was rejected, ahead of its time or late: none of that is used.
    hold : float
        s that a command is in force without a newer one.
    chambers_left_out, pressures_left_out : int
        Most chambers of one pressure sample beyond those that the controller drives, and all such pressures.

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
        """Run for `duration` [s], or until the sources end; returns what went wrong, empty when nothing did.

        That is what made the watchdog vent, or else the periods in which the controller had no command of its own.

        Whatever ends the run, the last command is 0: the time, an exception, and every signal that can be caught. What
        cannot (SIGKILL, a crash, the supply) is the receiver's part: without a newer command it vents within `hold`.
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
        """One period that begins at `now` [ns]."""
        try:
            self._read()
            self.watchdog.readings(now, self.shapes.seen, self.pressures.seen, self.pressure)
            self.watchdog.frozen(now, self.shapes.repeats, self.pressures.repeats)
            self._look_at_log(now)
            wish = self._control(now)
        except Exception as error:  # noqa: BLE001  whatever it is, the pressure must go
            self.watchdog.trip(f"{type(error).__name__}: {error}", now)
            wish = self._vent
        self.command = self.watchdog.command(now, wish)
        self._send(now)
        if self.log is not None:
            self._write(self.log, now, deadline)

    def _send(self, now: int) -> None:
        self.sink.write(sample(COMMAND, self.command, now, self.watchdog.bounds.unit, self.hold))

    def _look_at_log(self, now: int) -> None:
        """Tell a log that has stopped, once, and vent where it is needed."""
        if self.log is None or not self.log.fault or self._log_told:
            return
        self._log_told = True
        logging.getLogger(__name__).error("%s", escaped(self.log.fault, "line"))
        if self._log_needed:
            self.watchdog.trip(self.log.fault, now)

    def _control(self, now: int) -> Array:
        if not self.frames or self.watchdog.fault:
            return self._vent
        self._state = self.pipeline.estimator.state(now * 1e-9)
        self.watchdog.estimate(now, self._state)
        if self.watchdog.fault:
            return self._vent
        controller = self.pipeline.controller
        given = controller.step((now - self._began) * 1e-9, self._state, self.pressure)
        wish = np.array(given, dtype=float, ndmin=1)  # another package's controller may give a number
        if np.size(wish) != controller.chambers:
            raise InputError(f"the controller commands {np.size(wish)} chambers, it drives {controller.chambers}")
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
        """Shapes go to the estimator in the order of their times; a pressure is in force until the next one."""
        now = self.clock.now()
        if arrived.name == PRESSURE:
            taken = self.pressures.take(arrived, now)
            if taken is not None:
                self._take_pressure(arrived, taken, now)
            return
        if arrived.name != SHAPE or (shape := self.shapes.take(arrived, now)) is None:
            return
        frame = self.pipeline.measure(shape)
        if np.isfinite(frame.values).all():
            self.frames += 1
            self.shapes.whole(now)
        else:
            self.lost += 1
        self.pipeline.estimator.push_frame(arrived.time, *frame)

    def _take_pressure(self, arrived: Sample, taken: Array, now: int) -> None:
        chambers, came = self.pipeline.controller.chambers, taken.size
        if came < chambers:
            raise InputError(f"a sample holds the pressures of {came} chambers, the controller drives {chambers}")
        if came > chambers:
            self.chambers_left_out = max(self.chambers_left_out, came - chambers)
            self.pressures_left_out += came - chambers
        kept = self.pressure = taken[:chambers]
        self.watchdog.pressure(now, self.pressure)  # each one: a good one may follow in the same period
        if np.isfinite(kept).all():
            self.pressures.whole(now)
            self.pipeline.estimator.push_pressure(arrived.time, self.pressure)

    def _write(self, log: LoopLog, now: int, deadline: int) -> None:
        links = sum(name.startswith("phi_") for name in log.columns)
        found = np.concatenate(unexplained(self._state, links))
        each = found[: 3 * links if any(name.startswith("torque_") for name in log.columns) else links]
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
        """Counters of the loop, its frames and its fault."""
        counted: dict[str, float | str] = {**self.timing.summary()}
        counted |= {"frames": self.frames, "frames_lost": self.lost, "frames_late": self.shapes.late}
        for name, stream in zip(STREAMS, (self.shapes, self.pressures), strict=True):
            numbers = {"rejected": stream.rejected, "ahead": stream.ahead}
            numbers |= {"late": stream.late} if name == "pressures" else {}
            counted |= {f"{name}_{what}": count for what, count in numbers.items() if count}
        if self.log is not None and (self.log.fault or self.log.dropped):
            said = self.log.fault or f"the log {self.log.path} lost rows: the disk fell behind"
            counted |= {"log_fault": said, "log_rows_missing": self.log.dropped}
        if self.pressures_left_out:
            counted |= {"chambers_left_out": self.chambers_left_out, "pressures_left_out": self.pressures_left_out}
        if self.watchdog.controller_faults:
            counted |= {"controller_faults": self.watchdog.controller_faults}
        fault, since = self.watchdog.summary
        return counted | {"fault": fault, "fault_time_s": since * 1e-9}
