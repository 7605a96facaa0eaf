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
from pliant.validation.baseline import with_baseline
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
    maps: dict[tuple[object, ...], PlainMap] = {}
    compared = []
    for fit in fits:
        train = [experiments[name].synchronised(fit.result.values) for name in entries[fit.name].train]
        failures = Failures(fit.name, notify)

        def baselined(fit: FitOutcome = fit, train: Sequence[Experiment] = train) -> FitOutcome:
            key = tuple((e.name, None if e.pressure is None else float(e.pressure.time[0])) for e in train)
            if key not in maps:
                maps[key] = plain_map(train)
                notify(f"plain map of {', '.join(e.name for e in train)}: {maps[key].title}")
            return with_baseline(fit, maps[key], spare)

        done = failures.attempt("plain map", "", baselined) or fit
        compared.append(replace(done, not_computed=(*done.not_computed, *failures)))
    return tuple(compared)


def spare_inputs(study: Study, name: str, recording: xr.Dataset) -> dict[str, Trace]:
    """Return the recorded inputs, as time series by name, that drive no input of the study's model."""
    inputs = recorded_inputs(recording)
    drive = study.recordings[name].drive
    if not drive:
        return {}
    used = {one.name for one in driving(name, recording, drive).values()}
    return {one.name: Trace(one.time, np.array(one.values)) for one in inputs
            if one.name not in used and np.isfinite(one.values).all()}
