"""`run_study`: check and align the recordings, fit models, predict the held-out recordings, and write the results.
`design_study` fits the model, and ranks further recordings by the information that they would add.
"""

from __future__ import annotations

import json
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pliant.errors import FitError, InputError
from pliant.failures import FAILED, Failures, NotComputed, fit_failure
from pliant.files import output_folder, replaced_together, write_text
from pliant.identification import Experiment
from pliant.identification.design import Design, design
from pliant.identification.drives import at_rest, driving
from pliant.identification.starts import start_note
from pliant.model import Model, save_model
from pliant.preprocessing.side import alignment_of
from pliant.recording.inputs import recorded_inputs
from pliant.selection import ModelSelection
from pliant.selection.saved import SearchFile
from pliant.simulation import Trace
from pliant.study.aligned import Aligned
from pliant.study.another_day import run_days, signs_of
from pliant.study.body import reduced_recording, study_model, with_azimuths
from pliant.study.body_tables import ActuatorEntry
from pliant.study.dense import link_experiment, shape_of
from pliant.study.doubts import model_warnings, recording_warnings, term_warnings, unit_warning_first
from pliant.study.fits import run_fit, run_model_selection, selection_fit
from pliant.study.forecast import check_forecasts, run_forecasts
from pliant.study.parallel_fits import run_fits
from pliant.study.prepare import (
    all_aligned,
    beyond_reach,
    left_out_columns,
    study_experiment,
    supported_links,
    without,
    without_motion,
)
from pliant.study.schema import Fit, SelectionEntry, Study
from pliant.study.verdict import headline, verdict
from pliant.study.wiring import compare_wirings, wiring_warnings
from pliant.validation.baseline import Mapped, mapped, with_baseline
from pliant.validation.outcome import Clocks, FitOutcome, Shape, StudyOutcome, in_recorded_axes
from pliant.validation.plain_map import PlainMap, plain_map
from pliant.validation.store import save_results
from pliant.version import __version__

Notify = Callable[[str], None]
WRITTEN = ("study.json", "results.nc", "report.html", "model.json", "metrics.json")  # the last marks a whole set
LOG, SEARCH = "run.log", "search.json"  # lines of progress; what a model selection has reached, until the run ends


def run_study(
    study: Study, folder: str | Path | None = None, *, progress: Notify | None = None, workers: int | None = None,
) -> StudyOutcome:
    """Run a study; if a folder is given, write its results there.

    Parameters
    ----------
    study : Study
        Study as `load_study` returns it.
    folder : str or Path, optional
        Folder for model.json, metrics.json, study.json (resolved), results.nc and report.html, created if it is absent.
        These files are replaced together once all are written. Other files in the folder are not touched.
    progress : callable, optional
        Called with a line of text after each step.
    workers : int, optional
        Number of processes that compute fits in parallel, if the fits take longer than 2 s. Default: one for each core.
        The results do not depend on it.

    Returns
    -------
    StudyOutcome

    Raises
    ------
    InputError
        When a recording, an entry or the folder is not usable.
    FitError
        When nothing can be computed: no fit, or no recording of any fit. If only some fits, predictions, bands or
        forecasts cannot be computed, they are listed in `StudyOutcome.not_computed`.
    """
    began = clock.perf_counter()
    notify = progress or (lambda _line: None)
    with output_folder(folder) if folder is not None else nullcontext() as target, ExitStack() as log:
        ready = prepare_all(study, notify)
        study = without(study, ready.dropped, ready.doubts).model_copy(update={"actuator": ready.actuator})
        check_forecasts(study, ready.experiments)
        prepared = clock.perf_counter()
        notify = notify if target is None else log.enter_context(logged(notify, target, began))
        wirings = compare_wirings(study, ready.bodies, ready.model, notify)
        file = None if target is None else SearchFile(target / SEARCH, search_key(study, ready))
        ends, selection = all_fits(study, ready, notify, workers, file)
        fits, failed = computed(ends)
        fitted = clock.perf_counter()
        fits = with_baselines(study, fits, ready.experiments, ready.bodies, notify)
        compared = clock.perf_counter()
        days, adaptations, lost = run_days(study, fits, ready.experiments, notify)
        fits = (*fits, *days)
        first = fits[0].result
        failures = Failures(fits[0].name, notify)
        results = {"": first, **{fit.name: fit.result for fit in fits}}
        forecasts = run_forecasts(study, ready.experiments, results, failures)
        outcome = StudyOutcome(
            study.name, study.title or study.name, study.description, replace(first.model, name=study.name), fits,
            forecasts, ready.shape, (), ready.findings,
            {"prepare_s": prepared - began, "fits_s": fitted - prepared, "plain_maps_s": compared - fitted},
            {"pliant": __version__, **ready.provenance}, selection, clocks=ready.clocks,
            failed=(*failed, *failures, *lost), wirings=wirings, adaptations=adaptations,
            doubts=(*ready.doubts, *wiring_warnings(wirings), *fit_warnings(study, fits, ready)),
        )
        outcome = replace(
            outcome, verdict=verdict(outcome, study.targets), headline=headline(outcome, study.targets)
        )
        outcome = in_recorded_axes(
            outcome, {n: f.like for n, f in study.forecasts.items()},
            signs_of(outcome, ready.experiments),
        )
        if target is not None:
            outcome = write_outcome(study, outcome, target, began, notify)
        return outcome


