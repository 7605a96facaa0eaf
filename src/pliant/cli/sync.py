"""`pliant sync`: estimate the offset between the clocks of a pressure log and a recorded shape."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from pliant.cli.terminal import answer, in_unit


def sync(
    shape: Annotated[Path, typer.Argument(help="Recording of the shape.")],
    pressure: Annotated[
        Path | None, typer.Argument(help="Log of the pressure; default: the inputs in the shape's file.")
    ] = None,
    mapping: Annotated[Path | None, typer.Option(help="TOML file that describes the shape's columns.")] = None,
    pressure_mapping: Annotated[
        Path | None, typer.Option("--pressure-mapping", help="TOML file that describes the log's columns.")
    ] = None,
    largest_s: Annotated[
        float | None, typer.Option("--largest-s", parser=in_unit("s"),
                                   help="Largest offset to try, s; default: half of the overlap.")
    ] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Joined recording to write (.nc).")] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure of the clocks (.png, .svg or .pdf).")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Estimate the offset between the clocks of a pressure log and a recorded shape by comparing pressure and motion.

    Example: pliant sync points.csv log.csv --pressure-mapping log.toml --figure clocks.png
    """
    from pliant.cli.output import write_figure
    from pliant.cli.reading import read_with_mapping
    from pliant.cli.terminal import busy
    from pliant.preprocessing.sync import shift_pressure
    from pliant.preprocessing.sync import sync as find
    from pliant.recording import write
    from pliant.study.aligned import with_pressure

    recording = read_with_mapping(shape, mapping)
    if pressure is not None:
        recording = with_pressure(recording, read_with_mapping(pressure, pressure_mapping), shape.stem, pressure.name)
    with busy("comparing the clocks"):
        offset = find(recording, largest_s=largest_s, drift=True)
    if figure is not None:
        from pliant.plotting import clock_figure
        from pliant.validation.outcome import Clocks

        c = Clocks.of(recording, offset)
        title = f"the {offset.input}'s clock is moved by {1e3 * c.delay:+.1f} ± {1e3 * offset.uncertainty_s:.1f} ms"
        write_figure(clock_figure(c.time, c.motion, c.clock, c.pressure, c.delay, c.drift, title, offset.input),
                     figure)  # fmt: skip
    if output is not None:
        write(shift_pressure(recording, offset.delay_s, offset.drift), output)
    answer(
        asdict(offset),
        f'{offset.summary()}\nin a study: clock = {offset.delay_s:.4f}, or clock = "align"',
        as_json=json,
    )
