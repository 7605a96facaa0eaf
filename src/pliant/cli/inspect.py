"""`pliant inspect`: show the content and the quality of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def inspect(
    recording: Annotated[Path, typer.Argument(help="A recording: .c3d, .csv, .nc, .npz, .mat, .tsv, ...")],
    mapping: Annotated[Path | None, typer.Option(help="TOML file with columns, units and format.")] = None,
    figure: Annotated[Path | None, typer.Option(help="Draw every station against time (.png or .svg).")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
) -> None:
    """Show the content and the quality of a recording: frames, stations, gaps, drop-outs, noise, units.

    Example: pliant inspect pulse.c3d --figure pulse.png
    """
    from pliant.cli.reading import print_recording, read_with_mapping

    ds = read_with_mapping(recording, mapping)
    print_recording(ds, recording, as_json=json)
    if figure is not None:
        from pliant.cli.output import write_figure
        from pliant.plotting import recording_overview

        write_figure(recording_overview(ds), figure)
