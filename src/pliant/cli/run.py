"""`pliant run`: run a study from its file to a validated model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pliant.cli.terminal import in_unit, progress_lines, say


def run(
    study: Annotated[Path, typer.Argument(help="Study file (TOML), or the study.json of an earlier run.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="Folder for model, metrics, results and report.",
            show_default="results/NAME of the study file",
        ),
    ] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 when a target of the study is missed.")] = False,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Number of parallel processes for fits; default: one for each core.")
    ] = None,
    minutes: Annotated[
        float | None,
        typer.Option(parser=in_unit("min", 0.01), help="Time limit of the model selection, min; default: the study's."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print metrics.json on standard output.")] = False,
) -> None:
    """Run a study, from recordings to a validated model: check, align, fit, predict, and write a report.

    A model selection that was stopped goes on where it was, when the same study runs again into the same folder.

    Example: pliant run examples/pneumatic_arm_pulses.toml -o results/arm
    """
    from pliant.study import load_study, run_study

    output = output or Path("results") / study.stem
    with progress_lines() as notify:
        loaded = load_study(study)
        if minutes is not None:
            loaded = loaded.with_minutes(minutes)
        outcome = run_study(loaded, output, progress=notify, workers=workers)
    if json:
        say((output / "metrics.json").read_text(encoding="utf-8"))
    else:
        say(repr(outcome))
        say(f"report: {output / 'report.html'}")
    if strict and outcome.headline is not None and outcome.headline.state == "missed":
        raise typer.Exit(1)