def fit_warnings(study: Study, fits: Sequence[FitOutcome], ready: PreparedStudy) -> tuple[str, ...]:
    """Return warnings about links from a held-out recording, about implausible models, and about terms of fits that
    their recordings do not determine.
    """
    stated = [(f.title, f.result, [ready.experiments[r] for r in study.fits[f.name].train])
              for f in fits if f.name in study.fits]  # fmt: skip
    models = [(f.title, f.result.model) for f in fits]
    return *reduction_warnings(study), *model_warnings(models, study.actuator), *term_warnings(stated, ready.model)


def reduction_warnings(study: Study) -> tuple[str, ...]:
    """Return a warning if the links come from a recording that a fit holds out."""
    held_out = {name for entry in study.fits.values() for name in entry.held_out}
    held_out |= set(study.model_selection.held_out if study.model_selection else ())
    if study.reduction is None or reduced_recording(study) not in held_out:
        return ()
    line = (f"the links, and with them the shape at rest, come from {reduced_recording(study)}, which is held out: its "
            "prediction is not blind. Name a training recording in [reduction].")  # fmt: skip
    return (line,)


@contextmanager
def logged(notify: Notify, folder: Path, began: float) -> Iterator[Notify]:
    """Context manager that yields a function that passes each line of progress on and adds it, with the seconds since
    `began`, to a new log in the folder. A full disk ends the log, not the run. A run that fails leaves none, unless it
    can go on.
    """
    path = folder / LOG

    def note(line: str) -> None:
        with suppress(OSError), path.open("a", encoding="utf-8") as file:
            file.write(f"{clock.perf_counter() - began:8.1f} s  {line}\n")
        notify(line)

    with suppress(OSError):
        path.unlink(missing_ok=True)
    try:
        yield note
    except BaseException:  # Ctrl-C among them
        if not (folder / SEARCH).exists():
            with suppress(OSError):
                path.unlink(missing_ok=True)
        raise


def search_key(study: Study, ready: PreparedStudy) -> str:
    """Return a digest of all that decides the result of a model selection: study, recordings, version."""
    entries = study.model_dump(mode="json", exclude={"title", "description", "targets", "fits", "forecasts"})
    if study.model_selection is not None:
        entries["model_selection"].pop("minutes")
    content = [__version__, entries, ready.provenance]
    return sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


def all_fits(
    study: Study, ready: PreparedStudy, notify: Notify, workers: int | None, file: SearchFile | None = None,
) -> tuple[list[tuple[str, FitOutcome | Exception]], ModelSelection | None]:
    """Compute the model selection and every fit of a study; return a pair (name, outcome or error) for each, and the
    result of the selection.
    """
    ends: list[tuple[str, FitOutcome | Exception]] = []
    chosen = None
    try:
        chosen = run_model_selection(study, ready.experiments, ready.model, notify, file)
        ends += [("model_selection", selection_fit(study, chosen, ready.experiments, notify))] if chosen else []
    except FAILED as error:
        notify(f"warning: {fit_failure('model_selection', error).sentence}")
        ends.append(("model_selection", error))
    return ends + run_fits(study, ready.experiments, ready.model, notify, workers), chosen


