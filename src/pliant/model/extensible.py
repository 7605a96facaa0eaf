"""The requirements of segments that lengthen on a model, and their effect on its inertia."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from pliant.errors import InputError
from pliant.model.inertia import inertia_constants
from pliant.model.parameters import ModelParameters
from pliant.model.space import require_planar

Array = np.ndarray
Parameters = TypeVar("Parameters", bound=ModelParameters)
SINGULAR = 1e-9  # least_inertia of strains that one mass carries, but for rounding
LEAST_SHARE = 1e-3  # of a link's length: a segment that holds less of every link holds none


def joints_inside(model: ModelParameters) -> tuple[tuple[int, ...], ...]:
    """Joints that lie in each segment, from 0."""
    place = model.base_length + np.cumsum(model.link_length) - model.link_length
    slack = 1e-9 * model.length
    return tuple(
        tuple(np.flatnonzero((place > e.start - slack) & (place < e.end(model.length) - slack)).tolist())
        for e in model.extensions
    )


def fixed_length(model: Parameters, refusal: str = "") -> Parameters:
    """The model, when it is in a plane and nothing lengthens: who cannot follow a length that changes asks here.

    Raises
    ------
    InputError
        When the model moves in space, or segments lengthen, in the words of `refusal`, if any.
    """
    require_planar(model, "this")
    if names := ", ".join(e.name for e in model.extensions):
        raise InputError(
            refusal or f"this takes a body of fixed length, and {model.name!r} lengthens ({names}): use simulate, "
            "Stepper, fit, linearise, design_outputs, estimate or find_contact, or leave its extensions out"
        )
    return model


def extensible_inertia(model: ModelParameters) -> tuple[Array, Array]:
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


def check_extensions(model: ModelParameters) -> None:
    """Raise InputError when segments share a name, a place or a mass, hold no link, or a chamber pushes others."""
    check_laws(model)
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


def check_laws(model: ModelParameters) -> None:
    """Raise InputError where hysteresis or curved springs of segments have no segment, or one in space."""
    if model.memory.has_axial and len(model.extensions) == 0:
        raise InputError(
            f"memory axial_*: {model.name!r} has no segment that lengthens: leave these branches out, or give it "
            "extensions"
        )
    if model.memory.has_axial and model.space:
        raise InputError(
            f"memory axial_*: {model.name!r} is in space, where segments have no hysteresis: leave these branches out"
        )
    if model.space and (curved := [e.name for e in model.extensions if e.curved]):
        raise InputError(
            f"extension {curved[0]!r} softens or stiffens, which is for a body in a plane: leave out its stiffening "
            "and cubic_stiffening"
        )
