"""`pliant sweep`: many simulations or fits of a study, on one machine or a cluster."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pliant.cli.output import telling

if TYPE_CHECKING:
    from pliant.model import Model
    from pliant.study import Study
    from pliant.sweep.spec import Sweep


def sweep(
    study: Annotated[Path, typer.Argument(help="Study file (TOML) with a table called sweep.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the samples; a sweep goes on there.")],
    scheduler: Annotated[str, typer.Option(help="local, processes, or tcp://host:port of a Dask scheduler.")] = "local",
    *,
    workers: Annotated[int | None, typer.Option(min=1, help="Worker processes; default one for each core.")] = None,
    model: Annotated[Path | None, typer.Option(help="Model file to start from, in place of the study's body.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed, in place of the file's.")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Tell nothing but the result.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Run a design sweep, a Monte Carlo run, a bootstrap or a multi-start fit; go on where one stopped.

    The samples do not depend on the scheduler, nor on who worked on them.

    Example: pliant sweep study.toml --scheduler processes -o results/sweep
    """
    import json as jsonlib

    from pliant.sweep.sweep import run_sweep

    wanted, body, extra = prepare(study, model, seed)
    with telling(quiet=quiet) as tell:
        result = run_sweep(wanted, body, output, scheduler=scheduler, workers=workers, progress=tell, **extra)
    summary = result.summary()
    if json:
        typer.echo(jsonlib.dumps(summary))
        return
    for name, spread in summary["numbers"].items():
        if spread:
            typer.echo(f"{name:<28} {spread['median']:.5g} ({spread['low']:.5g} ... {spread['high']:.5g}, 95 %)")
    typer.echo(f"{summary['samples']} samples, {summary['failed_samples']} of them failed; {summary['told']}")
    typer.echo(f"samples: {output / 'samples.nc'}")


def prepare(path: Path, model: Path | None, seed: int | None) -> tuple[Sweep, Model, dict[str, Any]]:
    """The sweep, the model it starts from, and for fits the recordings and parameters."""
    from pliant.errors import InputError
    from pliant.model import load_model
    from pliant.study import load_study

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
            f"a {wanted.kind} sweep repeats a fit, and study {study.name} has a [ladder] alone: add what its rung "
            "frees as a [fits.NAME] table"
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
