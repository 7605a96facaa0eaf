"""The parts of a model whose fields declare parameters, and the names that a fit gives to these fields."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.model.chamber import Chamber
from pliant.model.extension import Extension
from pliant.model.memory import Memory, payne, springpot
from pliant.model.model import FURTHER, KEYWORD_DEFAULTS, Model
from pliant.model.parameters import ModelParameters, Station
from pliant.model.quantity import Quantity, quantities
from pliant.model.space import Space
from pliant.model.tendon import Tendon
from pliant.model.valve import Valve
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


class ModelPart(NamedTuple):
    """A record whose fields, or a function whose arguments, declare parameters with a `Quantity` each.

    Attributes
    ----------
    record : type or function
    prefix : str
        What the names of a fit have before the name of a field, such as "valve_" in ``valve_rise_time``.
    owner : str
        Kind of the part's owners, whose name may stand before the dot of a parameter of a fit: "chamber", "segment",
        "station", or "" for the parameters of the whole body.
    """

    record: Any
    prefix: str = ""
    owner: str = ""


class Declared(NamedTuple):
    """One declared parameter: its part, the name of its field, and its unit, bounds and meaning."""

    part: ModelPart
    field: str
    quantity: Quantity

    @property
    def name(self) -> str:
        """Name of the parameter in a fit, without owner and number, such as ``valve_rise_time``."""
        return f"{self.part.prefix}{self.field}"


BODY, BUILD = ModelPart(ModelParameters), ModelPart(chain_model)
CHAMBER, TENDON = ModelPart(Chamber, "", "chamber"), ModelPart(Tendon, "", "chamber")
VALVE = ModelPart(Valve, "valve_", "chamber")
MEMORY, SPRINGPOT, PAYNE = ModelPart(Memory), ModelPart(springpot, "fractional_"), ModelPart(payne, "payne_")
SEGMENT, SPACE, STATION = ModelPart(Extension, "axial_", "segment"), ModelPart(Space), ModelPart(Station, "", "station")
PARTS = (BODY, BUILD, CHAMBER, TENDON, VALVE, MEMORY, SPRINGPOT, PAYNE, SEGMENT, SPACE, STATION)


def declared(*parts: ModelPart) -> Iterator[Declared]:
    """Yield the declared parameters of the given parts, or of all parts of a model, each once."""
    for part in parts or PARTS:
        inherited = quantities(Chamber) if part is TENDON else ()
        for field, quantity in quantities(part.record).items():
            if field not in inherited:
                yield Declared(part, field, quantity)


def fitted(*parts: ModelPart) -> dict[str, str]:
    """Return the fields that a fit may change, of the given parts or of all, by their names in a fit."""
    return {d.name: d.field for d in declared(*parts) if d.quantity.fitted}
