"""Results that cannot be computed: each becomes a sentence that names fit and record, and everything else goes on."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np

from pliant.errors import PliantError

T = TypeVar("T")
FAILED = (PliantError, ArithmeticError, np.linalg.LinAlgError)  # what a computation ends with, not what a bug does


class NotComputed(NamedTuple):
    """A fit, prediction, band or forecast that could not be computed, and why."""

    what: str  # "fit", "prediction", "band", "forecast heavy", ...
    fit: str  # empty where no single fit is concerned
    record: str  # empty where no single record is concerned
    reason: str
    role: str = ""  # of the record

    @property
    def sentence(self) -> str:
        """Return one sentence on what could not be computed, and why."""
        reason = self.reason.rstrip(".")
        if self.what == "fit":
            return f"Fit {self.fit} could not be computed: {reason}."
        of = f" of record {self.record}" if self.record else ""
        where = f"Fit {self.fit}: the" if self.fit else "The"
        return f"{where} {self.what}{of} could not be computed: {reason}."


def fit_failure(name: str, error: Exception) -> NotComputed:
    """A fit that ended in an error."""
    return NotComputed("fit", name, "", " ".join((str(error) or type(error).__name__).split()))


class Failures(list[NotComputed]):
    """Runs computations of one fit and collects what cannot be computed.

    Parameters
    ----------
    fit : str
        Name of the fit, for the sentences.
    warn : callable, optional
        Called with a line for each failure.
    """

    def __init__(self, fit: str, warn: Callable[[str], None] | None = None) -> None:
        super().__init__()
        self.fit, self.warn = fit, warn

    def attempt(self, what: str, record: str, compute: Callable[[], T], role: str = "") -> T | None:
        """Return what `compute` returns; where it fails, None, and the failure is added to this list."""
        try:
            return compute()
        except FAILED as error:
            self.add(what, record, str(error) or type(error).__name__, role)
            return None

    def add(self, what: str, record: str, reason: str, role: str = "") -> None:
        """Add a failure, once."""
        failure = NotComputed(what, self.fit, record, " ".join(reason.split()), role)
        if failure not in self:
            self.append(failure)
            if self.warn is not None:
                self.warn(f"warning: {failure.sentence}")


def finite(values: np.ndarray, what: str) -> np.ndarray:
    """Return the values; ArithmeticError where one is not a finite number."""
    if not np.isfinite(values).all():
        raise ArithmeticError(f"{what} is not finite: the motion diverges")
    return values
