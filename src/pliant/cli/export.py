"""`pliant export`: a model for another tool."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pliant.cli.terminal import say
from pliant.errors import InputError


def export(
    model: Annotated[Path, typer.Argument(help="Model file, as `pliant run` writes it.")],
    to: Annotated[str, typer.Option("--to", help="mjcf, c99, fmu, state-space, urdf.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write, with the target's ending.")],
    approximate: Annotated[
        bool, typer.Option("--approximate", help="Leave out what the target cannot express, and say what it costs.")
    ] = False,
    fit: Annotated[
        Path | None, typer.Option(help="metrics.json of the run: its standard errors go into the artefact.")
    ] = None,
    options: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="<name=value>", help="An option of the target, NAME=VALUE; may be repeated."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print what was written as JSON.")] = False,
) -> None:
    """Write a model for MuJoCo, C, an FMU, state space or URDF.

    Example: pliant export results/demo/model.json --to mjcf -o finger.xml --set prefix=left_
    """
    import json as jsonlib

    from pliant.cli.progress import busy
    from pliant.exporters import export as write
    from pliant.exporters.provenance import standard_errors

    chosen = {}
    for entry in options or ():
        name, equals, value = entry.partition("=")
        if not equals:
            raise InputError(f"--set takes NAME=VALUE, got {entry!r}")
        chosen[name] = value
    errors = standard_errors(fit) if fit else None
    with busy("exporting"):
        done = write(model, to, output, approximate=approximate, standard_errors=errors, **chosen)
    say(jsonlib.dumps(done.to_dict()) if json else repr(done))
