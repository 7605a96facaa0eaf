"""`pliant sweep`: many simulations or fits of a study, on one machine or a cluster."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pliant.cli.terminal import say

if TYPE_CHECKING:
    from pliant.model import Model
    from pliant.study import Study
    from pliant.sweep.spec import Sweep


def sweep(
    study: Annotated[Path, typer.Argument(help="Study with a [sweep] table; with --model that alone.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the samples; a sweep goes on there.")],
    scheduler: Annotated[str, typer.Option(help="local, processes, or tcp://host:port of a Dask scheduler.")] = "local",
    *,
    workers: Annotated[int | None, typer.Option(min=1, help="Worker processes; default one for each core.")] = None,
    model: Annotated[Path | None, typer.Option(help="Model file to start from, in place of the study's body.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed, in place of the file's.")] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure of the tips and of every number (.png or .svg).")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Run a design sweep, a Monte Carlo run, a bootstrap or a multi-start fit; go on where one stopped.

    The samples do not depend on the scheduler, nor on who worked on them.

    Example: pliant sweep sweep.toml --model results/arm/model.json -o results/sweep --figure spread.png
    """
    import json as jsonlib

    from pliant.cli.output import aligned, write_figure
    from pliant.cli.progress import busy, counting, mention
    from pliant.sweep.sweep import run_sweep

    with busy("preparing the model"):
        wanted, body, extra = prepare(study, model, seed)
    with counting("samples") as count:
        result = run_sweep(wanted, body, output, scheduler=scheduler, workers=workers, progress=mention, count=count,
                           **extra)
    if figure is not None:
        from pliant.validation.use_figures import sweep_figure

        write_figure(sweep_figure(result.samples), figure)
    summary = result.summary()
    if json:
        say(jsonlib.dumps(summary))
        return
    rows = [[name.replace("_", " "), *(f"{values[key]:.5g}" for key in ("median", "low", "high")), values["unit"]]
            for name, values in summary["numbers"].items() if values]
    say("\n".join(aligned([["", "median", "2.5 %", "97.5 %", "unit"], *rows])))
    say(f"{summary['samples']} samples, {summary['failed_samples']} of them failed; {summary['message']}")
    say(f"samples: {output / 'samples.nc'}")


def prepare(path: Path, model: Path | None, seed: int | None) -> tuple[Sweep, Model, dict[str, Any]]:
    """The sweep, the model it starts from, and for fits the recordings and parameters."""
    from pliant.errors import InputError
    from pliant.files import read_entries
    from pliant.model import load_model
    from pliant.study import load_study
    from pliant.sweep.spec import sweep_from

    content = read_entries(path, "study")
    if set(content) == {"sweep"}:
        alone = sweep_from(content["sweep"])
        if model is None or alone.kind in ("bootstrap", "multi_start"):
            raise InputError(f"{path} holds a [sweep] table alone: give a model by --model, and simulations to make of "
                             "it (kind design or monte_carlo); a fit needs a study with its recordings")
        return alone if seed is None else alone.model_copy(update={"seed": seed}), load_model(model), {}
    study = load_study(path)
    if study.sweep is None:
        raise InputError(f"study {path} has no [sweep] table: it says what to vary, and how often")
    wanted = study.sweep if seed is None else study.sweep.model_copy(update={"seed": seed})
    if wanted.kind in ("bootstrap", "multi_start"):
        return (wanted, *fitted(study, wanted, model))
    return wanted, load_model(model) if model else body_of(study), {}


def body_of(study: Study) -> Model:
    """The study's body; its recordings are read only where they give it its links or its gravity."""
    from pliant.study.prepare import study_model
    from pliant.study.run import prepare_all

    if study.reduction is None and study.actuator.gravity is None:
        return study_model(study.actuator, None)
    return prepare_all(study, lambda _line: None).model


def fitted(study: Study, wanted: Sweep, model: Path | None) -> tuple[Model, dict[str, Any]]:
    """The model, and what `pliant.fit` takes, of the fit that a sweep repeats."""
    from pliant.errors import InputError
    from pliant.identification.fit import parameters_from
    from pliant.identification.initial_guess import prepare as prepare_fit
    from pliant.model import load_model
    from pliant.study.run import prepare_all

    if not study.fits:
        raise InputError(
            f"a {wanted.kind} sweep repeats a fit, and study {study.name} has a [model_selection] alone: add what "
            "its stage frees as a [fits.NAME] table"
        )
    name = wanted.fit or next(iter(study.fits))
    if name not in study.fits:
        raise InputError(f"[sweep] names the fit {name!r}; the study has {', '.join(study.fits)}")
    entry = study.fits[name]
    ready = prepare_all(study, lambda _line: None)
    start = load_model(model) if model else ready.model
    records = [ready.experiments[r] for r in entry.train]
    ready_model, parameters = prepare_fit(records, start, parameters_from(entry.parameters))
    options = {"step": study.step, "loss": entry.loss, "weighting": entry.weighting}
    return ready_model, {"experiments": records, "parameters": parameters, "fit_options": options}
