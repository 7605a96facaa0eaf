"""The numbers of a model, and what follows from them alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pliant.display import Shown
from pliant.model.chamber import Chamber
from pliant.model.extension import Extension, shares
from pliant.model.memory import Memory
from pliant.model.space import Space
from pliant.model.station import Station

Array = np.ndarray


@dataclass(frozen=True, repr=False, init=False, eq=False)
class ModelParameters(Shown):
    """The parameters of a `Model`, which explains and checks them, with lengths, masses and counts."""

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
        """Number of links."""
        return self.link_length.size

    @property
    def size(self) -> int:
        """Number of coordinates: n + S, angles and strains of segments that lengthen; 2 n or 3 n in space."""
        return self.link_length.size * (self.space.turns if self.space else 1) + len(self.extensions)

    @cached_property
    def stretch_share(self) -> Array:
        """Part (n + 1, S) of each link that lies in each segment; row 0 is the part before the first joint."""
        return shares(self.link_length, self.base_length, self.extensions)

    @property
    def segment_length(self) -> Array:
        """Length (S,) of each segment that lengthens, unstretched, m."""
        return np.asarray(np.append(self.base_length, self.link_length) @ self.stretch_share)

    @property
    def length(self) -> float:
        """Length from the origin to the last tip along the chain, m."""
        return float(self.base_length + self.link_length.sum())

    @property
    def mass(self) -> float:
        """Moving mass, tip mass included, kg."""
        return float(self.link_mass.sum() + self.tip_mass)

    @property
    def points(self) -> tuple[Station, ...]:
        """The observed points: `stations`, or the link tips named link_1 ... link_n."""
        tips = (Station(f"link_{i + 1}", i, float(length)) for i, length in enumerate(self.link_length))
        return self.stations or tuple(tips)

    @property
    def first_joint(self) -> Array:
        """Position of the first joint (2,), m."""
        return self.base_length * np.array([-np.sin(self.base_angle), np.cos(self.base_angle)])
