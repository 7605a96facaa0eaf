"""Selection of the `Mechanics` class of a model."""

from __future__ import annotations

from pliant.mechanics.contract import Mechanics
from pliant.mechanics.planar import PlanarChain
from pliant.mechanics.spatial import SpatialChain
from pliant.model import Model


def mechanics_of(model: Model) -> Mechanics:
    """Return the mechanics of a model, computed once and then stored with the model."""
    kept = model.__dict__.get("_mechanics")
    if kept is None:
        kept = model.__dict__["_mechanics"] = SpatialChain(model) if model.space else PlanarChain(model)
    return kept
