"""The reduced-order model of a soft actuator: its parameters, observed points and model file."""

from typing import TYPE_CHECKING, Any

from pliant.model.actuation import Actuation
from pliant.model.actuation_input import ActuationInput
from pliant.model.chamber import Chamber
from pliant.model.extensible import fixed_length
from pliant.model.extension import Extension
from pliant.model.memory import Memory, payne, springpot
from pliant.model.model import Model
from pliant.model.parameters import Station
from pliant.model.parts import chain_model
from pliant.model.space import Space
from pliant.model.tendon import Tendon
from pliant.model.valve import Valve

if TYPE_CHECKING:
    from pliant.model.file import load_model, save_model

__all__ = [
    "Actuation", "ActuationInput", "Chamber", "Extension", "Memory", "Model", "Space", "Station", "Tendon", "Valve",
    "chain_model", "fixed_length", "load_model", "payne", "save_model", "springpot",
]


def __getattr__(name: str) -> Any:
    """Import `load_model` and `save_model` on first use, because their validation library is slow to import."""
    if name in ("load_model", "save_model"):
        from pliant.model import file

        return getattr(file, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
