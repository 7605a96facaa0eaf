"""Rehearsal: simulation of a designed control loop on its own model with all limits, before it controls a real
actuator.

Stability margins describe a linear loop. A command that meets a limit of pressure or slew acts later and less than the
law expects, so that the loop may oscillate and become unstable. The rehearsal simulates the task, then a disturbance as
large as the task's largest displacement.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple
from warnings import catch_warnings, simplefilter

import numpy as np

from pliant.control.contract import Pipeline
from pliant.control.model_plant import ModelPlant
from pliant.control.plan import Task
from pliant.control.tuning import Limits
from pliant.control.valve import SupplyValve
from pliant.errors import InputError, SimulationError
from pliant.model import Model
from pliant.simulation.balance import EnergyWarning
from pliant.units import in_words

Array = np.ndarray
LEAST_BAND = 1e-4  # m, least width of the band within which outputs have settled
QUIET = 0.4  # s for which the outputs must stay in the band
LONGEST = 3.0  # s, longest settling time, plus the time that the slew limit needs to the highest pressure
STEP = 1e-3  # s, longest time step of the model
RAISES = tuple(2.0**k for k in range(11))  # factors of the task's effort weight to try


BAND = 0.02  # fraction of a step within which the tip has settled
STAYS = 0.2  # fraction of a set-point's duration for which the tip must stay settled at its end
STILL_S = 0.5  # s after the last change of the target, from which the command is taken as at rest


def settling_time(time: Array, tip: Array, wanted: float, step: float) -> float | None:
    """Return the settling time [s] of the tip after a step of its target, or None if the tip does not settle. From this
    time on the tip deviates from the target by at most 2 % of the step.

    Parameters
    ----------
    time : array (T,)
        Times [s], from the set-point's beginning to its end.
    tip : array (T,)
        Displacement of the tip along its path [m].
    wanted, step : float
        Target displacement, and its difference from the previous one [m].

    Returns
    -------
    float or None
        None also when the tip is within 2 % for less than the last fifth of the time: it may only pass the target then.
    """
    outside = np.flatnonzero(~(np.abs(tip - wanted) <= BAND * abs(step)))
    if not outside.size:
        return 0.0
    if outside[-1] + 1 >= time.size:
        return None
    since = float(time[outside[-1] + 1] - time[0])
    return since if float(time[-1] - time[0]) - since >= STAYS * float(time[-1] - time[0]) else None


def settling_times(time: Array, tip: Array, points: Sequence[tuple[float, float]]) -> list[float | None]:
    """Return the settling time [s] of the tip after each change of the set-point in a run. It is None where the tip
    does not settle. A set-point is a pair (time [s], displacement [m]).

    The first step begins at 0 m.

    Each set-point lasts up to the next one.
    """
    times, before = [], 0.0
    ends = [*(t for t, _ in points[1:]), np.inf]
    for (begin, wanted), end in zip(points, ends[: len(points)], strict=True):
        during = (time >= begin) & (time < end)
        if wanted != before and during.sum() > 1:
            times.append(settling_time(time[during], tip[during], wanted, wanted - before))
        before = wanted
    return times


def command_activity(time: Array, wanted: Array, command: Array) -> dict[str, float]:
    """Return three measures [Pa] of how much a command changes: its root-mean-square change per control period while
    the target is at rest, the same while the target moves, and its standard deviation while the target is at rest.

    Parameters
    ----------
    time, wanted, command : arrays (T,)
        Times [s], target displacement [m] and command [Pa]. A period counts as at rest from `STILL_S` after the last
        change of the target.

    Returns
    -------
    dict
        ``command_change_rest``, ``command_change_motion``: root mean square [Pa] of the change from one period to the
        next; ``command_sd_rest``: standard deviation [Pa] at rest, about the mean of each interval of rest. NaN where
        a run has no such interval.
    """
    changed = np.append(True, np.diff(wanted) != 0.0)
    last = np.maximum.accumulate(np.where(changed, time, -np.inf))
    rest = time - last >= STILL_S
    step = np.diff(command)
    still = rest[1:] & rest[:-1]
    part = np.cumsum(np.append(False, np.diff(rest.astype(int)) > 0))  # which rest
    about = [command[rest & (part == k)] for k in np.unique(part[rest])]
    return {
        "command_change_rest": rms(step[still]), "command_change_motion": rms(step[~still]),
        "command_sd_rest": rms(np.concatenate([c - c.mean() for c in about])) if about else float("nan"),
    }


def rms(x: Array) -> float:
    """Return the root mean square of the array `x`, or NaN if it is empty."""
    return float(np.sqrt(np.mean(x**2))) if x.size else float("nan")


class RehearsalSetting(NamedTuple):
    """The simulated plant of a rehearsal: model, valves, control period and delay.

    Attributes
    ----------
    body : Model
        Model with its hysteresis and the mean of the rig's valves.
    arc_length : array (S,)
        Arc lengths [m] of the shape's points.
    supply : tuple of SupplyValve or None
        The rig's valve of each chamber; None to use the model's.
    period : float
        Control period [s].
    late : int
        Number of periods by which a shape is old when it arrives.
    """

    body: Model
    arc_length: Array
    supply: tuple[SupplyValve | None, ...]
    period: float
    late: int


@dataclass(frozen=True)
class Rehearsal:
    """Simulated response of a designed control loop on its own model, within its limits.

    Attributes
    ----------
    time, error : array (T,)
        Times [s], and distance [m] of the estimated outputs from the set-point or path. An angle is converted to the
        motion of the tip that it makes.
    settling : tuple of float or None
        Settling time [s] of each set-point; None if the outputs do not stay within 2 % of the step until the next one.
    final_error : float
        Largest error [m] over the last 0.4 s, while the end of the task is held.
    disturbance : float
        Distance [m] by which the outputs were displaced afterwards.
    recovery : float or None
        Time [s] after which the outputs stay within the band again; None if they do not.
    band : float
        Settling band [m]: 2 % of the largest displacement of the task, at least 0.1 mm.
    saturated : int
        Number of periods in which a limit changed the command.
    effort, wanted_effort : float
        Effort weight of the rehearsed design, and that of the task.
    limits : Limits
    unit : str
        Of the commands, SI.
    """

    time: Array
    error: Array
    settling: tuple[float | None, ...]
    final_error: float
    disturbance: float
    recovery: float | None
    band: float
    saturated: int
    effort: float
    wanted_effort: float
    limits: Limits
    unit: str = "Pa"

    @property
    def settles(self) -> bool:
        """Whether the simulated outputs settle at the end of the task, and again after the disturbance."""
        return self.final_error <= self.band and self.recovery is not None

    @property
    def summary(self) -> dict[str, float]:
        """Main numbers of the rehearsal by name: settling time, final error, recovery time and effort weight."""
        times = [np.inf if t is None else t for t in self.settling]
        return {
            **({"rehearsed_settling_s": float(max(times))} if times else {}),
            "rehearsed_error_mm": 1e3 * self.final_error,
            "rehearsed_recovery_s": np.inf if self.recovery is None else self.recovery, "effort_weight": self.effort,
        }

    def __str__(self) -> str:
        times = ", ".join("not before the next one" if t is None else f"{t:.3g} s" for t in self.settling)
        back = "not settled again" if self.recovery is None else f"settled again after {self.recovery:.3g} s"
        lines = [
            f"rehearsed on the model within {range_of(self.limits, self.unit)}: "
            + (f"set-points settle after {times}; " if self.settling else "")
            + f"error {self.final_error * 1e3:.3g} mm at the end; displaced by {self.disturbance * 1e3:.3g} mm: {back}"
        ]
        if self.effort != self.wanted_effort:
            lines.append(
                f"the effort weight was raised from {self.wanted_effort:g} to {self.effort:g}: with a lower weight "
                "the loop does not settle at these limits, whatever its margins"
            )
        return "\n".join(lines)


class Rehearsed:
    """Simulation of a control pipeline on the model of the actuator, period by period.

    Parameters
    ----------
    pipeline : Pipeline
        Pipeline whose estimator and controller are in their initial state.
    setting : RehearsalSetting
    wanted : callable
        Function that returns the target of the outputs (m,) [m] at a time [s].
    weight : array (m,)
        Length [m] that a unit of each output counts as.
    """

    def __init__(
        self, pipeline: Pipeline, setting: RehearsalSetting, wanted: Callable[[float], Array], weight: Array
    ) -> None:
        self.pipeline, self.period, self.late = pipeline, setting.period, setting.late
        self._wanted, self._weight = wanted, weight
        self.plant = ModelPlant(
            setting.body, period=setting.period, noise=0.0,
            time_step=setting.period / np.ceil(setting.period / STEP - 1e-9),
            pressure_noise=0.0, supply=setting.supply, arc_length=setting.arc_length,
        )
        self._shapes = deque([self.plant.points()] * (setting.late + 1))
        self._command = np.zeros(pipeline.controller.chambers)
        self.start = self.farthest = self.plant.position
        self.error: list[float] = []

    @property
    def time(self) -> float:
        """Present time [s] of the simulation."""
        return len(self.error) * self.period

    def go(self, periods: int) -> None:
        """Simulate the control loop for the given number of further periods."""
        measure, estimator, controller, _ = self.pipeline
        for _ in range(periods):
            now = self.time
            _, shape, pressure = self.plant.advance(self._command)
            self._shapes.append(shape)
            estimator.push_pressure(now, pressure)
            estimator.push_frame(now - self.late * self.period, *measure(self._shapes.popleft()))
            self._command = controller.step(now, estimator.state(now), pressure)
            reached = self._weight * (np.asarray(controller.target) + controller.error)
            self.error.append(float(np.linalg.norm(reached - self._wanted(now))))
            if np.abs(self.plant.position - self.start).max() > np.abs(self.farthest - self.start).max():
                self.farthest = self.plant.position

    def displace(self) -> None:
        """Displace the simulated actuator instantly to its start or its farthest position,
        whichever is farther away.
        """
        now = self.plant.position
        ends = (self.start, self.farthest)
        self.plant.displace(max((end - now for end in ends), key=lambda change: float(np.abs(change).max())))

    def wait(self, band: float, longest: float) -> float | None:
        """Simulate until the control error has been within `band` [m] for 0.4 s. Return the time [s] after which it
        stayed within the band, or None if it does not settle.

        Returns None if the error is not within the band after `longest` [s].
        """
        first, quiet = len(self.error), round(QUIET / self.period)
        self.go(quiet)
        while len(self.error) - first < round(longest / self.period) + quiet:
            outside = np.flatnonzero(~(np.array(self.error[first:]) <= band))
            inside = outside[-1] + 1 if outside.size else 0
            if len(self.error) - first - inside >= quiet:
                return float(inside * self.period)
            self.go(max(quiet - (len(self.error) - first - inside), 1))
        return None


def rehearse(pipeline: Pipeline, setting: RehearsalSetting, task: Task, limits: Limits, weight: Array) -> Rehearsal:
    """Simulate the control task, then a displacement of the actuator by a disturbance, each until the outputs have
    settled.

    Parameters
    ----------
    pipeline : Pipeline
        Pipeline whose estimator and controller are in their initial state.
    setting : RehearsalSetting
    task : Task
    limits : Limits
    weight : array (m,)
        Length [m] that a unit of each output counts as.

    Returns
    -------
    Rehearsal
        The response. If the simulation fails, it counts as not settling.
    """
    levels = np.asarray(task.displacement, dtype=float).reshape(len(task.time), -1) * weight
    band = max(BAND * float(np.linalg.norm(levels, axis=1).max()), LEAST_BAND)
    longest = LONGEST + limits.highest / limits.slew
    begins, first_level = np.asarray(task.time, dtype=float), np.zeros_like(levels[:1])

    def wanted(time: float) -> Array:
        if task.path:
            return np.array([np.interp(time, begins, column) for column in levels.T])
        return np.concatenate([first_level, levels])[np.searchsorted(begins, time + 1e-9, side="right")]

    run, final, disturbance, recovery = Rehearsed(pipeline, setting, wanted, weight), np.inf, 0.0, None
    settling: tuple[float | None, ...] = ()
    try:
        with catch_warnings():
            simplefilter("ignore", EnergyWarning)  # an unstable loop moves too fast for the time step
            run.go(round(task.duration / setting.period))
            resting = run.wait(band, longest)
            final = float(np.max(run.error[-round(QUIET / setting.period) :]))
            settling = () if task.path else settling_of(np.array(run.error), setting.period, task.time, levels)
            if resting is not None:
                run.displace()
                first = len(run.error)
                recovery = run.wait(band, longest)
                disturbance = float(np.max(run.error[first:]))
    except SimulationError:
        final = np.inf
    error = np.array(run.error)
    return Rehearsal(
        np.arange(error.size) * setting.period, error, settling, final, disturbance, recovery, band,
        pipeline.controller.saturated, task.tuning.effort, task.tuning.effort, limits, setting.body.actuation.units[0],
    )


def range_of(limits: Limits, unit: str) -> str:
    """Return the range of the commands and their slew limit as text with units, such as "0 ... 190
    kPa and 500 kPa/s".
    """
    slew = "" if np.isinf(limits.slew) else f" and {in_words(limits.slew, unit)}/s"
    return f"0 ... {in_words(limits.highest, unit)}{slew}"


def settling_of(error: Array, period: float, begins: Array, levels: Array) -> tuple[float | None, ...]:
    """Return the settling time [s] after each change of the set-point, computed from the control errors (T,) [m] in T
    periods. It is None where the outputs do not settle.

    `begins` (k,) [s] and `levels` (k, m) [m] are the times and targets of the task.
    """
    time, steps = np.arange(error.size) * period, np.linalg.norm(np.diff(levels, axis=0, prepend=0.0), axis=1)
    settling = []
    for begin, end, step in zip(begins, [*begins[1:], np.inf], steps, strict=True):
        during = (time >= begin) & (time < end)
        if step > 0.0 and during.sum() > 1:
            settling.append(settling_time(time[during], error[during], 0.0, max(step, LEAST_BAND / BAND)))
    return tuple(settling)


def limit_aware(
    make: Callable[[Task], Pipeline], setting: RehearsalSetting, task: Task, limits: Limits, weight: Array, *,
    tunable: bool,
) -> tuple[Task, Rehearsal]:
    """Find the smallest effort weight, of 1, 2, 4 ... 1024 times the task's, with which the simulated control loop
    settles.

    Returns the task with this weight, and its rehearsal.

    Parameters
    ----------
    make : callable
        Function that returns the pipeline for a task, in its initial state.
    setting, task, limits, weight
        See `rehearse`.
    tunable : bool
        Whether the effort weight affects the controller. If not, it is rehearsed once.

    Raises
    ------
    InputError
        When the loop settles with none of the weights.
    """
    for factor in RAISES if tunable else RAISES[:1]:
        tuned = replace(task, tuning=replace(task.tuning, effort=factor * task.tuning.effort))
        trial = rehearse(make(tuned), setting, tuned, limits, weight)
        if trial.settles:
            return tuned, replace(trial, wanted_effort=task.tuning.effort)
    within = range_of(limits, setting.body.actuation.units[0])
    tried = f"any effort weight from {task.tuning.effort:g} to {trial.effort:g}" if tunable else "its present tuning"
    raise InputError(
        f"the loop does not settle in a simulation of its own model, with commands of {within} and {tried}: it ends "
        f"{trial.final_error * 1e3:.3g} mm from its target ({trial.band * 1e3:.3g} mm allowed); allow faster changes "
        "of the command, command smaller steps, or fit a model with more damping"
    )
