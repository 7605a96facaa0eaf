"""What a search has reached, kept in a file after each step, from which a search goes on after it was stopped."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pliant.errors import PliantError
from pliant.files import read_entries, write_text
from pliant.identification.parameters import Parameter
from pliant.plain import plain, record_of
from pliant.selection.fitted import FittedModel
from pliant.selection.result import SelectionStep

UNBOUNDED = ("lower", "upper")  # entries of a parameter that may be infinite, which JSON does not know


@dataclass(frozen=True)
class SearchState:
    """A search after one of its steps.

    Attributes
    ----------
    terms : tuple of str
        Names of the terms chosen so far.
    steps : tuple of SelectionStep
    parameters : tuple of Parameter
        At the values of the best model.
    prior_weight, time_step : float
        Weight of priors, and integration step [s] of all fits.
    seconds : float
        Time that the search has taken, s.
    """

    terms: tuple[str, ...]
    steps: tuple[SelectionStep, ...]
    parameters: tuple[Parameter, ...]
    first: tuple[Parameter, ...]
    prior_weight: float
    time_step: float
    seconds: float


@dataclass(frozen=True)
class SearchFile:
    """The file in which a search keeps its state.

    Attributes
    ----------
    path : Path
    key : str
        Identifies the recordings and the study. A file with another key is not used, and is replaced.
    """

    path: Path
    key: str

    def save(
        self, terms: Sequence[str], steps: Sequence[SelectionStep], best: FittedModel, first: Sequence[Parameter],
        time_step: float, seconds: float,
    ) -> None:
        """Replace the file. A disk that takes no file costs the way back, not the search."""
        content = {
            "key": self.key, "terms": list(terms), "steps": plain(steps),
            "parameters": [without_infinities(asdict(p)) for p in best.parameters],
            "first": [without_infinities(asdict(p)) for p in first], "prior_weight": best.problem.size,
            "time_step": time_step, "seconds": seconds,
        }
        try:
            write_text(self.path, json.dumps(content, allow_nan=False) + "\n")
        except PliantError:
            return

    def load(self) -> SearchState | None:
        """Return the state of a search of the same study and recordings; None if there is no such file."""
        if not self.path.exists():
            return None
        try:
            content = read_entries(self.path, "search")
            if content["key"] != self.key:
                return None
            parameters = tuple(Parameter(**p) for p in content["parameters"])
            first = tuple(Parameter(**p) for p in content["first"])
            numbers = (float(content[n]) for n in ("prior_weight", "time_step", "seconds"))
            steps = tuple(record_of(SelectionStep, s) for s in content["steps"])
            return SearchState(tuple(map(str, content["terms"])), steps, parameters, first, *numbers)
        except (PliantError, KeyError, TypeError, ValueError, AttributeError):  # not a file of this version
            return None


def without_infinities(entries: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of a parameter without infinite bounds."""
    return {n: v for n, v in entries.items() if n not in UNBOUNDED or np.isfinite(v)}
