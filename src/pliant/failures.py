"""Record of results of a study that could not be computed, so that the rest of the study can go on."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np

from pliant.errors import PliantError

T = TypeVar("T")
FAILED = (PliantError, ArithmeticError, np.linalg.LinAlgError)  # errors of a computation, not of a bug in the code


class NotComputed(NamedTuple):
    """A result that could not be computed (a fit, prediction, prediction interval or forecast), and the reason."""

    what: str  # "fit", "prediction", "band", "forecast heavy", ...
    fit: str  # name of the fit; empty if no single fit is concerned
    record: str  # name of the recording; empty if no single recording is concerned
    reason: str
    role: str = ""  # of the recording: "train", "held_out" or empty

    @property
    def sentence(self) -> str:
        """Sentence that says which result could not be computed, and why."""
        reason = self.reason.rstrip(".")
        if self.what == "fit":
            return f"Fit {self.fit} could not be computed: {reason}."
        of = f" of record {self.record}" if self.record else ""
        where = f"Fit {self.fit}: the" if self.fit else "The"
        return f"{where} {self.what}{of} could not be computed: {reason}."


def fit_failure(name: str, error: Exception) -> NotComputed:
    """Return the record for the fit `name` that ended with the exception `error`."""
    return NotComputed("fit", name, "", " ".join((str(error) or type(error).__name__).split()))


class Failures(list[NotComputed]):
    """List of the results of one fit that could not be computed.

    `attempt` runs a computation and adds its failure.

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
        """Return ``compute()``; if it raises an exception, add the failed result `what` to this
        list and return None.
        """
        try:
            return compute()
        except FAILED as error:
            self.add(what, record, str(error) or type(error).__name__, role)
            return None

    def add(self, what: str, record: str, reason: str, role: str = "") -> None:
        """Add a result that could not be computed to this list, and warn of it; a result already in the list is
        ignored.
        """
        failure = NotComputed(what, self.fit, record, " ".join(reason.split()), role)
        if failure not in self:
            self.append(failure)
            if self.warn is not None:
                self.warn(f"warning: {failure.sentence}")


def finite(values: np.ndarray, what: str) -> np.ndarray:
    """Return the array `values` unchanged; raise ArithmeticError if any element is NaN or infinite."""
    if not np.isfinite(values).all():
        raise ArithmeticError(f"{what} is not finite: the simulated motion diverges")
    return values
