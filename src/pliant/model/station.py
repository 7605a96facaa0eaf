"""Observed points that are fixed to the links of a model."""

from __future__ import annotations

import operator
from collections.abc import Iterable
from typing import Any, NamedTuple

from pliant.errors import InputError


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
    along: float  # m, from the link's joint along the link (on the base: from the origin along the tangent)
    across: float = 0.0  # m, to the left of the link, towards positive bending
    aside: float = 0.0  # m, out of the plane, in space


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
