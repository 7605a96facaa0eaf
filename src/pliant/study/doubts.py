"""Plausibility checks of a study's recordings, of its stated body and of its fitted models."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

import xarray as xr

from pliant.errors import InputError
from pliant.identification import Experiment, FitResult
from pliant.model import Model
from pliant.preprocessing.plausibility import CHECKS, UNITS, Case, doubts
from pliant.preprocessing.plausibility.together import beside
from pliant.selection.criterion import undetermined_terms
from pliant.study.aligned import Aligned
from pliant.study.body import preset
from pliant.study.body_tables import ActuatorEntry

OF_RECORDINGS = {c.name for c in CHECKS if c.subject == "recording"}


def stated_case(actuator: ActuatorEntry) -> Case:
    """Return the length, mass, diameter and gravity that the study or its preset states, as a `Case` for the
    plausibility checks.
    """
    body = dict(preset(actuator.preset).BODY) if actuator.preset else {}
    gravity = actuator.gravity
    return Case(
        length=actuator.length or body.get("length"), mass=actuator.mass or body.get("mass"),
        diameter=actuator.diameter, base_length=actuator.base_length or body.get("base_length") or 0.0,
        gravity=tuple(gravity) if gravity else None,
    )


def body_warnings(case: Case, stations: xr.Dataset, aligned: xr.Dataset | None) -> dict[str, str]:
    """Return warnings about contradictions between the stated body and one recording of it, as a dict from the name of
    the check to the warning.
    """
    return doubts(replace(case, recording=stations, aligned=aligned), "body")


@contextmanager
def unit_warning_first(doubted: Mapping[str, str]) -> Iterator[None]:
    """Context manager: if an InputError is raised inside and there is a warning about units, put the warning before the
    error's message.

    A wrong unit is often the cause of another error, such as a base that seems to move by metres.

    Parameters
    ----------
    doubted : mapping of str to str
        Warning sentences. The keys end in the name of the check.
    """
    try:
        yield
    except InputError as error:
        unit = next((line for check, line in doubted.items() if check.endswith(UNITS)), "")
        if not unit or unit in str(error):
            raise
        raise InputError(f"{unit}{'' if unit.endswith('?') else '.'} Then: {error}") from None


def recording_warnings(aligned: Mapping[str, Aligned]) -> tuple[str, ...]:
    """Return the warnings about a study's recordings and its stated body, without duplicates.

    A warning about a recording begins with its name. A warning about the body is taken from the first recording that
    shows it. Warnings from comparisons between recordings come last.
    """
    warnings: dict[str, str] = {}
    for name, recording in aligned.items():
        for check, sentence in recording.doubts.items():
            of_recording = check in OF_RECORDINGS
            key, line = (f"{name} {check}", f"{name}: {sentence}") if of_recording else (check, sentence)
            warnings.setdefault(key, line)
    lines = [*warnings.values(), *beside({name: recording.body for name, recording in aligned.items()})]
    return tuple(f"{line.rstrip('.')}." if not line.endswith("?") else line for line in lines)


def model_warnings(models: Sequence[tuple[str, Model]], actuator: ActuatorEntry) -> tuple[str, ...]:
    """Return warnings about implausible fitted models; each begins with the title of its fit."""
    warnings: dict[str, str] = {}
    for title, model in models:
        for check, sentence in doubts(Case(model=model, diameter=actuator.diameter), "model").items():
            warnings.setdefault(check, f"{title}: {sentence}.")
    return tuple(warnings.values())


def term_warnings(
    fits: Sequence[tuple[str, FitResult, Sequence[Experiment]]], model: Model,
) -> tuple[str, ...]:
    """Return a warning for each fit (title, result, training recordings) with terms that the recordings do not
    determine. `model` is that from which the fits begin.
    """
    lines = []
    for title, result, train in fits:
        vague = undetermined_terms(result, train, model)
        if vague:
            named = ", ".join(f"{name} ({text})" for name, text in vague.items())
            lines.append(f"{title}: the training recordings do not determine {named}: leave it out, give it a prior, "
                         "or let [model_selection] choose the terms.")
    return tuple(lines)
