"""The parameters of a model, and the lengths, masses and counts derived from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pliant.display import Shown
from pliant.model.chamber import Chamber, ChamberValues
from pliant.model.extension import Extension, shares
from pliant.model.memory import Memory
from pliant.model.space import Space
from pliant.model.station import Station

Array = np.ndarray


class ChainValues(ChamberValues, total=False):
    """Type of the keyword arguments of `Model`, without the lengths and masses of the links.

    Those of `Chamber` are for a model with a single chamber.
    """

    stiffness: Any
    damping: Any
    chambers: tuple[Chamber, ...]
    rest_angle: Any
    stiffening: Any
    cubic_stiffening: Any
    stiffening_bound: Any
    mass_at: str
    tip_mass: float
    base_length: float
    base_angle: float
    gravity: Any
    memory: Memory
    extensions: tuple[Extension, ...]
    space: Space | None
    stations: Any
    name: str
    source: dict[str, str]


@dataclass(frozen=True, repr=False, init=False, eq=False)
class ModelParameters(Shown):
    """The parameters of a `Model` and the lengths, masses and counts derived from them, without checks."""

    link_length: Array
    link_mass: Array
    stiffness: Array
    damping: Array
    chambers: tuple[Chamber, ...]
    rest_angle: Array
    stiffening: Array
    cubic_stiffening: Array
    stiffening_bound: Array
    mass_at: str
    tip_mass: float
    base_length: float
    base_angle: float
    gravity: Array
    memory: Memory
    extensions: tuple[Extension, ...]
    space: Space | None
    stations: tuple[Station, ...]
    name: str
    source: dict[str, str]

    @property
    def n(self) -> int:
        """Number n of links, which equals the number of joints."""
        return self.link_length.size

    @property
    def size(self) -> int:
        """Number N of coordinates: the angles of n joints (n in a plane, 2 n or 3 n in space) and the strains of S
        segments that lengthen.
        """
        return self.link_length.size * (self.space.turns if self.space else 1) + len(self.extensions)

    @cached_property
    def stretch_share(self) -> Array:
        """Fraction (n + 1, S) of the base part (row 0) and of each of n links that lies in each of S extensible
        segments.
        """
        return shares(self.link_length, self.base_length, self.extensions)

    @property
    def segment_length(self) -> Array:
        """Unstretched lengths (S,) [m] of the S extensible segments."""
        return np.asarray(np.append(self.base_length, self.link_length) @ self.stretch_share)

    @property
    def length(self) -> float:
        """Length [m] of the actuator along its links, from the origin to the tip."""
        return float(self.base_length + self.link_length.sum())

    @property
    def mass(self) -> float:
        """Moving mass [kg] of the actuator, the links and the tip mass."""
        return float(self.link_mass.sum() + self.tip_mass)

    @property
    def points(self) -> tuple[Station, ...]:
        """The observed points: the model's `stations` or, if it has none, the link tips, named link_1 ... link_n."""
        tips = (Station(f"link_{i + 1}", i, float(length)) for i, length in enumerate(self.link_length))
        return self.stations or tuple(tips)

    @property
    def first_joint(self) -> Array:
        """Position (2,) [m] of the first joint in the base frame."""
        return self.base_length * np.array([-np.sin(self.base_angle), np.cos(self.base_angle)])
