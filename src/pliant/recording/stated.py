"""Compare what a file states about its content (number of samples, sample rate) with what was read from it.

A reader returns a `Reading`: the recording, and one `Stated` for each number that the format states. The registry
judges them all by `judge_stated`, so that a file that was cut short is refused in the same words whatever its format.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.recording.clock import usual_step

if TYPE_CHECKING:
    from collections.abc import Iterable

    import xarray as xr
    from numpy.typing import NDArray

RATE_TOLERANCE = 0.02  # of the rate: times and rates are rounded
WARNING = "WARNING: "  # begins a line of the history that `quality` repeats


class Stated(NamedTuple):
    """A number that a file states about its content, and the number that was read.

    Attributes
    ----------
    what : str
        What is counted, in the plural, such as "frames"; for a rate, what has it.
    where : str
        The entry of the file that states the number.
    stated, read : float
    kind : {"count", "at least", "rate"}
        Whether more than the stated number was read, too, contradicts the file; a rate is in Hz.
    """

    what: str
    where: str
    stated: float
    read: float
    kind: Literal["count", "at least", "rate"] = "count"


class Reading(NamedTuple):
    """A recording as read from a file, and the numbers that the file states about its content."""

    recording: xr.Dataset
    stated: tuple[Stated, ...] = ()


def judge_stated(
    entries: Iterable[Stated], file: str, *, incomplete: bool = False, place: str = "its mapping"
) -> list[str]:
    """Compare the numbers that a file states with those that were read, and return one warning for each difference.

    Parameters
    ----------
    entries : iterable of Stated
    file : str
        Name of the file, for messages.
    incomplete : bool
        Whether to read a file that holds less than it states; the difference is then a warning.
    place : str
        Where the user sets `incomplete`, for messages.

    Raises
    ------
    InputError
        When the file holds fewer samples than it states, or more where its statement is exact.
    """
    warnings = []
    for entry in entries:
        if entry.kind == "rate":
            if np.isfinite(entry.read) and abs(entry.stated / entry.read - 1.0) > RATE_TOLERANCE:
                warnings.append(f"{WARNING}{file} states {entry.stated:.6g} Hz for {entry.what} ({entry.where}), but "
                                f"its times have {entry.read:.6g} Hz; the times were used")  # fmt: skip
        elif entry.read < entry.stated:
            lost = (f"{file} states {entry.stated:.0f} {entry.what} ({entry.where}), but only {entry.read:.0f} of "
                    f"{entry.stated:.0f} were read")  # fmt: skip
            if not incomplete:
                raise InputError(f"{lost}: the file is truncated or damaged, so copy or export it again, or set "
                                 f"incomplete = true in {place} to use what is left")
            warnings.append(f"{WARNING}{lost}, and incomplete = true accepts that")
        elif entry.kind == "count" and entry.read > entry.stated:
            raise InputError(f"{file} states {entry.stated:.0f} {entry.what} ({entry.where}), but holds "
                             f"{entry.read:.0f}: it contradicts itself, so copy or export it again")
    return warnings


def stated_rate(what: str, where: str, rate: float, time: NDArray[np.float64]) -> list[Stated]:
    """Return the comparison of a stated rate [Hz] with the sample times `time` (T,) [s]; none where `rate` is no
    positive number or there are fewer than two samples.
    """
    step = usual_step(time)
    usable = np.isfinite(rate) and rate > 0 and step > 0
    return [Stated(what, where, rate, 1.0 / step, "rate")] if usable else []
