"""A task done on a plant: its rest measured, estimator and controller prepared, the loop run, all of it logged."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pliant.control.model_plant import ModelPlant
from pliant.control.preparation import Prepared, prepare_control
from pliant.control.task import LIMITS_IN, TaskFile
from pliant.errors import InputError
from pliant.loop.clock import SystemClock, VirtualClock
from pliant.loop.log import LoopLog, read_log
from pliant.loop.run import ControlLoop, log_columns
from pliant.loop.sample import connection
from pliant.loop.virtual import VirtualActuator
from pliant.loop.watchdog import Bounds, Watchdog
from pliant.model import Model, load_model

if TYPE_CHECKING:
    import pandas as pd

AT_REST = 50  # frames by which the rest of a body is measured
ABOVE = 1.15  # times the highest command that the watchdog lets a reading be


class Done(NamedTuple):
    """A task that was done."""

    prepared: Prepared
    summary: dict[str, float | str]  # counters of the loop, and its fault
    log: pd.DataFrame
    setpoints: tuple[tuple[float, float], ...] = ()  # s, m; none of a path
    unit: str = "Pa"  # of the commands


def make_plant(name: str) -> Any:
    """The plant of a name: ``testbed:<actuator>``, ``model:<file>``, or an entry point of ``pliant.plants``.

    What follows a colon is handed to it as text: ``finger:COM3`` calls what the entry point ``finger`` leads to
    with "COM3".

    Raises
    ------
    InputError
        When nobody offers that name.
    """
    kind, _, which = name.partition(":")
    if kind == "testbed":
        from pliant.testbed.plant import Plant

        return Plant(which or "a")
    if kind == "model":
        return ModelPlant(load_model(which))
    return connection("plant", kind)(which) if which else connection("plant", kind)()


def prepare_plant(model: Model, plant: Any, wanted: TaskFile, estimator: str = "observer") -> Prepared:
    """Estimator and controller for a plant whose rest is measured first.

    Raises
    ------
    InputError
        When the plant's frames come at another period than the task's.
    """
    if abs(plant.period - wanted.period) > 1e-9:
        raise InputError(f"the plant's frames come every {plant.period * 1e3:g} ms: set period_ms to that")
    none = np.zeros(model.actuation.count)
    frames = [plant.advance(none) for _ in range(AT_REST)]
    late = round((plant.time - frames[-1][0]) / wanted.period)
    shapes = np.array([shape for _, shape, _ in frames])
    return prepare_control(
        model, plant.arc_length, shapes, wanted.task, wanted.limits, wanted.period, late=late, supply=wanted.supply,
        estimator=estimator, rides=getattr(plant, "rides", False),
    )


def check_units(model: Model, wanted: TaskFile) -> None:
    """Raise InputError where a task's limits are not in the unit of the model's inputs."""
    if others := [c for c in model.chambers if c.unit != wanted.unit]:
        several = len(set(model.actuation.units)) > 1
        remedy = (
            "make a controller by design_outputs and Lqr or Mpc, its limits in the unit of each input" if several
            else f"give {LIMITS_IN[others[0].unit]} in place of {LIMITS_IN[wanted.unit]}"
        )
        raise InputError(
            f"the task limits inputs by {LIMITS_IN[wanted.unit]}, and {others[0].name!r} of {model.name!r} takes a "
            f"{others[0].kind} ({others[0].unit}): {remedy}"
        )


def run_task(
    model: Model, plant: Any, wanted: TaskFile, folder: Path, *, estimator: str = "observer", real_time: bool = False,
    progress: Callable[[str], None] = lambda _line: None,
) -> Done:
    """Do a task and write ``log.csv`` into a folder, whatever ends the run.

    Parameters
    ----------
    model : Model
    plant : PlantLike
    wanted : TaskFile
    folder : Path
    estimator : str
        See `pliant.estimation.estimators`.
    real_time : bool
        By the machine's clock, not as fast as it goes.
    progress : callable
        Called with one line for each phase that begins.

    Raises
    ------
    InputError
        When task, model and plant do not fit.
    """
    check_units(model, wanted)
    progress(f"measuring the rest of the body over {AT_REST} frames, designing estimator and controller")
    ready = prepare_plant(model, plant, wanted, estimator)
    path = folder / "log.csv"
    path.unlink(missing_ok=True)
    turns = model.size - len(model.extensions)
    log = LoopLog(path, log_columns(turns, ready.control.chambers, wanted.task.outputs, wanted.unit))
    log.remark(f"design: {ready.summary}")
    clock = SystemClock() if real_time else VirtualClock()
    arm = VirtualActuator(plant, clock, wanted.unit)
    highest = wanted.limits.highest
    lowest = Bounds.lowest_pressure if wanted.unit == "Pa" else (1.0 - ABOVE) * highest
    watchdog = Watchdog(Bounds(ABOVE * highest, lowest_pressure=lowest, unit=wanted.unit))
    progress(f"running the loop for {wanted.duration_s:g} s" + (" by the clock" if real_time else ""))
    loop = ControlLoop([arm], arm, ready.pipeline, watchdog, wanted.period, clock, log)
    try:
        loop.run(wanted.duration_s)
    finally:
        log.close()
    rehearsed = ready.rehearsal.summary if ready.rehearsal else {}
    summary = loop.summary() | rehearsed | ({"plant_periods_left_out": arm.behind} if arm.behind else {})
    return Done(ready, {**summary, "commands_at_a_limit": ready.control.saturated}, read_log(path),
                tuple((p.time_s, 1e-3 * p.displacement_mm) for p in wanted.setpoint if p.displacement_mm is not None),
                wanted.unit)
