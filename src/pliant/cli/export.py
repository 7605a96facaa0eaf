"""`pliant export`: write a model, or the results of a run, in the format of another tool."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from pliant.cli.terminal import answer
from pliant.errors import InputError


def export(
    model: Annotated[Path, typer.Argument(help="Model file, or the folder of a run; mcap and lerobot need a folder.")],
    to: Annotated[str, typer.Option("--to", help="mjcf, c99, fmu, state-space, urdf, jax; for a run: mcap, lerobot.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write, with the suffix of the format.")],
    approximate: Annotated[
        bool, typer.Option("--approximate", help="Omit features that the format cannot express, and state the error.")
    ] = False,
    fit: Annotated[
        Path | None, typer.Option(help="metrics.json of the run, whose standard errors are written too.")
    ] = None,
    options: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="<name=value>", help="An option of the format, NAME=VALUE; may be repeated."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print what was written as JSON.")] = False,
) -> None:
    """Write a model for MuJoCo, C, an FMU, state space, URDF or JAX, or the motion of a run for MCAP or LeRobot.

    With the folder of a run, --set fit=NAME selects one of its fits; default: the first. MCAP files open in Foxglove
    and Rerun. A LeRobot data set is a folder. Both also accept --set records=A,B; LeRobot accepts --set fps=30.

    Example: pliant export results/demo --to mjcf -o finger.xml --set fit=softening --set prefix=left_
    """
    from pliant.cli.terminal import busy
    from pliant.validation.export_results import TARGETS

    chosen = {}
    for entry in options or ():
        name, equals, value = entry.partition("=")
        if not equals:
            raise InputError(f"--set needs NAME=VALUE, such as --set fps=30, got {entry!r}")
        chosen[name] = value
    with busy("exporting"):
        if to in TARGETS:
            if approximate or fit:
                raise InputError(f"--approximate and --fit are for models, and {to} exports the results of a run: "
                                 "remove them, or select by --set fit=NAME and --set records=NAME")
            done: Any = results_written(model, to, output, chosen)
        else:
            done = model_written(model, to, output, chosen, fit=fit, approximate=approximate)
    answer(done.to_dict(), repr(done), as_json=json)


def model_written(
    model: Path, target: str, output: Path, options: dict[str, str], *, fit: Path | None, approximate: bool,
) -> Any:
    """Write a model in the format of another tool: that of a file, or that of a fit from the folder of a run.

    For a folder, the entry `fit` of `options` names the fit, by default the first one.
    """
    from pliant.exporters import export
    from pliant.exporters.provenance import standard_errors
    from pliant.exporters.randomisation import uncertainty_within
    from pliant.exporters.registry import exporter_of
    from pliant.validation.sides import fit_named
    from pliant.validation.store import load_outcome

    draws = exporter_of(target).draws
    if not model.is_dir():
        errors, known = standard_errors(fit) if fit else None, uncertainty_within(model, fit) if draws and fit else None
        return export(model, target, output, approximate=approximate, standard_errors=errors, uncertainty=known,
                      **options)  # fmt: skip
    if fit:
        raise InputError("--fit belongs to a model file, and this is the folder of a run, from which the standard "
                         "errors of the exported fit are written anyway: remove --fit")
    name, outcome = options.pop("fit", ""), load_outcome(model)
    result = fit_named(outcome.fits, name).result
    errors = {p.name: p.std for p in result.parameters if p.std is not None}
    origin = (str(model), *(("--set", f"fit={name}") if name else ()))
    known = uncertainty_within(result.model, result) if draws else None
    return export(result.model.with_(name=outcome.name), target, output, approximate=approximate,
                  standard_errors=errors, uncertainty=known, origin=origin, **options)  # fmt: skip


def results_written(folder: Path, target: str, output: Path, options: dict[str, str]) -> Any:
    """Write the measured and modelled motion of a run as an MCAP file or a LeRobot data set. The keys of `options` are
    fit, records and fps (frames per second); their values are text.
    """
    from pliant.cli.figures import split
    from pliant.validation.export_results import export_results

    if unknown := sorted(set(options) - {"fit", "records", "fps"}):
        raise InputError(f"{target} has no option {unknown[0]!r}: its options are fit, records, fps")
    fps = options.get("fps", "0")
    if not fps.isdigit():
        raise InputError(f"fps must be a whole number of frames per second, got {fps!r}")
    return export_results(folder, target, output, fit=options.get("fit", ""),
                          records=split(options.get("records", "")), fps=int(fps))  # fmt: skip