def computed(ends: Sequence[tuple[str, FitOutcome | Exception]]) -> tuple[tuple[FitOutcome, ...], list[NotComputed]]:
    """Return the outcomes of the fits that could be computed, and for each other fit a description of its failure.

    Raises
    ------
    InputError, FitError
        When no recording of any fit could be computed.
    """
    fits = tuple(end for _, end in ends if isinstance(end, FitOutcome))
    errors = {name: end for name, end in ends if isinstance(end, Exception)}
    if any(fit.records for fit in fits):
        return fits, [fit_failure(name, error) for name, error in errors.items()]
    reasons = [f"fit {name}: {error}" for name, error in errors.items()]
    reasons += [f"fit {fit.name}: no record could be computed: {fit.not_computed[0].reason}" for fit in fits]
    refused = errors and not fits and all(isinstance(error, InputError) for error in errors.values())
    raise (InputError if refused else FitError)("; ".join(reasons))


class PreparedStudy(NamedTuple):
    """The recordings of a study as experiments, with its model, ready for fits."""

    experiments: dict[str, Experiment]
    model: Model  # of the study's actuator, with links on the dense shape if there is one
    actuator: ActuatorEntry  # as the study states it, with missing azimuths estimated
    findings: dict[str, tuple[str, ...]]
    provenance: dict[str, str]
    bodies: Mapping[str, xr.Dataset]  # the aligned recordings
    shape: Shape | None  # of the recording that determines the links, for dense shapes
    dropped: Mapping[str, str]  # recordings without usable motion, each with the reason
    clocks: dict[str, Clocks]  # of recordings whose pressure was moved onto the shape's clock
    doubts: tuple[str, ...]  # warnings about recordings and body


def prepare_all(study: Study, notify: Notify) -> PreparedStudy:
    """Read and align every recording of the study, and reduce dense shapes to links."""
    aligned = all_aligned(study)
    doubts = recording_warnings(aligned)
    for line in doubts:
        notify(f"warning: {line}")
    doubted = {f"{n} {check}": f"recording {n}: {line}" for n, a in aligned.items() for check, line in a.doubts.items()}
    with unit_warning_first(doubted):
        return assembled(study, aligned, doubts, notify)


def assembled(study: Study, aligned: Mapping[str, Aligned], doubts: tuple[str, ...], notify: Notify) -> PreparedStudy:
    """Build the experiments and the model of the study from its recordings in the base frame."""
    shape = None
    if study.reduction:
        name = reduced_recording(study)
        shape = shape_of(name, aligned[name].body, aligned[name].tip, study.reduction)
        notify(f"order from {name}: {shape.order.reason} The chain has {shape.links.n} links.")
    experiments, provenance = {}, {}
    rotation = None
    for name, record in aligned.items():
        recording, clocks = record.body, record.clocks
        reduced = (
            link_experiment(study, name, recording, shape.links) if shape else study_experiment(study, name, recording)
        )
        experiments[name] = reduced
        digest = recording.attrs.get("source_sha256", "")
        provenance[name] = f"{recording.attrs.get('source', '')}{f' sha256 {digest}' if digest else ''}"
        if rotation is None and "alignment" in recording.attrs:
            rotation = np.array(alignment_of(recording).rotation)
        if clocks is not None:
            notify(f"{name}: {clocks.message}")
        for line in left_out_columns(recording):
            notify(f"{name}: {line}")
        unit, factor = reduced.shown_in
        notify(f"prepared {name}: {reduced.time.size} frames, peak displacement {factor * reduced.travel:.3g} {unit}")
    actuator = with_azimuths(study, experiments, notify)
    model = study_model(actuator, rotation, shape.links if shape else None, supported_links(experiments),
                        min((e.x_sign for e in experiments.values()), default=1))
    far = beyond_reach(experiments, model)
    dropped = without_motion(experiments, model.length) | far
    doubts = (*doubts, *(f"{line}." for line in far.values()))
    idle = {n: reason for n, e in experiments.items() if (reason := at_rest(model, e))}
    begun = {n: note for n, e in experiments.items() if (note := start_note(e))}
    for line in (*dropped.values(), *idle.values(), *(f"{n}: {note}" for n, note in begun.items())):
        notify(line)
    findings = {n: (*a.findings, *(s[n] for s in (dropped, idle, begun) if n in s)) for n, a in aligned.items()}
    found_clocks = {n: a.clocks for n, a in aligned.items() if a.clocks is not None}
    bodies = {n: a.body for n, a in aligned.items()}
    return PreparedStudy(
        experiments, model, actuator, findings, provenance, bodies, shape, dropped, found_clocks, doubts
    )


