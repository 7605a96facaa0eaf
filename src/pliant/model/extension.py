"""Extensible segments of an actuator, each with one uniform axial strain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from pliant.equations.spring_terms import SPRING_BOUND, SPRING_TERMS, in_words
from pliant.errors import InputError
from pliant.model.checks import one_number
from pliant.model.quantity import Quantity, declaring, quantities

Array = np.ndarray
CURVES = (*SPRING_TERMS, SPRING_BOUND)  # fields that make an axial spring soften or stiffen, as those of a joint


def axial_term(name: str) -> Quantity:
    """Return the declaration of the nonlinear term `name` of an axial spring."""
    term = SPRING_TERMS[name]
    lower, upper, scale = term.axial
    meaning = f"{term.letter} of axial springs {in_words(law='EA e')} of the strain e"
    return Quantity("1", meaning, most=term.most, lower=lower, upper=upper, scale=scale, start=0.0)


@declaring
@dataclass(frozen=True)
class Extension:
    """An extensible segment of the actuator, with one uniform axial strain.

    Parameters
    ----------
    stiffness : float
        EA, axial force per strain, N.
    damping : float
        Axial force per rate of strain, N s.
    start, stop : float
        Start and end of the segment along the unstretched chain from the origin, m; default: the whole body. The parts
        of links within it, and of the part before the first joint, lengthen.
    name : str
    stiffening, cubic_stiffening : float, optional
        s and a of an axial spring EA e (1 + s e + a e^2) of the strain e: the law of the joints' springs, which softens
        with s < 0 and stiffens again with a > 0. None of both: a linear spring, which takes less time.
    stiffening_bound : float, optional
        f, by which s changes the slope at most: it stays within EA (1 - f) and EA (1 + f). Below 1; 0: no bound.
    stiffens_bending : bool
        In space: whether the bending (and twisting) stiffness of the joints inside the segment changes with the strain
        by the same factor as the axial stiffness, as in a body whose wall carries the axial force and the bending
        moment. Needs a nonlinear axial spring.

    Raises
    ------
    InputError
        When a number is not finite or not physical.

    Examples
    --------
    >>> from pliant.model import Extension
    >>> Extension(stiffness=40.0).stiffness  # EA, N
    40.0
    """

    most_stretch: ClassVar[float] = 0.6  # of the length, by which a body of segments reaches farther at most
    stiffness: Annotated[float, Quantity(
        "N", "EA of an extensible segment, force per strain", sign="positive", least=1e-9, most=1e12, lower=1e-6,
        log_offset=0.0, scales="springs")]
    damping: Annotated[float, Quantity(
        "N s", "force per strain rate of an extensible segment", sign="not negative", most=1e12, lower=0.0)] = 0.0
    start: Annotated[float, Quantity(
        "m", "start of the segment along the body, from the base", sign="not negative", fitted=False)] = 0.0
    stop: Annotated[float | None, Quantity(
        "m", "end of the segment along the body; default: the tip", sign="not negative", fitted=False)] = None
    name: str = "body"
    stiffening: Annotated[float | None, axial_term("stiffening")] = None
    cubic_stiffening: Annotated[float | None, axial_term("cubic_stiffening")] = None
    stiffening_bound: Annotated[float | None, Quantity(
        "1", "f of these springs: largest change of the slope by s, as a fraction of EA", least=1e-3, most=1.0,
        zero=True, lower=1e-3, upper=0.99, scale=0.2, start=0.75)] = None
    stiffens_bending: bool = False

    def __post_init__(self) -> None:
        for field, quantity in quantities(Extension).items():
            if getattr(self, field) is None:
                continue
            value = one_number(f"extension {self.name!r}: {field}", getattr(self, field))
            object.__setattr__(self, field, value)
            wrong = {"positive": value <= 0, "not negative": value < 0, "any": False}
            if not np.isfinite(value) or wrong[quantity.sign]:
                sign = "" if quantity.sign == "any" else f" and {quantity.sign}"
                raise InputError(f"extension {self.name!r}: {field} must be finite{sign}, got {value}")
            quantity.check_limit(f"extension {self.name!r}:", field, value)
        if not 0 <= (self.stiffening_bound or 0.0) < 1:
            raise InputError(
                f"extension {self.name!r}: {SPRING_BOUND} must be from 0 to below 1, got {self.stiffening_bound}"
            )
        if self.stiffens_bending and not self.curved:
            raise InputError(
                f"extension {self.name!r}: stiffens_bending needs a nonlinear axial spring: give it a stiffening or "
                "cubic_stiffening (0 as the start value of a fit), or leave out stiffens_bending"
            )
        if self.stop is not None and not self.stop > self.start:
            raise InputError(f"extension {self.name!r} must stop after its start at {self.start} m, got {self.stop}")

    @property
    def curved(self) -> bool:
        """Whether the axial spring has nonlinear terms. A term of size 0 counts, so that a fit can start from a linear
        spring.
        """
        return any(getattr(self, name) is not None for name in SPRING_TERMS)

    def end(self, length: float) -> float:
        """Return the position [m] of the segment's end along an actuator of the given `length` [m]."""
        return length if self.stop is None else self.stop


def shares(links: Array, base_length: float, extensions: Sequence[Extension]) -> Array:
    """Return the fraction (n + 1, S) of the base part and of each of n links that lies in each of S extensible
    segments.

    Row 0 is the part before the first joint.
    """
    edges = np.concatenate([[0.0, base_length], base_length + np.cumsum(links)])
    length, share = np.diff(edges), np.zeros((links.size + 1, len(extensions)))
    for s, extension in enumerate(extensions):
        overlap = np.minimum(edges[1:], extension.end(edges[-1])) - np.maximum(edges[:-1], extension.start)
        np.divide(np.maximum(overlap, 0.0), length, out=share[:, s], where=length > 0)
    share[np.abs(share - 1.0) < 1e-9] = 1.0  # edges that coincide except for rounding
    share[share < 1e-9] = 0.0
    return share


def extensions_of(entries: Any) -> tuple[Extension, ...]:
    """Return one or several `Extension` objects as a tuple; raise InputError for anything else."""
    extensions = (entries,) if isinstance(entries, Extension) else tuple(entries)
    if not all(isinstance(e, Extension) for e in extensions):
        raise InputError(f"extensions must be Extension objects, got {entries!r:.80}")
    return extensions
