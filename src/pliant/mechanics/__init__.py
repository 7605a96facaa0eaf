"""Mechanics of a chain of links: one interface, `Mechanics`, with a class for planar chains and one for chains in
space.

Simulation, fits, filters, linearisation, control and exporters get positions, Jacobians, energies, equilibria and the
parameter records of the compiled kernels from `mechanics_of(model)`.
"""

from pliant.mechanics.contract import Energy as Energy
from pliant.mechanics.contract import Mechanics as Mechanics
from pliant.mechanics.planar import PlanarChain as PlanarChain
from pliant.mechanics.registry import mechanics_of as mechanics_of