def write_outcome(study: Study, outcome: StudyOutcome, folder: Path, began: float, notify: Notify) -> StudyOutcome:
    """Write the study, its results, report, model and metrics into `folder` together, so that files of different runs
    never mix.
    """
    from pliant.view.report import write_report  # loaded when something is written

    resolved: dict[str, Any] = study.model_dump(exclude_none=True)
    with replaced_together(folder, WRITTEN) as draft:
        write_text(draft / "study.json", json.dumps(resolved, indent=1) + "\n")
        outcome = replace(outcome, timing={**outcome.timing, "total_s": clock.perf_counter() - began})
        outcome = replace(outcome, run_id=run_id(outcome))
        save_results(outcome, draft)
        write_report(outcome, draft)
        save_model(outcome.model, draft / "model.json")
        outcome = replace(outcome, timing={**outcome.timing, "total_s": clock.perf_counter() - began})
        write_text(draft / "metrics.json", json.dumps(outcome.to_dict(), indent=1, allow_nan=False) + "\n")
    if outcome.model_selection is None or outcome.model_selection.complete:
        with suppress(OSError):
            (folder / SEARCH).unlink(missing_ok=True)
    notify(f"wrote {folder / 'report.html'}")
    return outcome


def run_id(outcome: StudyOutcome) -> str:
    """Return a digest of everything in metrics.json, run times included, so that it differs between runs."""
    return sha256(json.dumps(outcome.to_dict(), allow_nan=False).encode()).hexdigest()[:16]


def design_study(
    study: Study, *, highest: float | Mapping[str, float] | None = None, criterion: str = "E",
    progress: Callable[[str], None] | None = None,
) -> Design:
    """Fit a study's model and rank candidate recordings by how much each would reduce the uncertainty of the
    parameters.

    Parameters
    ----------
    study : Study
    highest : float or mapping, optional
    criterion : {"E", "D"}
        As in `pliant.identification.design.design`.

    Raises
    ------
    InputError, FitError
        As `run_study`.
    """
    notify = progress or (lambda _line: None)
    ready = prepare_all(study, notify)
    study = without(study, ready.dropped)
    model = ready.model
    selection = run_model_selection(study, ready.experiments, model, notify)
    if selection is not None:
        fitted = selection_fit(study, selection, ready.experiments, notify)
    else:
        name = next(iter(study.fits))
        fitted = run_fit(study, name, ready.experiments, model, notify, {})
    train = [r.experiment for r in fitted.records if r.role == "train"]
    return design(fitted.result, train, highest=highest, criterion=criterion)


def with_baselines(
    study: Study, fits: Sequence[FitOutcome], experiments: Mapping[str, Experiment], bodies: Mapping[str, xr.Dataset],
    notify: Callable[[str], None],
) -> tuple[FitOutcome, ...]:
    """Return the fits, each with the predictions of a plain map that is fitted to the same training recordings.

    A map that cannot be computed is listed in `not_computed` of its fit.
    """
    entries: dict[str, Fit | SelectionEntry] = dict(study.fits)
    if study.model_selection is not None:
        entries["model_selection"] = study.model_selection
    spare = {name: spare_inputs(study, name, body) for name, body in bodies.items()}
    maps: dict[tuple[str, ...], tuple[PlainMap, dict[str, Mapped | str]]] = {}
    compared = []
    for fit in fits:
        train = tuple(entries[fit.name].train)
        failures = Failures(fit.name, notify)

        def baselined(fit: FitOutcome = fit, train: tuple[str, ...] = train) -> FitOutcome:
            if train not in maps:
                plain = plain_map([experiments[name] for name in train])
                notify(f"plain map of {', '.join(train)}: {plain.title}")
                maps[train] = plain, {}
            plain, known = maps[train]
            for record in (r for r in fit.records if r.name not in known):
                known[record.name] = mapped(plain, record.experiment, fit.result.model.length)
            return with_baseline(fit, plain, spare, known)

        done = failures.attempt("plain map", "", baselined) or fit
        compared.append(replace(done, not_computed=(*done.not_computed, *failures)))
    return tuple(compared)


def spare_inputs(study: Study, name: str, recording: xr.Dataset) -> dict[str, Trace]:
    """Return the recorded inputs, as time series by name, that drive no input of the study's model."""
    inputs = recorded_inputs(recording)
    drive = study.recordings[name].drive
    if not drive:
        return {}
    used = {signal.name for signal in driving(name, recording, drive).values()}
    return {signal.name: Trace(signal.time, np.array(signal.values)) for signal in inputs
            if signal.name not in used and np.isfinite(signal.values).all()}
