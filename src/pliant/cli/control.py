"""`pliant control`: control the tip of an actuator in closed loop, so that it follows a task."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pliant.cli.terminal import answer, say
from pliant.units import KIND_OF, quantity, shown_in

if TYPE_CHECKING:
    from pliant.loop.task import TaskResult

NO_VALVE = "The model has no valve, so these margins ignore its lag: identify a valve before relying on them."
MEANING = {
    "settling_s": "for each set-point: time until the estimated tip stays within 2 % of the step",
    "command_change_rest_kpa": "RMS change of the command per period, later than 0.5 s after a set-point change",
    "command_change_motion_kpa": "RMS change of the command per period, within 0.5 s of a set-point change",
    "command_sd_rest_kpa": "standard deviation of the command, later than 0.5 s after a change",
    "mean_error_mm": "mean error of the estimated tip over the last fifth of the run",
    "largest_error_mm": "largest error of the estimated tip over the last fifth of the run",
    "overruns": "periods whose computation took longer than a period", "skipped": "periods skipped after an overrun",
    "worst_lateness_us": "largest delay of the start of a period; 0 if not in real time",
    "jitter_us": "standard deviation of that delay",
    "frames_lost": "shapes with missing points", "frames_late": "shapes older than an earlier one",
    "fault_time_s": "0 without a fault",
    "controller_faults": "periods in which the controller failed and an earlier plan was used",
    "commands_at_a_limit": "commands cut to a limit of pressure or its rate",
    "rehearsed_settling_s": "in simulation with the limits, for the slowest set-point",
    "rehearsed_error_mm": "in simulation, at the end of the task",
    "rehearsed_recovery_s": "in simulation, after a disturbance as large as the largest displacement",
    "effort_weight": "weight of the design, raised until the simulated loop settles",
}


def print_task(wanted: bool) -> None:
    """If `--example` is given, print an example task and exit, whatever the other options are."""
    if wanted:
        from pliant.control.task import EXAMPLE

        say(EXAMPLE.rstrip("\n"))
        raise typer.Exit


def control(
    model: Annotated[Path, typer.Option("--model", help="Model file, or results folder of `pliant run`.")],
    task: Annotated[
        Path | None, typer.Option("--task", help="Task (.toml): set-points and limits.", show_default="the example")
    ] = None,
    plant: Annotated[
        str, typer.Option("--plant", help="testbed:a, testbed:b, testbed:c, model:FILE_OR_FOLDER, or a plug-in's name.")
    ] = "testbed:a",
    estimator: Annotated[str, typer.Option(help="observer, filter, differences, or an installed one.")] = "observer",
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for log, report and figure.")] = Path(
        "results/control"
    ),
    real_time: Annotated[bool, typer.Option("--real-time", help="Run in real time, not as fast as possible.")] = (
        False
    ),
    _example: Annotated[
        bool, typer.Option("--example", is_eager=True, callback=print_task, help="Print an example task and exit.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the loop's summary as JSON.")] = False,
) -> None:
    """Control the tip of an actuator: calibrate its rest position, design the gains, run the loop, write a report.

    Example: pliant control --plant testbed:b --model results/demo/model.json --task task.toml
    """
    from pliant.cli.output import number_table, write_figure
    from pliant.cli.terminal import progress_lines
    from pliant.control.task import read_task
    from pliant.files import output_folder, write_text
    from pliant.loop.task import make_plant, run_task
    from pliant.model import load_model
    from pliant.validation.use_figures import control_figure

    wanted = read_task(task)
    with output_folder(output):
        with progress_lines() as notify:
            done = run_task(load_model(model), make_plant(plant), wanted, output, estimator=estimator,
                            real_time=real_time, progress=notify)
        write_text(output / "report.md", report(plant, done))
        target, error, command, pressure = (
            columns(done.log, name) for name in ("target", "error", "command", KIND_OF[done.unit]))
        figure = control_figure(
            done.log["time_s"], target, target.to_numpy() + error.to_numpy(), command, pressure,
            [str(name).removeprefix("target_").rpartition("_")[0] for name in target], done.unit,
        )
        for ending in (".png", ".svg"):
            write_figure(figure, output / f"control{ending}")
    numbers = reached(done)
    table = number_table(numbers, "results of the run", meanings(done.unit))
    lines = [f"stability margins of {plant} by {KIND_OF[done.unit]}, full state known, no limits:",
             str(done.prepared.design), *unmodelled(done), str(done.prepared.rehearsal), table,
             f"log, report and figures: {output}"]  # fmt: skip
    answer({"plant": plant, "folder": str(output), **numbers, **done.summary, "settling_s": settling(done)},
           "\n".join(lines), as_json=json, default=float)


def meanings(unit: str) -> dict[str, str]:
    """Return the meaning of each result of a run whose inputs have the SI unit `unit`, by the name of the result."""
    ending = shown_in(unit)[1].lower()
    return {(f"{name.removesuffix('_kpa')}_{ending}" if name.endswith("_kpa") else name): text
            for name, text in MEANING.items()}  # fmt: skip


def columns(log: Any, name: str) -> Any:
    """Return the columns of a control log whose names begin with `name` and an underscore. For example, "error" selects
    the error of every output.
    """
    return log[[c for c in log.columns if c.startswith(f"{name}_")]]


def reached_by_several(done: TaskResult) -> dict[str, Any]:
    """Return the results of a control run with several outputs as a dict: the RMS error of each output and its largest
    error in the last fifth of the run, the highest value of each command, and the statistics of the loop.
    """
    error = columns(done.log, "error")
    last = error.tail(max(len(error) // 5, 1))
    numbers: dict[str, Any] = {}
    for name in error:
        what, factor = str(name).removesuffix("_m").removesuffix("_rad"), 1e3
        unit = "mm"
        if str(name).endswith("_rad"):
            unit, factor = "deg", 57.29577951308232
        numbers[f"rms_{what}_{unit}"] = factor * float((error[name] ** 2).mean() ** 0.5)
        numbers[f"largest_last_{what}_{unit}"] = factor * float(last[name].abs().max())
    factor, display_unit = shown_in(done.unit)
    for name in columns(done.log, "command"):
        command = str(name).removesuffix(f"_{done.unit.lower()}")
        numbers[f"highest_{command}_{display_unit.lower()}"] = factor * float(done.log[name].max())
    return numbers | counters(done)


def counters(done: TaskResult) -> dict[str, Any]:
    """Return a dict with the fault of a control run ("none" if there was none) and the statistics of its loop, such as
    timing and lost frames.
    """
    return {"fault": done.summary["fault"] or "none"} | {k: v for k, v in done.summary.items() if k != "fault"}


def reached(done: TaskResult) -> dict[str, Any]:
    """Return the results of a control run as a dict: settling times [s], tip errors in the last fifth of the run [mm],
    highest command, fluctuation of the command, and the statistics of the loop.
    """
    import numpy as np

    from pliant.control.rehearsal import command_activity

    if "target_m" not in done.log:
        return reached_by_several(done)
    log, settled, name = done.log, settling(done), f"command_{done.unit.lower()}"
    factor, display_unit = shown_in(done.unit)
    times = ", ".join("did not settle" if t is None else f"{t:.3g}" for t in settled)
    active = command_activity(*(log[c].to_numpy() for c in ("time_s", "target_m", name)))
    error = 1e3 * log["error_m"]
    last = error.tail(max(len(log) // 5, 1))
    return {
        **({"settling_s": times} if settled else {}), "mean_error_mm": float(last.mean()),
        "largest_error_mm": float(last.abs().max()),
        f"highest_command_{display_unit.lower()}": factor * float(log[name].max()),
        **{f"{what}_{display_unit.lower()}": factor * value for what, value in active.items() if np.isfinite(value)},
        **counters(done),
    }


def settling(done: TaskResult) -> list[float | None]:
    """Return the settling time [s] of the estimated tip for each set-point; None if it does not settle."""
    from pliant.control.rehearsal import settling_times

    if "target_m" not in done.log:
        return []
    time, wanted, error = (done.log[c].to_numpy() for c in ("time_s", "target_m", "error_m"))
    return settling_times(time, wanted + error, done.setpoints)


def unmodelled(done: TaskResult) -> list[str]:
    """Return a list with one warning if no chamber of the model has valve dynamics; else an empty list."""
    valves = [c.valve for c in done.prepared.body.chambers]
    return [] if any(v.natural_frequency or v.rise_time for v in valves) else [NO_VALVE]


def report(plant: str, done: TaskResult) -> str:
    """Return the summary of a control run as Markdown text."""
    kind = KIND_OF[done.unit]
    lines = [f"# Control of {plant}", "", f"Stability margins by {kind}, full state known, no limits:", ""]
    lines += ["```", str(done.prepared.design), "```", "", *unmodelled(done), "",
              *(f"{line}  " for line in str(done.prepared.rehearsal).splitlines()), ""]
    lines += ["| | value | unit | |", "|---|---|---|---|"]
    for name, value in reached(done).items():
        words, unit = quantity(name)
        lines.append(f"| {words} | {value if isinstance(value, str) else f'{value:.4g}'} | {unit} | "
                     f"{meanings(done.unit).get(name, '')} |")
    return "\n".join(lines) + "\n"
