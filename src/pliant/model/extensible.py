"""Checks of the extensible segments of a model, and the inertia of a model with such segments."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from pliant.errors import InputError
from pliant.model.checks import check_names
from pliant.model.inertia import inertia_constants
from pliant.model.parameters import ModelParameters
from pliant.model.space import require_planar

Array = np.ndarray
Parameters = TypeVar("Parameters", bound=ModelParameters)
SINGULAR = 1e-9  # `least_inertia` below this means that strains share one mass
LEAST_SHARE = 1e-3  # a segment with less than this fraction of every link contains no link


def joints_inside(model: ModelParameters) -> tuple[tuple[int, ...], ...]:
    """Return, for each extensible segment, the indices (from 0) of the joints that lie in it."""
    position = model.base_length + np.cumsum(model.link_length) - model.link_length
    slack = 1e-9 * model.length
    return tuple(
        tuple(np.flatnonzero((position > e.start - slack) & (position < e.end(model.length) - slack)).tolist())
        for e in model.extensions
    )


def tied_joints(model: ModelParameters) -> Array:
    """Return a matrix (n, S) that is 1 where the strain of an extensible segment changes the bending stiffness of a
    joint inside it, else 0.
    """
    tied = np.zeros((model.n, len(model.extensions)))
    for s, (extension, joints) in enumerate(zip(model.extensions, joints_inside(model), strict=True)):
        tied[list(joints), s] = float(extension.stiffens_bending)
    return tied


def fixed_length(model: Parameters, refusal: str = "") -> Parameters:
    """Return the model unchanged if it is planar and has no extensible segments, else raise InputError.

    Raises
    ------
    InputError
        When the model is in space or has segments that lengthen. `refusal` replaces the message for the latter.
    """
    require_planar(model, "this function")
    if names := ", ".join(e.name for e in model.extensions):
        raise InputError(
            refusal or f"this function needs a body of fixed length, but {model.name!r} lengthens ({names}): use "
            "simulate, Stepper, fit, linearise, design_outputs, estimate or find_contact, or remove its extensions"
        )
    return model


def extensible_inertia(model: ModelParameters) -> tuple[Array, Array]:
    """Return the inertia constants of an extensible planar chain of n links: coupling matrix B (n + 1, n + 1) [kg m^2]
    and first moments h (n + 1,) [kg m]. Index 0 is the part before the first joint.

    They are the fields of `symbols.ExtensibleBody`.

    The rotary inertia of the links is on the diagonal of B, but not that of the payload, which does not lengthen.
    """
    length, mass = np.append(model.base_length, model.link_length), np.append(0.0, model.link_mass)
    B, rotary, h = inertia_constants(length, mass, model.tip_mass, rod=model.mass_at == "rod")
    B[np.diag_indices(model.n + 1)] += rotary
    return B, h


def least_inertia(B: Array, share: Array) -> float:
    """Return the smallest eigenvalue of the inertia matrix of the segments' strains, normalised to 1 on its diagonal.
    At 0, some combination of strains moves no mass.

    The equations of motion then have no solution. `share` is the fraction of each link that lies in each segment.
    """
    axial = share.T @ B @ share
    size = np.sqrt(np.diag(axial))
    return float(np.linalg.eigvalsh(axial / np.outer(size, size))[0]) if size.min() > 0 else 0.0


def check_extensions(model: ModelParameters) -> None:
    """Raise InputError if extensible segments of a model overlap, share a name, lie beyond the body, or cannot move
    independently of each other, or if the axial gains of a chamber do not match their number.
    """
    check_laws(model)
    if not (names := [e.name for e in model.extensions]):
        return
    check_names("extensions", names)
    share = model.stretch_share
    for s, name in enumerate(names):
        if share[:, s].max() < LEAST_SHARE:
            raise InputError(
                f"extension {name!r} lies beyond the body, which is {model.length:.6g} m long: change its start or stop"
            )
    if (share.sum(axis=1) > 1.0 + 1e-6).any():
        raise InputError(f"extensions must not overlap, but {', '.join(names)} do: change their start or stop")
    if least_inertia(extensible_inertia(model)[0], share) < SINGULAR:
        raise InputError(
            f"extensions: the masses of {model.n} link(s) cannot follow {len(names)} independent strains "
            f"({', '.join(names)}): use fewer segments, or more links, so that each segment moves a mass of its own"
        )
    for chamber in model.chambers:
        if chamber.axial_gain.size not in (1, len(names)):
            raise InputError(
                f"chamber {chamber.name!r}: axial_gain must be one number or {len(names)} (one for each segment), got "
                f"{chamber.axial_gain.size}"
            )


def check_laws(model: ModelParameters) -> None:
    """Raise InputError for axial hysteresis in a model without extensible segments, and for a segment of a planar model
    whose strain changes the bending stiffness.
    """
    if model.memory.has_axial and len(model.extensions) == 0:
        raise InputError(
            f"memory axial_*: {model.name!r} has no segment that lengthens: leave these branches out, or give it "
            "extensions"
        )
    if not model.space and (tied := [e.name for e in model.extensions if e.stiffens_bending]):
        raise InputError(
            f"extension {tied[0]!r} of {model.name!r} has stiffens_bending, which a planar model does not support: "
            "leave it out, or make the model spatial with space = Space()"
        )
