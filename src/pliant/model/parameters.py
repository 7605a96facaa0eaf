"""The parameters of a model, and the lengths, masses and counts derived from them."""

from __future__ import annotations

import operator
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from pliant.display import Shown
from pliant.equations.spring_terms import SPRING_TERMS, in_words
from pliant.errors import InputError
from pliant.model.actuation_input import ActuationInput
from pliant.model.extension import Extension, shares
from pliant.model.memory import Memory
from pliant.model.quantity import Quantity
from pliant.model.space import Space

Array = np.ndarray
MassAt = Literal["rod", "tip"]
NONE: Any = 0.0  # for each joint
BESIDE = 0.25  # of the body's length: reach of markers beside the axis


class Station(NamedTuple):
    """An observed point fixed to a link of the model, such as a marker, a link tip or a point of an optical fibre.

    Parameters
    ----------
    name : str
    link : int
        Index of the link that carries it, 0 the first; -1: the clamped base.
    along, across : float, m
        Distances from the link's joint along the link, and to its left, towards positive bending.
    aside : float, m
        For a chain in space: distance along the x axis of the link's frame; `across` is along its -y axis.

    Examples
    --------
    >>> from pliant.model import Station
    >>> Station("tip", link=5, along=0.03).name
    'tip'
    """

    name: str
    link: int  # index of the link that carries it, 0 the first; -1: the clamped base
    along: Annotated[float, Quantity(  # on the base: from the origin along the tangent
        "m", "position of a station along its link", most=1e3, scale=2e-3)]
    across: Annotated[float, Quantity(  # to the left of the link, towards positive bending
        "m", "position of a station across its link", most=1e3, scale=2e-3)] = 0.0
    aside: Annotated[float, Quantity(
        "m", "position of a station out of the plane, in space", most=1e3, scale=2e-3, only="in space")] = 0.0


def station_of(entry: Any) -> Station:
    """Return `entry` (name, link, along, ...) as a `Station`; raise InputError if it has not this form."""
    try:
        name, link, along, across, aside = Station(*entry)
        return Station(str(name), operator.index(link), float(along), float(across), float(aside))
    except (TypeError, ValueError):
        raise InputError(
            f"a station is (name, link, along, across) with an integer link and lengths in m, got {entry!r:.70}"
        ) from None


def stations_of(entries: Iterable[Any]) -> tuple[Station, ...]:
    """Return the `entries` (name, link, along, ...), one for each observed point, as a tuple of `Station` objects."""
    return tuple(station_of(entry) for entry in entries)


def spring_term(name: str) -> Quantity:
    """Return the declaration of the nonlinear term `name` of a joint's spring."""
    term = SPRING_TERMS[name]
    lower, upper, scale = term.fit
    meaning = f"{term.letter} of springs {in_words()}, of every joint"
    return Quantity(term.unit, meaning, per="joint", most=term.most, lower=lower, upper=upper, scale=scale, start=0.0)


@dataclass(frozen=True, repr=False, init=False, eq=False)
class ModelParameters(Shown):
    """The parameters of a `Model` and the lengths, masses and counts derived from them, without checks."""

    link_length: Annotated[Array, Quantity(
        "m", "length of each link", per="joint", sign="positive", least=1e-6, most=1e3, fitted=False)]
    link_mass: Annotated[Array, Quantity(
        "kg", "mass of each link", per="joint", sign="not negative", least=1e-12, most=1e5, zero=True, fitted=False)]
    stiffness: Annotated[Array, Quantity(
        "N m/rad", "stiffness of every joint", per="joint", sign="positive", least=1e-12, most=1e9, lower=1e-9,
        log_offset=0.0, scales="springs", source="K of Eq. (5)")]
    damping: Annotated[Array, Quantity(
        "N m s/rad", "damping of every joint", per="joint", sign="not negative", most=1e9, lower=0.0,
        source="D of Eq. (5)")]
    chambers: tuple[ActuationInput, ...]
    rest_angle: Annotated[Array, Quantity(
        "rad", "rest angle of every joint", per="joint", most=1e3, lower=-3.2, upper=3.2, scale=0.05,
        only="in a plane", source="theta_i0 of Eq. (1)")] = NONE
    stiffening: Annotated[Array, spring_term("stiffening")] = NONE
    cubic_stiffening: Annotated[Array, spring_term("cubic_stiffening")] = NONE
    stiffening_bound: Annotated[Array, Quantity(
        "1", "f of these springs: largest change of the slope by s, as a fraction of K", per="joint",
        sign="not negative", least=1e-3, most=1.0, zero=True, lower=1e-3, upper=0.99, scale=0.2,
        start=0.75)] = NONE
    mass_at: str = "rod"
    tip_mass: Annotated[float, Quantity(
        "kg", "cap or load at the last tip", sign="not negative", most=1e5, lower=0.0, scale=5e-3,
        guess=0.0)] = 0.0
    tip_inertia: Annotated[float, Quantity(
        "kg m^2", "moment of inertia of the cap or load about an axis across the last link through its tip",
        sign="not negative", most=1e5, lower=0.0, scale=1e-5, guess=0.0)] = 0.0
    base_length: Annotated[float, Quantity(
        "m", "length of the rigid part before the first joint", sign="not negative", most=1e3,
        fitted=False)] = 0.0
    base_angle: Annotated[float, Quantity(
        "rad", "angle of the base tangent from +y", most=1e3, lower=-1.0, upper=1.0, scale=0.05, guess=0.0,
        only="in a plane")] = 0.0
    gravity: Annotated[Array, Quantity(
        "m/s^2", "gravity in the base frame", per="vector", most=1e4, fitted=False)] = NONE
    moving_base: bool = False
    memory: Memory = field(default_factory=Memory)
    extensions: tuple[Extension, ...] = ()
    space: Space | None = None
    stations: tuple[Station, ...] = ()
    name: str = "model"
    source: dict[str, str] = field(default_factory=dict)

    @property
    def n(self) -> int:
        """Number n of links, which equals the number of joints."""
        return self.link_length.size

    @property
    def turns(self) -> int:
        """Number of angles of each joint: 1 in a plane, 2 in space, 3 if the chain twists."""
        return self.space.turns if self.space else 1

    @property
    def size(self) -> int:
        """Number N of coordinates: the angles of n joints (n in a plane, 2 n or 3 n in space) and the strains of S
        segments that lengthen.
        """
        return self.link_length.size * self.turns + len(self.extensions)

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
    def reach(self) -> float:
        """Distance [m] from the base that no observed point exceeds: the length and a quarter of it, for markers beside
        the axis; if segments lengthen, 1.6 times the length.
        """
        return (1.0 + max([BESIDE, *(e.most_stretch for e in self.extensions)])) * self.length

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
