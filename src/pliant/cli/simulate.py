"""`pliant simulate` and `pliant design`: simulate a model, and plan the recording that determines it best."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pliant.cli.reading import DRIVE, LEVELS, BaseCutoff, BaseFile, BaseMapping, base_motion, drives, levels, vector
from pliant.cli.terminal import answer, in_unit, progress_lines
from pliant.errors import InputError
from pliant.units import KIND_OF, shown_in

if TYPE_CHECKING:
    from pliant.identification.design import Design
    from pliant.model import Model
    from pliant.simulation import BaseMotion
    from pliant.simulation.forces import PointForce
    from pliant.simulation.inputs import Input


def simulate(
    model: Annotated[Path, typer.Argument(help="Model file, or results folder of `pliant run`.")],
    level: Annotated[
        str | None, typer.Option(help=f"Level of a pulse, {LEVELS}.", show_default="bends the body by 0.5 rad")
    ] = None,
    start: Annotated[float, typer.Option(parser=in_unit("s"), help="Start of the pulse, s.")] = 0.12,
    width: Annotated[float, typer.Option(parser=in_unit("s"), help="Width of the pulse, s.")] = 2.76,
    trace: Annotated[Path | None, typer.Option(help="Recording whose inputs are used instead of a pulse.")] = None,
    drive: Annotated[str, typer.Option(help=DRIVE)] = "",
    duration: Annotated[
        float | None, typer.Option(parser=in_unit("s"),
                                   help="Simulated time, s.", show_default="4, or the length of the trace")
    ] = None,
    time_step_ms: Annotated[
        float | None,
        typer.Option("--time-step-ms", parser=in_unit("ms"),
                     help="Longest time step, ms.", show_default="1, or shorter for an accurate tip"),
    ] = None,
    method: Annotated[
        str, typer.Option(help="midpoint, extrapolated, accurate, LSODA, BDF or Radau.")
    ] = "midpoint",
    load_g: Annotated[
        float, typer.Option("--load-g", parser=in_unit("g"),
                            help="Mass attached to the tip, g; it has weight if the model has gravity.")
    ] = 0.0,
    base: BaseFile = None,
    base_mapping: BaseMapping = None,
    base_cutoff_hz: BaseCutoff = None,
    force: Annotated[
        str,
        typer.Option(help="Force FX,FY[,FZ][@POINT] in N during the pulse, on an observed point (default: the last)."),
    ] = "",
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Trajectory file (.nc or .csv).")] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure of all tips against time (.png or .svg).")] = None,
    film: Annotated[Path | None, typer.Option(help="Video of the moving body (.gif, or .mp4 with ffmpeg).")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON.")] = False,
) -> None:
    """Simulate a model under a pulse of its inputs or under recorded inputs, on a base that rests or moves.

    Example: pliant simulate results/arm/model.json --level 25 --duration 5 -o path.nc --figure path.png
    """
    from pliant.cli.output import print_numbers, save_trajectory, summary, write_figure, write_film
    from pliant.cli.terminal import busy
    from pliant.model import load_model
    from pliant.simulation import Pulse
    from pliant.simulation import simulate as solve

    loaded = with_load(load_model(model), load_g)
    time_step = None if time_step_ms is None else time_step_ms * 1e-3
    pull = point_forces(loaded, force, start, start + width)
    options: dict[str, Any] = {"time_step": time_step, "method": method, "forces": pull}
    if trace is None:
        high = own_levels(loaded) if level is None else levels(loaded, level)
        inputs: list[Input] = [Pulse(peak, start, width) for peak in high]
        options["duration"] = 4.0 if duration is None else duration
    elif level is not None:
        raise InputError("give either --level for a pulse or --trace for measured inputs, not both")
    else:
        inputs, options["times"] = measured_inputs(trace, loaded, drive, duration, time_step)
    options |= on_base(base_motion(base, loaded, base_mapping, base_cutoff_hz), options, duration)
    with busy("simulating"):
        result = solve(loaded, inputs, **options)
    if base is not None:
        result.attrs["history"] = f"base: poses of {base.name} relative to the first; {result.attrs['history']}"
    if output is not None:
        save_trajectory(result, output)
    if figure is not None:
        from pliant.validation.use_figures import motion_figure

        write_figure(motion_figure(result), figure)
    if film is not None:
        write_film(result, loaded, film)
    print_numbers(summary(result), as_json=json)


def on_base(motion: BaseMotion | None, options: dict[str, Any], duration: float | None) -> dict[str, Any]:
    """Return the options of a simulation on a base that moves: the motion, which begins at 0 s under a pulse and has
    the clock of measured inputs, and the simulated time, which ends with the poses unless stated. {} without a motion.
    """
    from dataclasses import replace

    if motion is None:
        return {}
    if "times" in options:
        return {"base": motion}
    motion = replace(motion, time=motion.time - motion.time[0])
    return {"base": motion, "duration": float(motion.time[-1]) if duration is None else duration}


def with_load(model: Model, grams: float) -> Model:
    """Return the model with an additional mass [g] at its tip."""
    if not (math.isfinite(grams) and model.tip_mass + 1e-3 * grams >= 0):
        raise InputError(f"--load-g must be a mass in grams of at least {0.0 - 1e3 * model.tip_mass:.4g}, so that the "
                         f"tip mass does not become negative, got {grams}")  # fmt: skip
    return model.with_(tip_mass=model.tip_mass + 1e-3 * grams) if grams else model


def point_forces(model: Model, text: str, start: float, stop: float) -> tuple[PointForce, ...]:
    """Return a tuple with the constant force [N] that the text ``FX,FY[,FZ][@POINT]`` states, acting from `start` to
    `stop` [s]; () for an empty text.
    """
    import numpy as np

    from pliant.mechanics import mechanics_of
    from pliant.simulation.forces import PointForce

    if not text:
        return ()
    numbers, _, point = text.partition("@")
    axes = mechanics_of(model).dimension
    wanted = "FX,FY" + ",FZ" * (axes - 2)
    pull = vector(numbers, axes, f"--force must be {wanted} or {wanted}@POINT with numbers in N, got {text!r}", "N")
    force, time = np.array([0.0 * np.array(pull), pull, pull, 0.0 * np.array(pull)]), [start, start, stop, stop]
    return (PointForce(np.array(time), force, point or model.points[-1].name),)


def own_levels(model: Model) -> list[float]:
    """Return a default level [SI] for each input: for the first one that bends the model by up to 0.5 rad, for all
    others 0.
    """
    from pliant.simulation.state import first_alone, typical_pressure

    level = typical_pressure(model)
    if not level:
        raise InputError(f"no {model.actuation.kinds[0]} bends the model {model.name!r} by half a radian: give --level")
    return [float(p) for p in first_alone(model, level)]


def measured_inputs(
    path: Path, model: Model, drive: str, duration: float | None, time_step: float | None
) -> tuple[list[Input], Any]:
    """Return the recorded input for each input of the model, and the times (T,) [s] of the simulated motion, which
    begin at the first sample.
    """
    from pliant.identification.drives import measured
    from pliant.recording import read
    from pliant.simulation import Trace
    from pliant.simulation.solve import output_times

    recorded = read(path)
    if not {"pressure", "actuation"} & set(recorded):
        raise InputError(f"{path} holds no measured pressure or other input: give a pulse by --level instead")
    inputs = measured(path.name, recorded, model, drives(drive))
    clocks = [source.time for source in inputs if isinstance(source, Trace)]
    first, last = (float(end) for end in (min(t[0] for t in clocks), max(t[-1] for t in clocks)))
    return [*inputs], first + output_times(last - first if duration is None else duration, None, time_step)


def design(
    study: Annotated[Path, typer.Argument(help="Study file (TOML) with the existing recordings.")],
    highest: Annotated[
        str, typer.Option("--max", help="Highest input with its unit, as 30kPa (gauge), or as 5N,3mm of inputs of "
                                        "several units. Default: the highest recorded.")
    ] = "",
    criterion: Annotated[
        str, typer.Option("--criterion", help="Reduce the largest uncertainty (E) or the mean uncertainty (D).")
    ] = "E",
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Rank pulses and chirps by how much one more recording of each would reduce the parameters' standard errors.

    Example: pliant design study.toml --max 30kPa
    """
    from pliant.study import load_study
    from pliant.study.run import design_study

    limits = highest_levels(highest) if highest else None
    with progress_lines() as notify:
        plan = design_study(load_study(study), highest=limits, criterion=criterion, progress=notify)
    answer(plan.to_dict(), design_table(plan), as_json=json, indent=2)


