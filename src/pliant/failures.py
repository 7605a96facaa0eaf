"""Results that cannot be computed: each is recorded as a sentence with its fit and recording, and the run goes on."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np

from pliant.errors import PliantError

T = TypeVar("T")
FAILED = (PliantError, ArithmeticError, np.linalg.LinAlgError)  # errors of a computation, not of a bug in the code


class NotComputed(NamedTuple):
    """A fit, prediction, prediction interval or forecast that could not be computed, and the reason."""

    what: str  # "fit", "prediction", "band", "forecast heavy", ...
    fit: str  # name of the fit; empty if no single fit is concerned
    record: str  # name of the recording; empty if no single recording is concerned
    reason: str
    role: str = ""  # of the recording: "train", "held_out" or empty

    @property
    def sentence(self) -> str:
        """Return a sentence that says what could not be computed, and why."""
        reason = self.reason.rstrip(".")
        if self.what == "fit":
            return f"Fit {self.fit} could not be computed: {reason}."
        of = f" of record {self.record}" if self.record else ""
        where = f"Fit {self.fit}: the" if self.fit else "The"
        return f"{where} {self.what}{of} could not be computed: {reason}."


def fit_failure(name: str, error: Exception) -> NotComputed:
    """Return the entry for a fit that ended in `error`."""
    return NotComputed("fit", name, "", " ".join((str(error) or type(error).__name__).split()))


class Failures(list[NotComputed]):
    """A list of the results of one fit that could not be computed; `attempt` runs a computation and adds its failure.

    Parameters
    ----------
    fit : str
        Name of the fit, used in the messages.
    warn : callable, optional
        Called with one line of text for each failure.
    """

    def __init__(self, fit: str, warn: Callable[[str], None] | None = None) -> None:
        super().__init__()
        self.fit, self.warn = fit, warn

    def attempt(self, what: str, record: str, compute: Callable[[], T], role: str = "") -> T | None:
        """Return the result of `compute()`; if it fails, add the failure to this list and return None."""
        try:
            return compute()
        except FAILED as error:
            self.add(what, record, str(error) or type(error).__name__, role)
            return None

    def add(self, what: str, record: str, reason: str, role: str = "") -> None:
        """Add a failure to this list, unless it is in it already, and warn of it."""
        failure = NotComputed(what, self.fit, record, " ".join(reason.split()), role)
        if failure not in self:
            self.append(failure)
            if self.warn is not None:
                self.warn(f"warning: {failure.sentence}")


def finite(values: np.ndarray, what: str) -> np.ndarray:
    """Return `values` unchanged; raise ArithmeticError if any of them is not a finite number."""
    if not np.isfinite(values).all():
        raise ArithmeticError(f"{what} is not finite: the simulated motion diverges")
    return values
