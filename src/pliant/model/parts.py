"""The parts of a model whose fields declare parameters, and the names that a fit gives to these fields."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from pliant.model.build import chain_model
from pliant.model.chamber import Chamber
from pliant.model.extension import Extension
from pliant.model.memory import Memory, payne, springpot
from pliant.model.parameters import ModelParameters
from pliant.model.quantity import Quantity, quantities
from pliant.model.space import Space
from pliant.model.station import Station
from pliant.model.tendon import Tendon
from pliant.model.valve import Valve


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
