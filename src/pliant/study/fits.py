"""The fits and the model selection of a study: fit to the training recordings, then predict the held-out ones."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from pliant.errors import InputError
from pliant.failures import Failures
from pliant.identification import (
    MORE_STAGES,
    STAGES,
    Experiment,
    FitResult,
    ModelSelection,
    Stage,
    bootstrapped,
    fit,
    select_model,
)
from pliant.identification.fit import parameters_from
from pliant.model import Model
from pliant.study.prepare import study_model
from pliant.study.record_outcomes import records_of
from pliant.study.schema import Fit, SelectionEntry, Study
from pliant.validation.outcome import FitOutcome

Tell = Callable[[str], None]


def run_fit(
    study: Study, name: str, entry: Fit, experiments: Mapping[str, Experiment], model: Model, tell: Tell,
) -> FitOutcome:
    """Fit the model to the training recordings and predict the held-out ones.

    For a held-out recording, all parameters are held constant except its own edge times.
    """
    began = clock.perf_counter()
    training = [experiments[r] for r in entry.train]
    result = fit(
        training, placed(study, entry, model), parameters_from(entry.parameters), step=study.step,
        loss=entry.loss, starts=entry.starts,
        weighting=entry.weighting, regularise=entry.regularise, section_area=study.actuator.section_area,
        rng=study.seed, progress=lambda line: tell(f"fit {name}: {line}"),
    )
    seconds = clock.perf_counter() - began
    return whole_fit(study, name, entry.title or name, entry, result, seconds, experiments, tell)


def placed(study: Study, entry: Fit, model: Model) -> Model:
    """Return the study's model with the number of links and the joint placement of this fit."""
    if entry.joint_placement is None and entry.links is None:
        return model
    same = {"joint_placement": entry.joint_placement or study.actuator.joint_placement,
            "links": entry.links or model.n, "gravity": model.gravity.tolist()}  # fmt: skip
    return study_model(study.actuator.model_copy(update=same), None)


def whole_fit(
    study: Study, name: str, title: str, entry: Fit | SelectionEntry, result: FitResult, seconds: float,
    experiments: Mapping[str, Experiment], tell: Tell,
) -> FitOutcome:
    """Return the outcome of a fit: its predictions of each recording, and bootstrap standard errors if the study asks.

    Results that cannot be computed (a recording, a band, the bootstrap) are listed in `not_computed` of the outcome.
    """
    failures = Failures(name, tell)
    train, held_out = ([experiments[r] for r in names] for names in (entry.train, entry.held_out))
    if entry.bootstrap and result.covariance is not None:
        tell(f"fit {name}: {entry.bootstrap} replicates of a block bootstrap")
        drawn = partial(bootstrapped, train, result, replicates=entry.bootstrap, step=study.step,
                        weighting=entry.weighting, loss=entry.loss, rng=study.seed)
        result = failures.attempt("bootstrap of standard errors", "", drawn) or result
    records = records_of(train, held_out, result, study.step, entry.weighting, failures)
    tell(f"fit {name}: {result.status}")
    return FitOutcome(name, title, result, records, seconds, tuple(failures))


def stages_of(entry: SelectionEntry) -> Sequence[Stage]:
    """Return the stages of the model selection that the study names, or the default ones; InputError for an unknown
    name.
    """
    known = {r.name: r for r in (*STAGES, *MORE_STAGES)}
    if unknown := [n for n in entry.stages if n not in known]:
        raise InputError(f"[model_selection] names an unknown stage {unknown[0]!r}: choose from {', '.join(known)}")
    return [known[n] for n in entry.stages] or STAGES


def run_model_selection(
    study: Study, experiments: Mapping[str, Experiment], model: Model, tell: Tell,
) -> ModelSelection | None:
    """Run the study's model selection and return its result; None if the study has none."""
    entry = study.model_selection
    if entry is None:
        return None
    return select_model(
        [experiments[r] for r in entry.train], [experiments[r] for r in entry.held_out], model,
        common=parameters_from(entry.common), stages=stages_of(entry), step=study.step,
        weighting=entry.weighting, loss=entry.loss, starts=entry.starts, rng=study.seed,
        progress=lambda line: tell(f"model selection: {line}"),
    )


def selection_fit(
    study: Study, selection: ModelSelection, experiments: Mapping[str, Experiment], tell: Tell,
) -> FitOutcome:
    """Return the outcome of the selected stage, in the form of a fit of the study."""
    entry = study.model_selection or SelectionEntry(train=[], starts=1)
    step = selection.step
    return whole_fit(
        study, "model_selection", f"Model selection, {step.stage.title}", entry, selection.result, step.seconds,
        experiments, tell,
    )
