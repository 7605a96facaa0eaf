"""`pliant control`: bring the tip of an actuator to where a task wants it, in the loop."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from pliant.loop.task import Done


def print_task(wanted: bool) -> None:
    """Print the example and leave, whatever else was or was not given."""
    if wanted:
        from pliant.control.task import EXAMPLE

        typer.echo(EXAMPLE, nl=False)
        raise typer.Exit


def control(
    model: Annotated[Path, typer.Option("--model", help="Model file, as `pliant run` writes it.")],
    task: Annotated[Path | None, typer.Option("--task", help="Task (.toml): set-points and limits.")] = None,
    plant: Annotated[str, typer.Option("--plant", help="testbed:a, testbed:b, testbed:c, or an installed plant.")] = (
        "testbed:a"
    ),
    estimator: Annotated[str, typer.Option(help="observer, filter, differences, or an installed one.")] = "observer",
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
    from pliant.cli.output import write_figure
    from pliant.control.task import read_task
    from pliant.files import write_text
    from pliant.loop.task import make_plant, run_task
    from pliant.model import load_model
    from pliant.validation.use_figures import control_figure

    wanted = read_task(task)
    output.mkdir(parents=True, exist_ok=True)
    done = run_task(load_model(model), make_plant(plant), wanted, output, estimator=estimator, real_time=real_time)
    text, table = report(plant, done), done.log
    write_text(output / "report.md", text)
    figure = control_figure(
        table["time_s"], table["target_m"], table["target_m"] + table["error_m"], table["command_pa"],
        table["pressure_pa"],
    )
    for ending in (".png", ".svg"):
        write_figure(figure, output / f"control{ending}")
    if json:
        from json import dumps

        typer.echo(dumps({"plant": plant, "folder": str(output), **done.summary}, default=float))
        return
    typer.echo(text)
    typer.echo(f"log, report and figures: {output}")


def report(plant: str, done: Done) -> str:
    """What was reached, in Markdown."""
    design, table = done.prepared.design, done.log
    error = 1e3 * table["error_m"]
    last = error.tail(max(len(table) // 5, 1))
    lines = [f"# Control of {plant}", "", "Stability margins by pressure, full state known:", ""]
    lines += ["```", str(design), "```", ""]
    if not design.model.valve.natural_frequency and not design.model.valve.rise_time:
        lines += ["The model holds no valve: these margins leave its lag out. Identify one before relying on them.", ""]
    lines += [
        f"- estimated tip error over the last fifth: mean {last.mean():.3f} mm, largest {last.abs().max():.3f} mm",
        f"- highest command {1e-3 * table['command_pa'].max():.1f} kPa",
        f"- fault: {done.summary['fault'] or 'none'}",
    ]
    lines += [f"- {name}: {value:.6g}" for name, value in done.summary.items() if not isinstance(value, str)]
    return "\n".join(lines) + "\n"
