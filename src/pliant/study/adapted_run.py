"""Results of an earlier run, adapted to recordings of another day."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypedDict, Unpack

import numpy as np

from pliant.adaptation import Adaptation, posterior_of
from pliant.errors import InputError
from pliant.files import output_folder
from pliant.identification import Experiment
from pliant.options import with_defaults
from pliant.study.another_day import Robot, adapted_fits, earlier_names, learning_of, signs_of
from pliant.study.body import reduced_recording
from pliant.study.run import PreparedStudy, prepare_all, write_outcome
from pliant.study.schema import SPREAD, AdaptEntry, Recording, Study, day_names, load_study
from pliant.study.verdict import headline, verdict
from pliant.validation.outcome import FitOutcome, StudyOutcome, in_recorded_axes
from pliant.validation.store import held_out_errors, load_fit
from pliant.version import __version__

Notify = Callable[[str], None]


class AdaptOptions(TypedDict, total=False):
    """Keyword options of `adapt`, where they are documented."""

    seconds: float
    fit: str
    like: str
    spread: float | None
    warm_up: float | None


ADAPT_OPTIONS: AdaptOptions = {"seconds": 20.0, "fit": "", "like": "", "spread": None, "warm_up": None}


def adapt(
    results: str | Path | Sequence[str | Path], recordings: str | Path | Sequence[str | Path], folder: str | Path, *,
    progress: Notify | None = None, **options: Unpack[AdaptOptions],
) -> StudyOutcome:
    """Adapt the model of an earlier run to the first seconds of another day, and write the results to a new folder.

    Parameters
    ----------
    results : path or sequence of paths
        Results folder of `pliant run` or of an earlier adaptation; with `spread` one for each known robot of the kind.
    recordings : path or sequence of paths
        Recordings of the other day, in their order. What follows the first `seconds` judges the model.
    folder : path
        New folder for the results. It must not hold results.
    seconds : float
        Duration of the motion to fit, s, warm-up included.
    fit : str
        Fit to start from; default: the first of the results.
    like : str
        Recording of the study whose entries (columns, alignment, inputs) apply to the new ones; default: the first
        training recording.
    spread : float, optional
        For another robot of the kind: standard deviation between robots, as a fraction of each parameter.
    warm_up : float, optional
        Time from the first frame of each recording, s, that is simulated, but not compared; default: that of the
        recording `like`.
    progress : callable, optional
        Called with a line of text after each step.

    Returns
    -------
    StudyOutcome
        With the fits "adapted" and "adapted_before", and the verdict in `adaptations`.

    Raises
    ------
    InputError
        When results or recordings cannot be used, or the folder holds results already.
    FitError
        When the model cannot be simulated.
    TypeError
        For an unknown keyword.
    """
    how = with_defaults(adapt, options, ADAPT_OPTIONS)
    fit, spread = how["fit"], how["spread"]
    began, notify = clock.perf_counter(), progress or (lambda _line: None)
    sources = [Path(r) for r in ([results] if isinstance(results, str | Path) else results)]
    files = [Path(r) for r in ([recordings] if isinstance(recordings, str | Path) else recordings)]
    refuse_folder(Path(folder), sources, kind=spread is not None)
    study = load_study(sources[0] / "study.json")
    loaded = [load_fit(source, fit) for source in sources]
    robots = [Robot(result, posterior_of(result, known_names(source)), title, held_out_errors(source, name))
              for source, (name, title, result) in zip(sources, loaded, strict=True)]
    new = new_recordings(study, files, how["like"] or first_training(study, loaded[0][0]), how["warm_up"])
    entry = AdaptEntry(recordings=list(new), fit=loaded[0][0] if loaded[0][0] not in day_names(study) else "",
                       seconds=how["seconds"], of_a_kind=spread is not None, spread=spread or SPREAD)  # fmt: skip
    ready = prepare_all(study_of_day(study, new), notify)
    if lost := [line for name, line in ready.dropped.items() if name in new]:
        raise InputError(f"{lost[0]}; use a recording in which the arm moves")
    name = "adapted"
    learning = learning_of(study, loaded[0][0])
    earlier = partial(earlier_recordings, study, earlier_names(study, loaded[0][0]), notify)
    fits, adaptation = adapted_fits(name, entry, robots, ready.experiments, notify, learning, earlier)
    with output_folder(folder) as target:
        whole = study.model_copy(update={"recordings": {**study.recordings, **new}, "adapt": [*study.adapt, entry]})
        outcome = outcome_of_day(whole, ready, fits, {name: adaptation}, sources)
        return write_outcome(whole, outcome, target, began, notify)


def refuse_folder(folder: Path, sources: Sequence[Path], *, kind: bool) -> None:
    """Raise InputError if a new folder holds results, or there are several sources for one robot."""
    if any(folder.resolve() == source.resolve() for source in sources) or (folder / "metrics.json").exists():
        raise InputError(f"{folder} holds the results of a run, which an adaptation never replaces: name a new folder")
    if len(sources) > 1 and not kind:
        raise InputError(f"{len(sources)} results are given, but one arm on another day has one: name one, or state "
                         "that the recording is of another robot of their kind (--of-a-kind)")  # fmt: skip


def known_names(folder: Path) -> set[str]:
    """Return the names of all recordings of a run's study."""
    return set(load_study(folder / "study.json").recordings)


