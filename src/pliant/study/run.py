"""`run_study`: check, align, fit, predict, write."""

from __future__ import annotations

import json
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.files import whole, write_text
from pliant.identification import Experiment
from pliant.identification.drives import at_rest
from pliant.model import Model, save_model
from pliant.preprocessing.alignment import alignment_of
from pliant.study.angles import supported_links
from pliant.study.dense import link_experiment, shape_of
from pliant.study.fits import ladder_fit, run_ladder, rungs_of
from pliant.study.forecast import check_forecasts, run_forecast
from pliant.study.headline import headline
from pliant.study.prepare import all_planar, hardly_moved, study_experiment, study_model, without
from pliant.study.schema import Study
from pliant.study.side_by_side import run_fits
from pliant.study.verdict import verdict
from pliant.validation.outcome import Clocks, Shape, StudyOutcome
from pliant.validation.store import save_results
from pliant.version import __version__

Tell = Callable[[str], None]


def run_study(
    study: Study, folder: str | Path | None = None, *, progress: Tell | None = None, workers: int | None = None,
) -> StudyOutcome:
    """Run a study and, with a folder, write what it found.

    Parameters
    ----------
    study : Study
        From `load_study`.
    folder : str or Path, optional
        Takes model.json, metrics.json, study.json (resolved), results.nc and report.html. Made when absent; files in it
        are replaced one by one, each whole.
    progress : callable, optional
        Called with one line for each thing done.
    workers : int, optional
        Processes that make fits side by side where they take longer than a moment; default: one for each core. What is
        found does not depend on it.

    Returns
    -------
    StudyOutcome

    Raises
    ------
    InputError
        When a recording, an entry or the folder is not usable.
    FitError, SimulationError
        When a fit cannot start, or a prediction cannot be made.
    """
    began = clock.perf_counter()
    tell = progress or (lambda _line: None)
    target = writable(folder) if folder is not None else None
    ready = prepare_all(study, tell)
    study = without(study, ready.dropped)
    check_forecasts(study, ready.experiments)
    prepared = clock.perf_counter()
    model = ready.model
    climbed = run_ladder(study, ready.experiments, model, tell)
    fits = [ladder_fit(study, climbed, ready.experiments, tell)] if climbed else []
    fits += run_fits(study, ready.experiments, model, tell, workers)
    fitted = clock.perf_counter()
    first = fits[0].result
    forecasts = tuple(run_forecast(study, n, e, ready.experiments, first) for n, e in study.forecasts.items())
    outcome = StudyOutcome(
        study.name, study.title or study.name, study.description, replace(first.model, name=study.name), tuple(fits),
        forecasts, ready.shape, (), ready.findings, {"prepare_s": prepared - began, "fits_s": fitted - prepared},
        {"pliant": __version__, **ready.provenance}, climbed,
        clocks=ready.clocks,
    )
    outcome = replace(
        outcome, verdict=verdict(outcome, study.targets), headline=headline(outcome, study.targets)
    )
    if target is not None:
        outcome = write_outcome(study, outcome, target, began, tell)
    return outcome


def writable(folder: str | Path) -> Path:
    """The folder, made; InputError before any work is done when it cannot be written."""
    folder = Path(folder)
    probe = folder / ".writable"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(f"cannot write into the output folder {folder}: {error.strerror or error}") from None
    return folder


class Prepared(NamedTuple):
    """The recordings of a study, ready for fits."""

    experiments: dict[str, Experiment]
    model: Model  # as the study's actuator says, laid through the shape that decides the chain
    findings: dict[str, tuple[str, ...]]
    provenance: dict[str, str]
    shape: Shape | None  # of the recording that decides the chain, where shapes are dense
    dropped: Mapping[str, str]  # recordings that tell nothing, with the sentence that says why
    clocks: dict[str, Clocks]  # of recordings whose pressure was moved onto the shape's clock


def prepare_all(study: Study, tell: Tell) -> Prepared:
    """Read, align and, where the shape is dense, reduce every recording."""
    if study.ladder:
        rungs_of(study.ladder)  # refused before any work is done
    aligned = all_planar(study)
    shape = None
    if study.reduction:
        name = study.reduction.recording or next(iter(aligned))
        shape = shape_of(name, aligned[name].body, aligned[name].tip, study.reduction)
        tell(f"order from {name}: {shape.order.reason} The chain has {shape.links.n} links.")
    experiments, provenance = {}, {}
    rotation = None
    for name, (ds, _, _, clocks) in aligned.items():
        reduced = link_experiment(study, name, ds, shape.links) if shape else study_experiment(study, name, ds)
        experiments[name] = reduced
        digest = ds.attrs.get("source_sha256", "")
        provenance[name] = f"{ds.attrs.get('source', '')}{f' sha256 {digest}' if digest else ''}"
        if rotation is None and "alignment" in ds.attrs:
            rotation = np.array(alignment_of(ds).rotation)
        if clocks is not None:
            tell(f"{name}: {clocks.told}")
        unit, factor = reduced.shown_in
        tell(f"prepared {name}: {reduced.time.size} frames, travel {factor * reduced.travel:.3g} {unit}")
    model = study_model(study.actuator, rotation, shape.links if shape else None, supported_links(experiments))
    dropped = hardly_moved(experiments, model.length)
    idle = {n: told for n, e in experiments.items() if (told := at_rest(model, e))}
    for line in (*dropped.values(), *idle.values()):
        tell(line)
    findings = {n: (*a.findings, *(s[n] for s in (dropped, idle) if n in s)) for n, a in aligned.items()}
    found_clocks = {n: a.clocks for n, a in aligned.items() if a.clocks is not None}
    return Prepared(experiments, model, findings, provenance, shape, dropped, found_clocks)


def write_outcome(study: Study, outcome: StudyOutcome, folder: Path, began: float, tell: Tell) -> StudyOutcome:
    """Write resolved study, results and report, then metrics and model together: no model without its metrics."""
    from pliant.view.report import write_report  # loaded when something is written

    resolved: dict[str, Any] = study.model_dump(exclude_none=True)
    write_text(folder / "study.json", json.dumps(resolved, indent=1) + "\n")
    outcome = replace(outcome, timing={**outcome.timing, "total_s": clock.perf_counter() - began})
    save_results(outcome, folder)
    report = write_report(outcome, folder)
    outcome = replace(outcome, timing={**outcome.timing, "total_s": clock.perf_counter() - began})
    metrics = json.dumps(outcome.to_dict(), indent=1, allow_nan=False) + "\n"
    with whole(folder / "model.json") as model, whole(folder / "metrics.json") as draft:  # the inner one is first
        save_model(outcome.model, model)
        draft.write_text(metrics, encoding="utf-8")
    tell(f"wrote {report}")
    return outcome
