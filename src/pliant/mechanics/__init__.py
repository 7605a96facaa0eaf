"""Mechanics of a chain of links: one interface, `Mechanics`, with a class for planar chains and one for chains in
space.

Simulation, fits, filters, linearisation, control and exporters get positions, Jacobians, energies, equilibria and the
parameter records of the compiled kernels from `mechanics_of(model)`.
"""

from pliant.errors import InputError
from pliant.mechanics.contract import Mechanics as Mechanics
from pliant.mechanics.planar import PlanarChain as PlanarChain
from pliant.mechanics.records import Energy as Energy
from pliant.mechanics.spatial import SpatialChain as SpatialChain
from pliant.model import Model


def mechanics_of(model: Model) -> Mechanics:
    """Return the `Mechanics` object of a model, planar or spatial, which is created once and then
    kept with the model.
    """
    if not isinstance(model, Model):
        raise InputError(f"expected a Model, got {model!r:.80}: read the file of a model with load_model")
    mechanics = model.__dict__.get("_mechanics")
    if mechanics is None:
        mechanics = model.__dict__["_mechanics"] = SpatialChain(model) if model.space else PlanarChain(model)
    return mechanics
