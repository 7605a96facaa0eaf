"""Records that the methods of `Mechanics` return."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray


class Energy(NamedTuple):
    """Kinetic, elastic and gravitational energy [J] of an actuator, at one instant or at T instants as arrays (T,)."""

    kinetic: Any
    elastic: Any
    gravity: Any


class CoordinateKind(NamedTuple):
    """A group of coordinates of the same kind, such as all joint angles or all strains, with their units and dataset
    names.
    """

    over: str  # dimension of datasets: "joint", "segment"
    noun: str  # name of one coordinate, in messages
    labels: list[Any]  # along that dimension
    rows: slice  # of coordinates, rates and generalised forces (N,)
    names: tuple[str, str, str, str]  # variables: coordinate, rate, disturbance, external force
    units: tuple[str, str, str]  # of coordinate, rate and force
    lever: Array  # (k,) generalised force [N m] of one unit of this force
