"""Function that returns the mechanics of a model, in the plane or in space."""

from __future__ import annotations

from pliant.mechanics.contract import Mechanics
from pliant.mechanics.planar import PlanarChain
from pliant.mechanics.spatial import SpatialChain
from pliant.model import Model


def mechanics_of(model: Model) -> Mechanics:
    """Return the `Mechanics` object of a model, planar or spatial, which is created once and then
    kept with the model.
    """
    kept = model.__dict__.get("_mechanics")
    if kept is None:
        kept = model.__dict__["_mechanics"] = SpatialChain(model) if model.space else PlanarChain(model)
    return kept
