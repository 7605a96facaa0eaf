"""The result of a search: the steps that led to the chosen model, and everything that was tried."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from pliant.display import Card, Shown
from pliant.errors import InputError
from pliant.identification.result import FitResult
from pliant.plain import plain, record_of

Change = Literal["begins", "joins", "leaves", "settles"]


class TriedTerm(NamedTuple):
    """A term that was tried in one step of a search. Costs are sums of squares of residuals without a unit.

    Attributes
    ----------
    name, title : str
    screened, cost : float or None
        Cost that the screen predicts and that of the fit; None if there is none.
    left_out : float or None
        Sum of squared residuals of left-out parts of the recordings, by which terms are compared.
    reason : str
        Why the term was taken or not.
    """

    name: str
    title: str
    screened: float | None = None
    cost: float | None = None
    left_out: float | None = None
    reason: str = ""


class RivalModel(NamedTuple):
    """A model with other terms that predicts left-out parts almost as well as the chosen one.

    Attributes
    ----------
    title : str
        The term by which it differs.
    result : FitResult
    """

    title: str
    result: FitResult


@dataclass(frozen=True)
class SelectionStep:
    """A model on the way of a search, with errors in % of the peak displacement.

    Attributes
    ----------
    name, title : str
        Term that joined or left the model, or parameter that was held or got a prior; the name is '' for the first
        model.
    change : str
        "begins" for the first model, "joins" and "leaves" for a term, "settles" for a parameter, while all terms stay.
    free : tuple of str
        Free parameters.
    cost : float
        Half the sum of squared residuals.
    train, left_out : mapping
        RMS error of each training recording, % of its peak displacement, and the same of its parts as predicted from
        the other parts.
    tried : tuple of TriedTerm
        Terms that were tried next.
    """

    name: str
    title: str
    change: Change
    free: tuple[str, ...]
    cost: float
    train: Mapping[str, float]
    left_out: Mapping[str, float]
    tried: tuple[TriedTerm, ...] = ()

    @property
    def sentence(self) -> str:
        """Return the title, with a plus sign before a term that joined the model."""
        return f"+ {self.title}" if self.change == "joins" else self.title

    @property
    def train_percent(self) -> float:
        """Return the mean training error of all recordings, % of their peak displacement."""
        return float(np.mean(list(self.train.values())))

    @property
    def left_out_percent(self) -> float:
        """Return the mean error of left-out parts of the training recordings, % of their peak displacement."""
        return float(np.mean(list(self.left_out.values())))


@dataclass(frozen=True, repr=False)
class ModelSelection(Shown):
    """Result of `select_model`.

    Attributes
    ----------
    steps : tuple of SelectionStep
        From the first model to the chosen one.
    terms : tuple of str
        Names of the chosen terms.
    reason : str
        Sentence on the choice.
    result : FitResult
        Fit of the chosen model.
    seconds : float
        Wall time of the search, s.
    complete : bool
        False if an interrupt or the time limit ended the search.
    rivals : tuple of RivalModel
        Models that are almost as good: where their predictions differ, the recordings do not decide. Not stored.
    """

    steps: tuple[SelectionStep, ...]
    terms: tuple[str, ...]
    reason: str
    result: FitResult
    seconds: float
    complete: bool = True
    rivals: tuple[RivalModel, ...] = ()

    def card(self) -> Card:
        """Return a display card: table of the errors after each step, and of the terms that were refused last."""
        rows = [[s.sentence, str(len(s.free)), f"{s.train_percent:.3g}",
                 f"{s.left_out_percent:.3g}"] for s in self.steps]
        lines = [self.reason[0].upper() + self.reason[1:] + "."]
        lines += [f"Not taken: {t.title}: {t.reason}." for t in self.steps[-1].tried if t.cost is not None]
        return Card("Model selection", lines, ["term", "free", "training %", "left out %"], rows)

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], result: FitResult) -> ModelSelection:
        """Return the selection that `to_dict` turned into `content`, with the fit of the chosen model.

        Raises
        ------
        InputError
            When an earlier version of pliant wrote it.
        """
        if any("change" not in step for step in content.get("steps", [{}])):
            raise InputError("these results hold a model selection of an earlier version: run the study again")
        return record_of(cls, {**content, "result": result})

    def to_dict(self) -> dict[str, Any]:
        """Return the selection as a dictionary of plain numbers and strings for JSON."""
        content: dict[str, Any] = plain(self, but=("result", "rivals"))
        return content
