"""Run a control task on a plant: measure the rest shape, prepare estimator and controller, run and log the loop."""

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

Array = np.ndarray
AT_REST = 50  # frames from which the rest shape of a body is measured
ABOVE = 1.15  # highest pressure reading that the watchdog allows, over the highest command


class TaskResult(NamedTuple):
    """Result of a control task that was run."""

    prepared: Prepared
    summary: dict[str, float | str]  # counters of the loop, and its fault
    log: pd.DataFrame
    setpoints: tuple[tuple[float, float], ...] = ()  # s, m; empty for a path
    unit: str = "Pa"  # of the commands


def make_plant(name: str) -> Any:
    """Return the plant with a name ``testbed:<actuator>``, ``model:<file>``, or an entry point of ``pliant.plants``.

    The text after a colon is passed to the entry point: ``finger:COM3`` calls the entry point ``finger`` with "COM3".

    Raises
    ------
    InputError
        When no installed package provides that name.
    """
    kind, _, which = name.partition(":")
    if kind == "testbed":
        from pliant.testbed.plant import Plant

        return Plant(which or "a")
    if kind == "model":
        return ModelPlant(load_model(which))
    return connection("plant", kind)(which) if which else connection("plant", kind)()


def prepare_plant(model: Model, plant: Any, wanted: TaskFile, estimator: str = "observer") -> Prepared:
    """Measure the rest shape of a plant and return the prepared estimator and controller.

    Raises
    ------
    InputError
        When the plant's frame period differs from the task's period.
    """
    if abs(plant.period - wanted.period) > 1e-9:
        raise InputError(
            f"the task has a period of {wanted.period * 1e3:g} ms, but the plant's frames come every "
            f"{plant.period * 1e3:g} ms: set period_ms of the task to {plant.period * 1e3:g}"
        )
    none = np.zeros(model.actuation.count)
    frames = [plant.advance(none) for _ in range(AT_REST)]
    late = round((plant.time - frames[-1][0]) / wanted.period)
    shapes = np.array([shape for _, shape, _ in frames])
    return prepare_control(
        model, plant.arc_length, shapes, wanted.task, wanted.limits, wanted.period, late=late, supply=wanted.supply,
        estimator=estimator, rides=getattr(plant, "rides", False),
    )


def check_units(model: Model, wanted: TaskFile) -> None:
    """Raise InputError if a control task limits its inputs in another unit than that of the model's inputs, such as Pa
    for a tendon in N.
    """
    if others := [c for c in model.chambers if c.unit != wanted.unit]:
        several = len(set(model.actuation.units)) > 1
        remedy = (
            "make a controller by design_outputs and Lqr or Mpc, its limits in the unit of each input" if several
            else f"give {LIMITS_IN[others[0].unit]} in place of {LIMITS_IN[wanted.unit]}"
        )
        raise InputError(
            f"the task limits inputs by {LIMITS_IN[wanted.unit]}, but {others[0].name!r} of {model.name!r} takes a "
            f"{others[0].kind} ({others[0].unit}): {remedy}"
        )


def run_task(
    model: Model, plant: Any, wanted: TaskFile, folder: Path, *, estimator: str = "observer", real_time: bool = False,
    progress: Callable[[str], None] = lambda _line: None,
) -> TaskResult:
    """Run a control task on a plant and write ``log.csv`` into `folder`, also when the run fails.

    Parameters
    ----------
    model : Model
    plant : PlantLike
    wanted : TaskFile
    folder : Path
    estimator : str
        Name of an estimator of `pliant.estimation.estimators`.
    real_time : bool
        If True, run in real time. Otherwise run as fast as possible, on a virtual clock.
    progress : callable
        Called with a line of text at the start of each phase.

    Raises
    ------
    InputError
        When task, model and plant do not fit together.
    """
    check_units(model, wanted)
    progress(f"measuring the rest shape of the body over {AT_REST} frames, designing estimator and controller")
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
    setpoints = tuple((p.time_s, 1e-3 * p.displacement_mm) for p in wanted.setpoint if p.displacement_mm is not None)
    numbers = {**summary, "commands_at_a_limit": ready.control.saturated}
    return TaskResult(ready, numbers, read_log(path), setpoints, wanted.unit)
