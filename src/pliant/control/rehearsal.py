"""Rehearsal of a designed loop on its own model, with all its limits, before it drives a body.

Stability margins are those of a linear loop: a command that meets a limit of pressure or slew acts later and less than
the law expects, and the loop may then oscillate and grow. The rehearsal shows it: the task, then a disturbance as large
as the task's largest displacement.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple
from warnings import catch_warnings, simplefilter

import numpy as np

from pliant.control.activity import BAND, settling_time
from pliant.control.contract import Pipeline
from pliant.control.limits import Limits
from pliant.control.model_plant import ModelPlant
from pliant.control.plan import Task
from pliant.control.valve import SupplyValve
from pliant.errors import InputError, SimulationError
from pliant.model import Model
from pliant.simulation.balance import EnergyWarning
from pliant.units import in_words

Array = np.ndarray
LEAST_BAND = 1e-4  # m, within which the outputs of a small task have settled
QUIET = 0.4  # s for which they must stay there
LONGEST = 3.0  # s for which they are waited for, and as long again as the slew limit takes to the highest pressure
STEP = 1e-3  # s, longest step of the model
RAISES = tuple(2.0**k for k in range(11))  # times the effort weight of the task


class RehearsalSetting(NamedTuple):
    """The plant of a rehearsal: body, valves, period and delay.

    Attributes
    ----------
    body : Model
        With its memory and the mean of the rig's valve.
    arc_length : array (S,)
        Of the points that the shapes hold, m.
    supply : tuple of SupplyValve or None
        The rig's valve of each chamber, where more is known of it than the model holds.
    period : float
        s
    late : int
        Periods by which a shape is old when it arrives.
    """

    body: Model
    arc_length: Array
    supply: tuple[SupplyValve | None, ...]
    period: float
    late: int


@dataclass(frozen=True)
class Rehearsal:
    """Response of the designed loop on its own model within its limits.

    Attributes
    ----------
    time, error : array (T,)
        s; distance of the outputs, as estimated, from the set-point or the path, m. An angle counts as far as it swings
        the tip.
    settling : tuple of float or None
        Of each set-point, s; None where the outputs do not stay within 2 % of the step until the next one.
    final_error : float
        Largest distance over the last part of the task's end, held, m.
    disturbance : float
        Distance by which the outputs were then displaced at once, m.
    recovery : float or None
        Time after which they stay within the band again, s; None where they do not.
    band : float
        m: 2 % of the largest displacement of the task, at least 0.1 mm.
    saturated : int
        Periods whose command met a limit.
    effort, wanted_effort : float
        Weight of the command in the design that was rehearsed, and in the task.
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
        """Whether the outputs come to rest within the band at the end of the task and after the disturbance."""
        return self.final_error <= self.band and self.recovery is not None

    @property
    def summary(self) -> dict[str, float]:
        """Its numbers for a summary of a run."""
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
                f"the effort weight was raised from {self.wanted_effort:g} to {self.effort:g}: with less the loop "
                "oscillates at these limits, whatever its margins"
            )
        return "\n".join(lines)


