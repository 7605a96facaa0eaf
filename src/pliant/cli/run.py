"""`pliant run` and `pliant adapt`: from a study to a validated model, and from this to another day's model."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, TypedDict, Unpack

import typer

from pliant.cli.terminal import also_takes, in_unit, progress_lines, say
from pliant.errors import InputError


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


class DayOptions(TypedDict):
    """Options of `pliant adapt` that are declared apart, because a function takes at most eight parameters."""

    warm_up: Annotated[
        float | None, typer.Option("--warm-up", parser=in_unit("s", least=0.0), help="Time from the first frame that "
                                   "is simulated, but not compared, s; default: that of the recording of --like.")
    ]
    spread: Annotated[
        float | None, typer.Option("--spread", parser=in_unit("%", least=0.0), help="With --of-a-kind: standard "
                                   "deviation between robots of the kind, % of each parameter; default: 15.")
    ]


@also_takes(DayOptions, warm_up=None, spread=None)
def adapt(
    results: Annotated[
        list[Path], typer.Argument(help="Results folder of `pliant run`, or of an earlier adaptation; with --of-a-kind "
                                        "one for each known robot of the kind.")
    ],
    recording: Annotated[
        list[Path], typer.Option("--recording", help="Recording of the other day; can be repeated. What follows the "
                                                     "first seconds judges the model.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="New folder for model, metrics, results and report.")],
    seconds: Annotated[
        float, typer.Option("--seconds", parser=in_unit("s", least=0.0), help="Duration of the motion to fit, s, "
                                                                              "warm-up included.")
    ] = 20.0,
    fit: Annotated[str, typer.Option("--fit", help="Fit to start from; default: the first of the results.")] = "",
    like: Annotated[
        str, typer.Option("--like", help="Recording of the study whose columns, alignment and inputs apply; default: "
                                         "the first training recording.")
    ] = "",
    of_a_kind: Annotated[
        bool, typer.Option("--of-a-kind", help="The recording is of another robot of the same kind: each "
                            "parameter of the body may differ by --spread; three or more results tell the spread.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print metrics.json on standard output.")] = False,
    **day: Unpack[DayOptions],
) -> None:
    """Adapt a fitted model to another day: fit the mounting, update the body, and say what changed.

    The results of the earlier run are not changed. The exit code is 1 if the recording is of another arm.

    Example: pliant adapt results/arm --recording may.csv -o results/arm_may
    """
    from pliant.study.adapted_run import adapt as adapted
    from pliant.study.schema import SPREAD

    percent = day["spread"]
    if percent is not None and not of_a_kind:
        raise InputError("--spread is the spread between robots of one kind: state --of-a-kind too, or leave it out")
    if percent is not None and not 0.0 < percent < math.inf:
        raise InputError(f"--spread is a number of % above 0, such as 15, got {percent:g}")
    spread = SPREAD if percent is None else percent / 100.0
    with progress_lines() as notify:
        outcome = adapted(results, recording, output, seconds=seconds, fit=fit, like=like, warm_up=day["warm_up"],
                          spread=spread if of_a_kind else None, progress=notify)
    adaptation = outcome.adaptations["adapted"]
    if json:
        say((output / "metrics.json").read_text(encoding="utf-8"))
    else:
        say(repr(adaptation))
        say(f"report: {output / 'report.html'}")
    if adaptation.verdict == "another arm":
        raise typer.Exit(1)
