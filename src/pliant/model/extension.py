"""A segment of the body that lengthens, and what it makes of the chain's inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pliant.errors import InputError
from pliant.model.checks import one_number
from pliant.model.inertia import inertia_constants
from pliant.model.limits import check_limit

if TYPE_CHECKING:
    from pliant.model.model import Model

Array = np.ndarray
SINGULAR = 1e-9  # least_inertia of strains that one mass carries, but for rounding
LEAST_SHARE = 1e-3  # of a link's length: a segment that holds less of every link holds none


@dataclass(frozen=True)
class Extension:
    """A segment of the body that lengthens by one uniform strain, between two places along the unstretched body.

    Parameters
    ----------
    stiffness : float
        EA, axial force per strain, N.
    damping : float
        Axial force per rate of strain, N s.
    start, stop : float
        Where the segment begins and ends along the chain from the origin, m; default: the whole body. What it holds of
        a link, and of the part before the first joint, lengthens with it.
    name : str

    Raises
    ------
    InputError
        When a number is not finite or not physical.
    """

    stiffness: float
    damping: float = 0.0
    start: float = 0.0
    stop: float | None = None
    name: str = "body"

    def __post_init__(self) -> None:
        for field in ("stiffness", "damping", "start", *(() if self.stop is None else ("stop",))):
            value = one_number(f"extension {self.name!r}: {field}", getattr(self, field))
            object.__setattr__(self, field, value)
            if not np.isfinite(value) or value < 0 or (value == 0 and field == "stiffness"):
                raise InputError(
                    f"extension {self.name!r}: {field} must be finite and {'' if field == 'stiffness' else 'not '}"
                    f"{'positive' if field == 'stiffness' else 'negative'}, got {value}"
                )
        check_limit(f"extension {self.name!r}:", "axial_stiffness", self.stiffness)
        check_limit(f"extension {self.name!r}:", "axial_damping", self.damping)
        if self.stop is not None and not self.stop > self.start:
            raise InputError(f"extension {self.name!r} must stop after its start at {self.start} m, got {self.stop}")


def shares(links: Array, base_length: float, extensions: Sequence[Extension]) -> Array:
    """Part (n + 1, S) of each link that lies in each segment; row 0 is the part before the first joint."""
    edges = np.concatenate([[0.0, base_length], base_length + np.cumsum(links)])
    found = np.zeros((links.size + 1, len(extensions)))
    for s, extension in enumerate(extensions):
        stop = edges[-1] if extension.stop is None else extension.stop
        overlap = np.minimum(edges[1:], stop) - np.maximum(edges[:-1], extension.start)
        found[:, s] = np.maximum(overlap, 0.0) / np.where(np.diff(edges) > 0, np.diff(edges), 1.0)
    found[np.abs(found - 1.0) < 1e-9] = 1.0  # edges that meet but for rounding
    found[found < 1e-9] = 0.0
    return found


def extensions_of(entries: Any) -> tuple[Extension, ...]:
    """`entries` as a tuple of extensions; InputError for anything else."""
    made = (entries,) if isinstance(entries, Extension) else tuple(entries)
    if not all(isinstance(e, Extension) for e in made):
        raise InputError(f"extensions must be Extension objects, got {entries!r:.80}")
    return made


def joints_inside(model: Model) -> tuple[tuple[int, ...], ...]:
    """Joints that lie in each segment, from 0."""
    place = model.base_length + np.cumsum(model.link_length) - model.link_length
    slack = 1e-9 * model.length
    stops = [model.length if e.stop is None else e.stop for e in model.extensions]
    return tuple(
        tuple(np.flatnonzero((place > e.start - slack) & (place < stop - slack)).tolist())
        for e, stop in zip(model.extensions, stops, strict=True)
    )


def fixed_length(model: Model, refusal: str = "") -> Model:
    """The model, when nothing lengthens: who cannot follow a length that changes asks here.

    Raises
    ------
    InputError
        When segments lengthen, in the words of `refusal`, if any.
    """
    if names := ", ".join(e.name for e in model.extensions):
        raise InputError(
            refusal or f"this takes a body of fixed length, and {model.name!r} lengthens ({names}): use simulate, "
            "Stepper, fit, linearise, design_outputs, estimate or find_contact, or leave its extensions out"
        )
    return model


def extensible_inertia(model: Model) -> tuple[Array, Array]:
    """Return B (n + 1, n + 1), rotary inertia on its diagonal, and h (n + 1,); index 0 lies before the first joint."""
    length, mass = np.append(model.base_length, model.link_length), np.append(0.0, model.link_mass)
    B, rotary, h = inertia_constants(length, mass, model.tip_mass, rod=model.mass_at == "rod")
    B[np.diag_indices(model.n + 1)] += rotary
    return B, h


def least_inertia(B: Array, share: Array) -> float:
    """Return the smallest eigenvalue of the strains' inertia in the straight body, scaled to a diagonal of ones.

    0 where some combination of strains moves no mass: then the equations of motion have no solution.
    """
    axial = share.T @ B @ share
    size = np.sqrt(np.diag(axial))
    return float(np.linalg.eigvalsh(axial / np.outer(size, size))[0]) if size.min() > 0 else 0.0


def check_extensions(model: Model) -> None:
    """Raise InputError when segments share a name, a place or a mass, hold no link, or a chamber pushes others."""
    if not (names := [e.name for e in model.extensions]):
        return
    if len(set(names)) < len(names):
        raise InputError(f"extensions need names that differ, got {', '.join(names)}")
    share = model.stretch_share
    for s, name in enumerate(names):
        if share[:, s].max() < LEAST_SHARE:
            raise InputError(f"extension {name!r} lies beyond the body, which is {model.length:.6g} m long")
    if (share.sum(axis=1) > 1.0 + 1e-6).any():
        raise InputError(f"extensions must not overlap: {', '.join(names)} do")
    if least_inertia(extensible_inertia(model)[0], share) < SINGULAR:
        raise InputError(
            f"extensions: the masses of {model.n} link(s) cannot follow {len(names)} independent strains "
            f"({', '.join(names)}): use fewer segments, or links enough that each segment moves one of its own"
        )
    for chamber in model.chambers:
        if chamber.axial_gain.size not in (1, len(names)):
            raise InputError(
                f"chamber {chamber.name!r}: axial_gain must be one number or {len(names)} (one for each segment), got "
                f"{chamber.axial_gain.size}"
            )
