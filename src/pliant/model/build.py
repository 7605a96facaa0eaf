"""Function that creates the model of a uniform actuator, divided into links."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from pliant.errors import InputError
from pliant.model.model import FURTHER, KEYWORD_DEFAULTS, Model
from pliant.model.quantity import Quantity
from pliant.options import full_signature


def chain_model(
    *, length: Annotated[float, Quantity("m", "length of the body that bends", fitted=False)],
    mass: Annotated[float, Quantity("kg", "mass of all links together, without the tip mass", lower=1e-9)],
    links: int = 5, joint_placement: str = "base", **parameters: Any,
) -> Model:
    """Return the model of a uniform actuator of `length` [m] and `mass` [kg], divided into `links` rigid links.

    Parameters
    ----------
    joint_placement : {"base", "midsegment"}
        The body is divided into equal segments of length l. Joints are at the base of each segment (the paper), or in
        its middle, which gives a rigid base part of l/2, then links l, ..., l, l/2. Joints in the middle keep EI = K l
        and the first frequency of the continuum within 1 % at five links (base joints: -17 %).
    **parameters
        All other parameters of `Model`: stiffness, damping, torque, ...

    Returns
    -------
    Model

    Raises
    ------
    InputError
        When the numbers are not physical or the placement is unknown.

    Examples
    --------
    >>> import pliant
    >>> model = pliant.chain_model(length=0.17, mass=0.07, links=5, stiffness=1.6, damping=8e-3, torque=[1.5e-6])
    >>> model.n, round(model.length, 3)
    (5, 0.17)
    """
    if links < 1:
        raise InputError(f"a chain needs at least one link, got {links}")
    if not (np.isfinite(length) and np.isfinite(mass)) or length <= 0 or mass <= 0:
        raise InputError(f"length [m] and mass [kg] must be positive, got {length} and {mass}")
    segment = length / links
    link_length = np.full(links, segment)
    if joint_placement == "midsegment":
        link_length[-1] = 0.5 * segment
        parameters["base_length"] = parameters.get("base_length", 0.0) + 0.5 * segment
    elif joint_placement != "base":
        raise InputError(f"joint_placement must be 'base' or 'midsegment', got {joint_placement!r}")
    link_mass = mass / length * link_length
    return Model(link_length=link_length, link_mass=link_mass, **parameters)


chain_model.__signature__ = full_signature(chain_model, FURTHER, KEYWORD_DEFAULTS)  # type: ignore[attr-defined]
