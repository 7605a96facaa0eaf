"""Number kinds (float, complex, dual) of a fit's compiled loops, and the observed points in these numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from pliant.equations.symbols import ObservedChain
from pliant.identification.follow_loops import Places, SpatialPlaces
from pliant.identification.loop_inputs import Numbers, SetUp
from pliant.mechanics import mechanics_of

Array = np.ndarray
TINY = 1e-20  # imaginary step: its square vanishes beside 1


class ObservationKind(NamedTuple):
    """A kind of numbers on which the compiled loops run: its conversions from and to floats, and its compiler."""

    of: Callable[[Any], Any]  # converts a float, or an array of floats, to a copy in this kind
    value: Callable[[Any], Any]  # converts back to floats
    twin: Callable[..., Any]  # compiles a kernel for a number of links and extensible segments


def copied(a: Any) -> Any:
    """Return a float, or a writable copy of an array; read-only arrays would need kernels of their own."""
    return np.array(a, dtype=float) if isinstance(a, Array) else float(a)


def in_kind(record: Any, kind: ObservationKind) -> Any:
    """Return a named tuple with all its floats and arrays converted to a number kind (float, complex or dual)."""
    return type(record)(*(in_kind(e, kind) if isinstance(e, tuple) else kind.of(e) for e in record))


def places_in_plane(made: SetUp, numbers: Numbers, kind: ObservationKind) -> Places:
    """Return the positions of the observed points on the links of a planar chain, converted to a number kind."""
    links = kind.of(np.zeros((5, made.model.n + 1)))
    return Places(
        ObservedChain(numbers.base_length, numbers.length, numbers.share), links, made.carrier, numbers.along,
        numbers.across, numbers.shift[0], numbers.shift[1], numbers.reference,
    )


def places_in_space(made: SetUp, numbers: Numbers, kind: ObservationKind) -> SpatialPlaces:
    """Return the positions of the observed points on the links of a chain in space, converted to a number kind."""
    work = in_kind(mechanics_of(made.model).workspace(), kind)
    return SpatialPlaces(
        numbers.body, work, made.carrier, numbers.along, numbers.across, numbers.aside, numbers.shift
    )
