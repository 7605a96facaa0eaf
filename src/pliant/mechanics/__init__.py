"""Mechanics of a chain: the interface `Mechanics`, and one class for each family of chains.

Whatever simulates, fits, filters, linearises, controls or exports asks `mechanics_of(model)` for positions, Jacobians,
energies, rests and the records that the compiled kernels take, and works out none of them itself.
"""

from pliant.mechanics.contract import Energy as Energy
from pliant.mechanics.contract import Mechanics as Mechanics
from pliant.mechanics.planar import PlanarChain as PlanarChain
from pliant.mechanics.registry import mechanics_of as mechanics_of
