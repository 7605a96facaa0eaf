"""`pliant bench`: what pliant costs on this machine, beside others."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer


def bench(
    part: Annotated[
        str | None, typer.Argument(help="kernels, experiment, fit, batch, realtime or startup; all when left out.")
    ] = None,
    *,
    seconds: Annotated[float, typer.Option(help="Length of the real-time run at 1 kHz, s.")] = 10.0,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="File for the numbers (.json).")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the numbers as JSON.")] = False,
) -> None:
    """Measure speed on this machine, with the error beside every time, and ratios to the peers that are installed.

    Example: pliant bench realtime --seconds 60
    """
    import json as jsonlib

    from pliant.bench.run import NAMES, measure, write
    from pliant.cli.progress import busy

    found: dict[str, Any] = {}
    for name in (part,) if part else NAMES:
        with busy(f"measuring {name}"):
            told: list[str] = []
            found |= measure((name,), seconds=seconds, tell=told.append)
        if not json:
            typer.echo("\n".join(told))
    if output is not None:
        write(found, output)
    if json:
        typer.echo(jsonlib.dumps(found))
