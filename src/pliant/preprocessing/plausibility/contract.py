"""The interface of a plausibility check: its input and its result."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import xarray as xr

    from pliant.model import Model

Subject = Literal["recording", "body", "model"]


@dataclass(frozen=True)
class Case:
    """Everything that is known when the checks run; a check that needs what is missing finds nothing.

    Attributes
    ----------
    recording : xarray.Dataset
        As read; where markers make a station, of the stations.
    swapped : dict
        Frames in which labels are exchanged, by the names of the stations; see `pliant.preprocessing.labels`.
    aligned : xarray.Dataset, optional
        The recording in the base frame.
    length, mass, diameter : float, optional
        Of the body as stated, m, kg, m.
    gravity : tuple of float, optional
        As stated, m/s^2: x, y of the base frame, or x, y, z of the tracker.
    model : Model, optional
        As fitted.
    """

    recording: xr.Dataset | None = None
    swapped: Mapping[str, int] = field(default_factory=dict)
    aligned: xr.Dataset | None = None
    length: float | None = None
    mass: float | None = None
    diameter: float | None = None
    gravity: tuple[float, ...] | None = None
    model: Model | None = None


@dataclass(frozen=True)
class Check:
    """One check: a mistake that would give a wrong model without an error.

    Attributes
    ----------
    name : str
    subject : {"recording", "body", "model"}
        What it judges: each recording, the numbers stated of the body, or the fitted model.
    looks_at, threshold : str
        For the documentation: what is compared, and the limit with its reason.
    find : callable
        From a `Case` to one sentence with what was seen and what to do, empty where nothing is wrong.
    """

    name: str
    subject: Subject
    looks_at: str
    threshold: str
    find: Callable[[Case], str]
