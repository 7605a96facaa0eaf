"""Fits of a study, adapted to recordings of other days."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from pliant.adaptation import Adaptation, DayParts, Posterior, adapt_model, parts_of_day, posterior_of
from pliant.adaptation.adapt import usual_error
from pliant.adaptation.posterior import of_a_kind
from pliant.failures import FAILED, Failures, NotComputed, fit_failure
from pliant.identification import Experiment, FitResult
from pliant.study.fits import predicted_outcome, records_of
from pliant.study.schema import AdaptEntry, Fit, SelectionEntry, Study, day_names
from pliant.validation.outcome import FitOutcome, StudyOutcome

Notify = Callable[[str], None]
BEFORE = "_before"  # end of the name of the earlier fit, as it predicts the other day


@dataclass(frozen=True)
class Robot:
    """A fitted robot: the fit, and what it says about the body."""

    result: FitResult
    posterior: Posterior
    title: str
    held_out: tuple[float, ...] = ()  # RMS errors of its held-out recordings, m; angles: rad

    @property
    def usual(self) -> float:
        """Return the median RMS error [m; angles: rad] of the training or of the held-out recordings, whichever is
        larger.
        """
        return max(usual_error(self.result), float(np.median(self.held_out)) if self.held_out else 0.0)


def adapted_fits(
    name: str, entry: AdaptEntry, robots: Sequence[Robot], experiments: Mapping[str, Experiment], notify: Notify,
    learning: Fit | SelectionEntry, earlier: Callable[[], Sequence[Experiment]],
) -> tuple[tuple[FitOutcome, FitOutcome], Adaptation]:
    """Adapt a model to another day; return the adapted fit, the earlier one on that day, and the adaptation.

    `earlier` returns recordings of the earlier fit, if a change of the body is to be compared with them.
    """
    began, old = clock.perf_counter(), robots[0]
    posterior = of_a_kind([r.posterior for r in robots], entry.spread) if entry.of_a_kind else old.posterior
    day = parts_of_day([experiments[r] for r in entry.recordings], entry.seconds)
    adaptation = adapt_model(
        old.result, posterior, day, weighting=learning.weighting, loss=learning.loss, kind=entry.of_a_kind,
        usual=old.usual, earlier=earlier, progress=notify,
    )
    notify(f"{name}: {adaptation.sentence}")
    failures = Failures(name, notify)
    records = records_of(day.fitted, day.judged, adaptation.result, adaptation.result.time_step,
                         learning.weighting, failures)  # fmt: skip
    title = f"Adapted to {', '.join(entry.recordings)}"
    after = FitOutcome(name, title, adaptation.result, records, clock.perf_counter() - began, tuple(failures))
    return (after, before_of(f"{name}{BEFORE}", old, day, notify)), adaptation


def learning_of(study: Study, fit: str) -> Fit | SelectionEntry:
    """Return the entry of a study from which a fit comes; for an adapted fit that of the fit from which its first day
    started. Its weighting and loss apply to later days too.
    """
    days = dict(zip(day_names(study), study.adapt, strict=True))
    order = ["", *days]
    while fit in days:
        fit = days[fit].fit or order[order.index(fit) - 1]
    return study.fits.get(fit) or study.model_selection or next(iter(study.fits.values()))


def before_of(name: str, old: Robot, day: DayParts, notify: Notify) -> FitOutcome:
    """Return the predictions of the earlier fit for the recordings of another day."""
    failures, records = Failures(name, notify), []
    for exp in (*day.fitted, *day.judged):
        predicted = failures.attempt(
            "prediction", exp.name, partial(predicted_outcome, exp, old.result, old.result.time_step), "held_out")
        records += [predicted[0]] if predicted else []
    return FitOutcome(name, f"Before: {old.title}", old.result, tuple(records), 0.0, tuple(failures))


def run_days(
    study: Study, fits: Sequence[FitOutcome], experiments: Mapping[str, Experiment], notify: Notify,
) -> tuple[list[FitOutcome], dict[str, Adaptation], list[NotComputed]]:
    """Adapt fits of a study to the other days that [adapt] states, one day after the other.

    Returns the adapted and earlier fits on these days, the adaptations by name, and what could not be computed.
    """
    done: list[FitOutcome] = []
    adaptations: dict[str, Adaptation] = {}
    failed: list[NotComputed] = []
    latest = fits[0].name
    for name, entry in zip(day_names(study), study.adapt, strict=True):
        start = {f.name: f for f in (*fits, *done)}.get(entry.fit or latest)
        if start is None:
            failed.append(NotComputed("fit", name, "", f"fit {entry.fit or latest} could not be computed"))
            continue
        try:
            robot = Robot(start.result, posterior_of(start.result, set(study.recordings)), start.title,
                          errors_of_held_out(start))  # fmt: skip
            learning = learning_of(study, start.name)
            earlier = [experiments[r] for r in earlier_names(study, start.name) if r in experiments]
            outcomes, adaptations[name] = adapted_fits(name, entry, [robot], experiments, notify, learning,
                                                       partial(list, earlier))  # fmt: skip
        except FAILED as error:
            failed.append(fit_failure(name, error))
            notify(f"warning: {failed[-1].sentence}")
            continue
        done += outcomes
        latest = name
    return done, adaptations, failed


def earlier_names(study: Study, fit: str) -> list[str]:
    """Return the names of the recordings to which a fit of a study was fitted last: those of its day, if it was adapted
    to one.
    """
    days = dict(zip(day_names(study), study.adapt, strict=True))
    return list(days[fit].recordings if fit in days else learning_of(study, fit).train)


def errors_of_held_out(fit: FitOutcome) -> tuple[float, ...]:
    """Return the RMS errors [m; angles: rad] of the held-out recordings of a fit."""
    unit, factor = fit.result.shown_in
    named = [r.metrics.get(f"rmse_{unit}") for r in fit.records if r.role == "held_out"]
    return tuple(float(v) / factor for v in named if isinstance(v, float) and np.isfinite(v))


def signs_of(outcome: StudyOutcome, experiments: Mapping[str, Experiment]) -> dict[str, int]:
    """Return the direction (1 or -1) of each recording's x axis, by name, parts of other days included."""
    parts = {r.name: r.experiment.x_sign for f in outcome.fits for r in f.records}
    return {n: e.x_sign for n, e in experiments.items()} | parts
