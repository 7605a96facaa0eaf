"""Data classes of the plausibility checks: the data that a check examines, and the check itself."""

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
    """Data that the plausibility checks examine: a recording, the stated length, mass and gravity of the body, and a
    fitted model.

    A check finds nothing where its input is missing.

    Attributes
    ----------
    recording : xarray.Dataset
        The recording as read, or with its marker clusters assembled to stations.
    swapped : dict
        Numbers of frames with exchanged labels, by the names of the stations; see `pliant.preprocessing.labels`.
    aligned : xarray.Dataset, optional
        The recording in the base frame.
    length, mass, diameter : float, optional
        Stated length [m], mass [kg] and diameter [m] of the body.
    gravity : tuple of float, optional
        Stated gravity, m/s^2: x, y of the base frame, or x, y, z of the tracker.
    model : Model, optional
        The fitted model.
    base_length : float
        Stated length [m] of the rigid part between the base and the body.
    """

    recording: xr.Dataset | None = None
    swapped: Mapping[str, int] = field(default_factory=dict)
    aligned: xr.Dataset | None = None
    length: float | None = None
    mass: float | None = None
    diameter: float | None = None
    gravity: tuple[float, ...] | None = None
    model: Model | None = None
    base_length: float = 0.0


@dataclass(frozen=True)
class Check:
    """A plausibility check: a function that detects one mistake, with its name, subject and threshold.

    Attributes
    ----------
    name : str
    subject : {"recording", "body", "model"}
        What the check examines: each recording, the stated data of the body, or the fitted model.
    looks_at, threshold : str
        Texts for the documentation: what is compared, and the limit with its reason.
    find : callable
        Function of a `Case` that returns one sentence with the problem and the remedy, "" where there is none.
    """

    name: str
    subject: Subject
    looks_at: str
    threshold: str
    find: Callable[[Case], str]
