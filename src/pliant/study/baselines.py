"""Plain maps of a study: one for each set of training recordings, compared with every fit to them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from pliant.failures import Failures
from pliant.identification import Experiment
from pliant.identification.drives import driving
from pliant.recording.inputs import recorded_inputs
from pliant.simulation import Trace
from pliant.study.schema import Fit, SelectionEntry, Study
from pliant.validation.baseline import Mapped, mapped, with_baseline
from pliant.validation.outcome import FitOutcome
from pliant.validation.plain_map import PlainMap, plain_map


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
