"""`pliant sweep`: run many simulations or fits of a study, on one machine or a cluster."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pliant.cli.terminal import answer

if TYPE_CHECKING:
    from pliant.model import Model
    from pliant.study import Study
    from pliant.sweep.spec import Sweep

WHERE = "local, processes, tcp://host:port of a Dask scheduler; gpu: in JAX on a GPU; jax: on the device of JAX."


def sweep(
    study: Annotated[Path, typer.Argument(help="Study with a [sweep] table; with --model, [sweep] alone is enough.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for samples; continues a stopped sweep.")],
    where: Annotated[str, typer.Option("--scheduler", "--device", help=WHERE)] = "local",
    *,
    workers: Annotated[int | None, typer.Option(min=1, help="Worker processes; default: one per core.")] = None,
    model: Annotated[Path | None, typer.Option(help="Model file, or results folder, for the study's body.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed to use instead of the file's.")] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure of the tips and of every result (.png or .svg).")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Run a design sweep, a Monte Carlo run, a bootstrap or a multi-start fit, or continue one that stopped.

    The samples do not depend on the scheduler or the number of workers.

    Example: pliant sweep sweep.toml --model results/arm/model.json -o results/sweep --figure spread.png
    """
    from pliant.batch.batch import DEVICES
    from pliant.cli.output import aligned, write_figure
    from pliant.cli.terminal import busy, counting, mention
    from pliant.sweep.sweep import run_sweep

    with busy("preparing the model"):
        wanted, body, extra = prepare(study, model, seed)
    with counting("samples") as count:
        device, scheduler = (where, "local") if where in ("cpu", *DEVICES) else ("cpu", where)
        result = run_sweep(wanted, body, output, scheduler=scheduler, workers=workers, progress=mention, count=count,
                           device=device, **extra)
    if figure is not None:
        from pliant.validation.use_figures import sweep_figure

        write_figure(sweep_figure(result.samples), figure)
    summary = result.summary()
    rows = [[name.replace("_", " "), *(f"{values[key]:.5g}" for key in ("median", "low", "high")), values["unit"]]
            for name, values in summary["numbers"].items() if values]
    lines = [*aligned([["", "median", "2.5 %", "97.5 %", "unit"], *rows]),
             f"{summary['samples']} samples, {summary['failed_samples']} of them failed; {summary['message']}",
             f"samples: {output / 'samples.nc'}"]  # fmt: skip
    answer(summary, "\n".join(lines), as_json=json)


def prepare(path: Path, model: Path | None, seed: int | None) -> tuple[Sweep, Model, dict[str, Any]]:
    """Return the sweep stated in the file `path`, the model to start from and, for a sweep of fits, the recordings,
    parameters and options of the fit.
    """
    from pliant.errors import InputError
    from pliant.files import read_entries
    from pliant.model import load_model
    from pliant.study import load_study
    from pliant.sweep.spec import sweep_from

    content = read_entries(path, "study")
    if set(content) == {"sweep"}:
        alone = sweep_from(content["sweep"])
        if model is None or alone.kind in ("bootstrap", "multi_start"):
            raise InputError(f"{path} holds a [sweep] table alone, which needs --model and kind design or monte_carlo; "
                             "to repeat a fit, use a study with its recordings")
        return alone if seed is None else alone.model_copy(update={"seed": seed}), load_model(model), {}
    study = load_study(path)
    if study.sweep is None:
        raise InputError(f"study {path} has no [sweep] table: add one that says what to vary, and how often")
    wanted = study.sweep if seed is None else study.sweep.model_copy(update={"seed": seed})
    if wanted.kind in ("bootstrap", "multi_start"):
        return (wanted, *fitted(study, wanted, model))
    return wanted, load_model(model) if model else body_of(study), {}


def body_of(study: Study) -> Model:
    """Return the model of the study's body; recordings are read only if its links or its gravity depend on them."""
    from pliant.study.body import study_model
    from pliant.study.run import prepare_all

    if study.reduction is None and study.actuator.gravity is None:
        return study_model(study.actuator, None)
    return prepare_all(study, lambda _line: None).model


def fitted(study: Study, wanted: Sweep, model: Path | None) -> tuple[Model, dict[str, Any]]:
    """Return the model and the arguments of `pliant.fit` for the fit that a sweep repeats."""
    from pliant.errors import InputError
    from pliant.identification.fit import parameters_from
    from pliant.identification.initial_guess import prepare as prepare_fit
    from pliant.model import load_model
    from pliant.study.run import prepare_all

    if not study.fits:
        raise InputError(
            f"a {wanted.kind} sweep repeats a fit, but study {study.name} has only a [model_selection]: add the "
            "free parameters of its stage as a [fits.NAME] table"
        )
    name = wanted.fit or next(iter(study.fits))
    if name not in study.fits:
        raise InputError(f"[sweep] names the fit {name!r}, but the study has {', '.join(study.fits)}: choose one")
    entry = study.fits[name]
    ready = prepare_all(study, lambda _line: None)
    start = load_model(model) if model else ready.model
    records = [ready.experiments[r] for r in entry.train]
    ready_model, parameters = prepare_fit(records, start, parameters_from(entry.parameters))
    options = {"time_step": study.time_step, "loss": entry.loss, "weighting": entry.weighting}
    return ready_model, {"experiments": records, "parameters": parameters, "fit_options": options}
