"""`pliant design`: propose what to record next."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pliant.cli.terminal import answer, progress_lines

if TYPE_CHECKING:
    from pliant.identification.design import Design


def design(
    study: Annotated[Path, typer.Argument(help="Study file (TOML) with the existing recordings.")],
    max_kpa: Annotated[
        float | None, typer.Option("--max-kpa", help="Highest pressure, kPa gauge; default: the highest recorded.")
    ] = None,
    criterion: Annotated[
        str, typer.Option("--criterion", help="Reduce the largest uncertainty (E) or the mean uncertainty (D).")
    ] = "E",
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Rank pulses and chirps by how much one more recording of each would reduce the parameters' standard errors.

    Example: pliant design study.toml --max-kpa 30
    """
    from pliant.study import load_study
    from pliant.study.design import design_study

    highest = None if max_kpa is None else max_kpa * 1e3
    with progress_lines() as notify:
        plan = design_study(load_study(study), highest=highest, criterion=criterion, progress=notify)
    answer(plan.to_dict(), design_table(plan), as_json=json, indent=2)


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
