"""Observed points that are fixed to the links of a model."""

from __future__ import annotations

import operator
from collections.abc import Iterable
from typing import Annotated, Any, NamedTuple

from pliant.errors import InputError
from pliant.model.quantity import Quantity


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
        "m", "position of a station out of the plane, in space", most=1e3, scale=2e-3)] = 0.0


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
