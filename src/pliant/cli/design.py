"""`pliant design`: propose what to record next."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pliant.cli.terminal import answer, progress_lines
from pliant.errors import InputError
from pliant.units import KIND_OF, shown_in

if TYPE_CHECKING:
    from pliant.identification.design import Design


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
