"""`pliant demo`: the whole chain on the recordings that come with pliant."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def demo(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the results.")] = Path("results/demo"),
    angles: Annotated[
        bool, typer.Option("--angles", help="From logs of one angle and one pressure, as a flex sensor gives them.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print metrics.json on standard output.")] = False,
) -> None:
    """Run the whole chain on bundled recordings: fibre points, tip, order, links, fit, prediction, report.

    Example: pliant demo -o results/demo
    """
    from pliant.cli.run import run
    from pliant.study import angles_study, demo_study

    run(angles_study() if angles else demo_study(), output, json=json)
