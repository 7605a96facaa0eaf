"""The numbers that a fit's compiled loops run on, and where they take observed points to be."""

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
    """A kind of numbers that the compiled loops run on."""

    of: Callable[[Any], Any]  # a float, or an array of floats, as such numbers, in memory of their own
    value: Callable[[Any], Any]  # the floats of such numbers
    twin: Callable[..., Any]  # of a kernel, for so many links and segments that lengthen


def copied(a: Any) -> Any:
    """A float, or an array that may be written to: kernels are compiled anew for those that may not."""
    return np.array(a, dtype=float) if isinstance(a, Array) else float(a)


def in_kind(record: Any, kind: ObservationKind) -> Any:
    """A record of floats, arrays of them and records, as numbers of a kind."""
    return type(record)(*(in_kind(e, kind) if isinstance(e, tuple) else kind.of(e) for e in record))


def places_in_plane(made: SetUp, numbers: Numbers, kind: ObservationKind) -> Places:
    """Return where the observed points of a set-up are on the links of a chain in a plane."""
    links = kind.of(np.zeros((5, made.model.n + 1)))
    return Places(
        ObservedChain(numbers.base_length, numbers.length, numbers.share), links, made.carrier, numbers.along,
        numbers.across, numbers.shift[0], numbers.shift[1], numbers.reference,
    )


def places_in_space(made: SetUp, numbers: Numbers, kind: ObservationKind) -> SpatialPlaces:
    """Return where the observed points of a set-up are on the links of a chain in space."""
    work = in_kind(mechanics_of(made.model).workspace(), kind)
    return SpatialPlaces(
        numbers.body, work, made.carrier, numbers.along, numbers.across, numbers.aside, numbers.shift
    )
