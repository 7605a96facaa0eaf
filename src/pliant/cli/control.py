"""`pliant control`: bring the tip of an actuator to where a task wants it, in the loop."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    import pandas as pd

    from pliant.control import LqrDesign, Prepared

TASK = """\
# set-points of the tip, and what may be asked of the valve
period_ms = 4.0
highest_kpa = 190.0
duration_s = 2.0
feedback = "lqr"       # or "mpc" (extra mpc), "pid"
planned = true         # changes as fast as the limits allow; false: ramps
ramp_s = 0.03          # time of a change that is not planned
[[setpoint]]
time_s = 0.0
displacement_mm = 25.0
# [path]               # instead of set-points: straight between these
# time_s = [0.0, 1.0, 2.0]
# displacement_mm = [0.0, 25.0, 5.0]
[valve]                # of the rig; without this table the model's
rise_hz = 9.01
fall_hz = 6.46
damping_ratio = 0.765
dead_time_ms = 8.12
"""
KNOWN = {"period_ms": 4.0, "highest_kpa": 190.0, "duration_s": 2.0, "ramp_s": 0.03, "slew_kpa_per_s": float("inf"),
         "effort": 0.3, "damping_time_s": 0.09, "integral_time_s": 0.3}  # fmt: skip
VALVE = ("rise_hz", "fall_hz", "damping_ratio", "dead_time_ms")


def print_task(wanted: bool) -> None:
    """Print the example and leave, whatever else was or was not given."""
    if wanted:
        typer.echo(TASK, nl=False)
        raise typer.Exit


def control(
    model: Annotated[Path, typer.Option("--model", help="Model file, as `pliant run` writes it.")],
    task: Annotated[Path | None, typer.Option("--task", help="Task (.toml): set-points and limits.")] = None,
    plant: Annotated[str, typer.Option("--plant", help="testbed:a, testbed:b, testbed:c, or an installed plant.")] = (
        "testbed:a"
    ),
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for log, report and figure.")] = Path(
        "results/control"
    ),
    real_time: Annotated[bool, typer.Option("--real-time", help="By the machine's clock, not as fast as it goes.")] = (
        False
    ),
    _example: Annotated[
        bool, typer.Option("--example", is_eager=True, callback=print_task, help="Print an example task and leave.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the loop's summary as JSON.")] = False,
) -> None:
    """Control the tip of an actuator: calibrate its rest, design the gains, run the loop, report.

    Example: pliant control --plant testbed:b --model results/demo/model.json --task task.toml
    """
    from pliant.files import write_text
    from pliant.model import load_model

    wanted = read_task(task)
    output.mkdir(parents=True, exist_ok=True)
    design, summary, table = run_task(load_model(model), make_plant(plant), wanted, output, real_time=real_time)
    text = report(plant, design, summary, table)
    write_text(output / "report.md", text)
    from pliant.cli.output import write_figure
    from pliant.validation.use_figures import control_figure

    figure = control_figure(
        table["time_s"], table["target_m"], table["target_m"] + table["error_m"], table["command_pa"],
        table["pressure_pa"],
    )
    for ending in (".png", ".svg"):
        write_figure(figure, output / f"control{ending}")
    if json:
        from json import dumps

        typer.echo(dumps({"plant": plant, "folder": str(output), **summary}, default=float))
        return
    typer.echo(text)
    typer.echo(f"log, report and figures: {output}")


def read_task(path: Path | None) -> dict[str, Any]:
    """A task with its defaults filled in; InputError names the entry that is wrong."""
    from pliant.errors import InputError

    try:
        text = TASK if path is None else path.read_text(encoding="utf-8")
        entries = tomllib.loads(text)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"cannot read the task {path}: {error}") from None
    points, path_of, valve = entries.pop("setpoint", []), entries.pop("path", None), entries.pop("valve", None)
    made = {"feedback": entries.pop("feedback", "lqr"), "planned": entries.pop("planned", True)}
    if unknown := sorted(set(entries) - set(KNOWN)):
        names = ", ".join((*KNOWN, *made))
        names += ", [[setpoint]], [path], [valve]"
        raise InputError(f"task {path}: unknown entry {unknown[0]!r}; it may have {names}")
    numbers = entries | ({} if valve is None else {f"[valve] {name}": valve.get(name) for name in VALVE})
    for name, value in numbers.items():
        if not isinstance(value, int | float) or isinstance(value, bool) or not value > 0:
            raise InputError(f"task {path}: {name} must be a positive number, got {value!r}")
    if not isinstance(made["planned"], bool):
        raise InputError(f"task {path}: planned must be true or false, got {made['planned']!r}")
    try:
        if path_of is not None:
            rows = list(zip(map(float, path_of["time_s"]), map(float, path_of["displacement_mm"]), strict=True))
        else:
            rows = [(float(p["time_s"]), float(p["displacement_mm"])) for p in points]
    except (KeyError, TypeError, ValueError):
        raise InputError(
            f"task {path}: every [[setpoint]] has the numbers time_s and displacement_mm, a [path] as many of each"
        ) from None
    if not rows:
        raise InputError(f"task {path}: give at least one [[setpoint]] with time_s and displacement_mm, or a [path]")
    rows = [(t, 1e-3 * d) for t, d in rows]
    return {**KNOWN, **entries, **made, "setpoint": rows, "path": path_of is not None, "valve": valve}


def make_plant(name: str) -> Any:
    """The plant of a name: ``testbed:<actuator>``, or an entry point of the group ``pliant.plants``."""
    kind, _, which = name.partition(":")
    if kind == "testbed":
        from pliant.testbed.plant import Plant

        return Plant(which or "a")
    from pliant.loop import connection

    return connection("plant", kind)(which) if which else connection("plant", kind)()


def run_task(
    model: Any, plant: Any, task: dict[str, Any], folder: Path, *, real_time: bool
) -> tuple[LqrDesign, dict[str, Any], pd.DataFrame]:
    """Calibrate, design, run; the design with its margins, the loop's summary, the log."""
    from pliant.control import Limits
    from pliant.loop import (
        COLUMNS,
        Bounds,
        ControlLoop,
        LoopLog,
        SystemClock,
        VirtualActuator,
        VirtualClock,
        Watchdog,
        read_log,
    )

    period, highest = 1e-3 * task["period_ms"], 1e3 * task["highest_kpa"]
    limits = Limits(highest, 1e3 * task["slew_kpa_per_s"])
    ready = prepared(model, plant, task, limits, period)
    path = folder / "log.csv"
    path.unlink(missing_ok=True)
    log = LoopLog(path, [*COLUMNS, *(f"phi_{i + 1}_rad" for i in range(model.n))])
    clock = SystemClock() if real_time else VirtualClock()
    arm = VirtualActuator(plant, clock)
    watchdog = Watchdog(Bounds(1.15 * highest))
    loop = ControlLoop([arm], arm, ready.estimator, ready.control, watchdog, period, clock, log)
    try:
        loop.run(task["duration_s"])
    finally:
        log.close()
    return ready.design, {**loop.summary(), "commands_at_a_limit": ready.control.saturated}, read_log(path)