class Rehearsed:
    """One run of a pipeline on the model of the body, period by period.

    Parameters
    ----------
    pipeline : Pipeline
        Its estimator and controller are at their beginning.
    setting : RehearsalSetting
    wanted : callable
        Outputs (m,) that the task wants at a time [s], in metres.
    weight : array (m,)
        Metres that a unit of each output counts as.
    """

    def __init__(
        self, pipeline: Pipeline, setting: RehearsalSetting, wanted: Callable[[float], Array], weight: Array
    ) -> None:
        self.pipeline, self.period, self.late = pipeline, setting.period, setting.late
        self._wanted, self._weight = wanted, weight
        self.plant = ModelPlant(
            setting.body, period=setting.period, step=setting.period / np.ceil(setting.period / STEP - 1e-9), noise=0.0,
            pressure_noise=0.0, supply=setting.supply, arc_length=setting.arc_length,
        )
        self._shapes = deque([self.plant.points()] * (setting.late + 1))
        self._command = np.zeros(pipeline.controller.chambers)
        self.start = self.farthest = self.plant.position
        self.error: list[float] = []

    @property
    def time(self) -> float:
        """Time of the run, s."""
        return len(self.error) * self.period

    def go(self, periods: int) -> None:
        """So many periods more."""
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
        """Put the body at once where the run began, or where it was farthest from there, whichever is farther."""
        now = self.plant.position
        ends = (self.start, self.farthest)
        self.plant.displace(max((end - now for end in ends), key=lambda change: float(np.abs(change).max())))

    def wait(self, band: float, longest: float) -> float | None:
        """Seconds from now after which the error stays within the band for `QUIET` s; None if not within `longest`."""
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
    """Simulate the task, hold its last set-point, displace the body in one step, and go on until it has settled.

    Parameters
    ----------
    pipeline : Pipeline
        Its estimator and controller are at their beginning.
    setting : RehearsalSetting
    task : Task
    limits : Limits
    weight : array (m,)
        Metres that a unit of each output counts as.

    Returns
    -------
    Rehearsal
        One that does not settle where the model's motion ends before.
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
            simplefilter("ignore", EnergyWarning)  # a loop that grows moves faster than any step of the model follows
            run.go(round(task.duration / setting.period))
            held = run.wait(band, longest)
            final = float(np.max(run.error[-round(QUIET / setting.period) :]))
            settling = () if task.path else settling_of(np.array(run.error), setting.period, task.time, levels)
            if held is not None:
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
    """Return the range of commands in an SI unit, and their fastest change, as words."""
    slew = "" if np.isinf(limits.slew) else f" and {in_words(limits.slew, unit)}/s"
    return f"0 ... {in_words(limits.highest, unit)}{slew}"


def settling_of(error: Array, period: float, begins: Array, levels: Array) -> tuple[float | None, ...]:
    """Settling time [s] of each set-point from errors (T,) [m] of every period; None where it is not reached.

    `begins` (k,) [s] and `levels` (k, m) [m] are those of the task.
    """
    time, steps = np.arange(error.size) * period, np.linalg.norm(np.diff(levels, axis=0, prepend=0.0), axis=1)
    found = []
    for begin, end, step in zip(begins, [*begins[1:], np.inf], steps, strict=True):
        during = (time >= begin) & (time < end)
        if step > 0.0 and during.sum() > 1:
            found.append(settling_time(time[during], error[during], 0.0, max(step, LEAST_BAND / BAND)))
    return tuple(found)


def limit_aware(
    make: Callable[[Task], Pipeline], setting: RehearsalSetting, task: Task, limits: Limits, weight: Array, *,
    tunable: bool,
) -> tuple[Task, Rehearsal]:
    """The task with the least effort weight, of 1, 2, 4 ... 1024 times its own, whose rehearsed loop settles.

    Parameters
    ----------
    make : callable
        The pipeline of a task, at its beginning.
    setting, task, limits, weight
        See `rehearse`.
    tunable : bool
        Whether the effort weight changes the controller: one that it does not change is rehearsed once.

    Raises
    ------
    InputError
        When none of them settles.
    """
    for factor in RAISES if tunable else RAISES[:1]:
        tuned = replace(task, tuning=replace(task.tuning, effort=factor * task.tuning.effort))
        found = rehearse(make(tuned), setting, tuned, limits, weight)
        if found.settles:
            return tuned, replace(found, wanted_effort=task.tuning.effort)
    within = range_of(limits, setting.body.actuation.units[0])
    tried = f"with any effort weight from {task.tuning.effort:g} to {found.effort:g}" if tunable else "as it is tuned"
    raise InputError(
        f"the loop does not settle within {within} {tried}: rehearsed on its own "
        f"model it ends {found.final_error * 1e3:.3g} mm from its target ({found.band * 1e3:.3g} mm allowed); allow "
        "faster changes of the command, ask for smaller steps, or fit a model that is damped more"
    )
