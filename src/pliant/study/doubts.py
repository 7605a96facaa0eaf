"""Plausibility checks of a study's recordings, of its stated body and of its fitted models."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

import xarray as xr

from pliant import actuators
from pliant.errors import InputError
from pliant.model import Model
from pliant.preprocessing.plausibility import CHECKS, UNITS, Case, doubts
from pliant.preprocessing.plausibility.together import beside
from pliant.study.resting import Aligned
from pliant.study.schema import ActuatorEntry

OF_RECORDINGS = {c.name for c in CHECKS if c.subject == "recording"}


def presets() -> list[str]:
    """Return the names of the actuator presets in `pliant.actuators`."""
    return [m.name for m in iter_modules(actuators.__path__)]


def preset(name: str) -> Any:
    """Return the module of an actuator preset; its BODY holds the arguments of `chain_model`."""
    if name not in presets():
        raise InputError(f"unknown actuator preset {name!r}: use one of {', '.join(presets())}")
    return import_module(f"pliant.actuators.{name}")


def stated_case(actuator: ActuatorEntry) -> Case:
    """Return the length, mass, diameter and gravity that the study or its preset states, as a plausibility `Case`."""
    body = dict(preset(actuator.preset).BODY) if actuator.preset else {}
    gravity = actuator.gravity
    return Case(
        length=actuator.length or body.get("length"), mass=actuator.mass or body.get("mass"),
        diameter=actuator.diameter, gravity=tuple(gravity) if gravity else None,
    )


def of_body(case: Case, stations: xr.Dataset, aligned: xr.Dataset | None) -> dict[str, str]:
    """Return warnings about the stated body compared with one recording of it, by the name of the check."""
    return doubts(replace(case, recording=stations, aligned=aligned), "body")


@contextmanager
def units_first(doubted: Mapping[str, str]) -> Iterator[None]:
    """Prefix an InputError raised inside the block with the warning about units, if there is one.

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


def of_study(aligned: Mapping[str, Aligned]) -> tuple[str, ...]:
    """Return the warnings about a study's recordings and body, each once.

    A warning about a recording begins with its name. A warning about the body is taken from the first recording that
    shows it. Warnings from comparisons between recordings come last.
    """
    said: dict[str, str] = {}
    for name, one in aligned.items():
        for check, sentence in one.doubts.items():
            own = check in OF_RECORDINGS
            said.setdefault(f"{name} {check}" if own else check, f"{name}: {sentence}" if own else sentence)
    lines = [*said.values(), *beside({name: one.body for name, one in aligned.items()})]
    return tuple(f"{line.rstrip('.')}." if not line.endswith("?") else line for line in lines)


def of_models(models: Sequence[tuple[str, Model]], actuator: ActuatorEntry) -> tuple[str, ...]:
    """Return warnings about implausible fitted models; each begins with the title of its fit."""
    said: dict[str, str] = {}
    for title, model in models:
        for check, sentence in doubts(Case(model=model, diameter=actuator.diameter), "model").items():
            said.setdefault(check, f"{title}: {sentence}.")
    return tuple(said.values())