def prepared(model: Any, plant: Any, task: dict[str, Any], limits: Any, period: float) -> Prepared:
    """Estimator and controller for a plant whose rest is measured first."""
    import numpy as np

    from pliant.control import SupplyValve, Task, Tuning, prepare_control
    from pliant.errors import InputError

    if abs(plant.period - period) > 1e-9:
        raise InputError(f"the plant's frames come every {plant.period * 1e3:g} ms: set period_ms to that")
    frames = [plant.advance(0.0) for _ in range(50)]
    late = round((plant.time - frames[-1].time) / period)
    tuning = Tuning(task["effort"], task["damping_time_s"], task["integral_time_s"])
    times, levels = map(np.array, zip(*task["setpoint"], strict=True))
    wanted = Task(
        times, levels, task["duration_s"], path=task["path"], ramp=task["ramp_s"], planned=task["planned"],
        feedback=task["feedback"], tuning=tuning,
    )
    supply = None
    if (v := task["valve"]) is not None:
        supply = SupplyValve(v["rise_hz"], v["fall_hz"], v["damping_ratio"], 1e-3 * v["dead_time_ms"])
    shapes = np.array([f.shape for f in frames])
    return prepare_control(model, plant.arc_length, shapes, wanted, limits, period, late=late, supply=supply)


def report(plant: str, design: LqrDesign, summary: dict[str, Any], table: pd.DataFrame) -> str:
    """What was reached, in Markdown."""
    error = 1e3 * table["error_m"]
    last = error.tail(max(len(table) // 5, 1))
    lines = [f"# Control of {plant}", "", "Stability margins by pressure, full state known:", ""]
    lines += ["```", str(design), "```", ""]
    if not design.model.valve.natural_frequency and not design.model.valve.rise_time:
        lines += ["The model holds no valve: these margins leave its lag out. Identify one before relying on them.", ""]
    lines += [
        f"- estimated tip error over the last fifth: mean {last.mean():.3f} mm, largest {last.abs().max():.3f} mm",
        f"- highest command {1e-3 * table['command_pa'].max():.1f} kPa",
        f"- fault: {summary['fault'] or 'none'}",
    ]
    lines += [f"- {name}: {value:.6g}" for name, value in summary.items() if not isinstance(value, str)]
    return "\n".join(lines) + "\n"