def highest_levels(text: str) -> dict[str, float]:
    """Return levels [SI] by SI unit from a text such as "30kPa" or "5N,3mm"."""
    si = {shown_in(unit)[1]: unit for unit in KIND_OF}
    levels = {}
    for part in text.split(","):
        match = re.fullmatch(rf"\s*([\d.eE+-]+)\s*({'|'.join(si)})\s*", part)
        try:
            unit = si[match[2]] if match else ""
            levels[unit] = float(match[1]) * (1.0 / shown_in(unit)[0]) if match else math.nan
        except ValueError:
            levels[""] = math.nan
    if "" in levels:
        raise InputError(f"--max must be numbers with units, as 30kPa or 5N,3mm (kPa, N, mm or rad), got {text!r:.80}")
    return levels


def design_table(plan: Design) -> str:
    """Return a table of the proposed recordings, with the standard errors of the parameters expected after each."""
    from pliant.cli.output import aligned

    rows = [[p.words, f"{100 * p.weakest:.3g} %", f"{100 * p.volume:.3g} %"] for p in plan.proposals[:8]]
    least = (
        f"Least certain parameters: {', '.join(plan.direction)}. Standard error: {100 * plan.now.weakest:.3g} % in "
        f"their worst combination, {100 * plan.now.volume:.3g} % on average over all combinations of parameters."
    )
    table = aligned([["one more recording", "weakest", "all"], *rows])
    return "\n".join([least, *table, *(f"  not proposed: {line}" for line in plan.refused)])