def first_training(study: Study, fit: str) -> str:
    """Return the name of the first training recording of a fit of the study."""
    return learning_of(study, fit).train[0]


def new_recordings(
    study: Study, files: Sequence[Path], like: str, warm_up: float | None = None,
) -> dict[str, Recording]:
    """Return entries of new recordings, which take all but file, part and start from the recording `like` of the
    study; the warm-up [s] too unless it is stated. Each start follows from the recording's own first frames.
    """
    if like not in study.recordings:
        raise InputError(f"--like names recording {like!r}, which is not one of {', '.join(study.recordings)}")
    shared = study.recordings[like]
    if shared.pressure_file is not None:
        raise InputError(f"recording {like} has its pressure in a file of its own: add the new recording and its "
                         "pressure_file to the study, with a table [adapt], and run the study")  # fmt: skip
    if warm_up is not None and not 0.0 <= warm_up < np.inf:
        raise InputError(f"the warm-up must be a finite time of at least 0 s, got {warm_up:g}")
    new: dict[str, Recording] = {}
    for file in files:
        if not file.is_file():
            raise InputError(f"there is no recording {file}: name a file")
        name = file.stem.replace(".", "_")
        taken = {*study.recordings, *new}
        name = next(n for n in (name, *(f"{name}_{k}" for k in range(2, len(taken) + 3))) if n not in taken)
        differs = {"file": str(file.resolve()), "window": None, "part": None, "start": None}
        stated = {} if warm_up is None else {"warm_up": warm_up}
        new[name] = shared.model_copy(update=differs | stated)
    return new


def study_of_day(study: Study, new: Mapping[str, Recording]) -> Study:
    """Return the study that reads the new recordings, and those that fix the axes and the links of all."""
    fixing, reduction = [next(iter(study.recordings))], study.reduction
    if reduction is not None:
        reduction = reduction.model_copy(update={"recording": reduced_recording(study)})
        fixing.append(reduced_recording(study))
    return study.model_copy(update={
        "recordings": {**{name: study.recordings[name] for name in fixing}, **new}, "reduction": reduction, "fits": {},
        "model_selection": None, "forecasts": {}, "wiring": None, "adapt": [],
    })  # fmt: skip


def earlier_recordings(study: Study, names: Sequence[str], notify: Notify) -> list[Experiment]:
    """Return the recordings of an earlier fit; none, with a warning, if their files cannot be read any more."""
    try:
        ready = prepare_all(study_of_day(study, {n: study.recordings[n] for n in names}), notify)
    except InputError as error:
        notify(f"warning: the recordings of the earlier fit cannot be read: {error}")
        return []
    return [ready.experiments[n] for n in names if n in ready.experiments]


def outcome_of_day(
    study: Study, ready: PreparedStudy, fits: tuple[FitOutcome, FitOutcome], adaptations: Mapping[str, Adaptation],
    sources: Sequence[Path],
) -> StudyOutcome:
    """Return the results of an adaptation as those of a study, with the verdict on the arm first."""
    (adaptation,) = adaptations.values()
    about = {f"adapted from {k + 1}": str(source.resolve()) for k, source in enumerate(sources)}
    outcome = StudyOutcome(
        study.name, study.title or study.name, study.description,
        replace(fits[0].result.model, name=study.name), fits, findings=ready.findings,
        provenance={"pliant": __version__, **ready.provenance, **about}, clocks=ready.clocks, shape=ready.shape,
        doubts=ready.doubts, adaptations=dict(adaptations),
    )
    spoken = headline(outcome, study.targets)
    outcome = replace(outcome, verdict=(adaptation.sentence, *verdict(outcome, study.targets)),
                      headline=spoken._replace(sentence=f"{adaptation.sentence} {spoken.sentence}"))
    return in_recorded_axes(outcome, {}, signs_of(outcome, ready.experiments))
