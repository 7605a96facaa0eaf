"""`pliant bench`: measure the speed of the kernels and the start-up time on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from pliant.cli.terminal import say


def bench(
    part: Annotated[str | None, typer.Argument(help="kernels or startup; default: both.")] = None,
    *,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="File for the numbers (.json).")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the numbers as JSON.")] = False,
) -> None:
    """Measure the speed of the kernels compared with plain C, and the start-up time of pliant, on this machine.

    Example: pliant bench kernels
    """
    import json as jsonlib

    from pliant.bench.run import chosen, measure, write
    from pliant.cli.terminal import busy

    results: dict[str, Any] = {}
    for name, job in chosen(part).items():
        with busy(f"measuring {name}"):
            texts: list[str] = []
            results |= measure({name: job}, message=texts.append)
        if not json:
            say("\n".join(texts))
    if output is not None:
        write(results, output)
    if json:
        say(jsonlib.dumps(results))
