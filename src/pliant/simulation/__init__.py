"""Simulation of a model under pressure inputs: whole motions, reference simulations, and single time steps."""

from pliant.simulation.base_file import read_base
from pliant.simulation.base_motion import BaseMotion
from pliant.simulation.forces import PointForce
from pliant.simulation.inputs import Chirp, Input, Pulse, Step, Trace, ramp, triangle
from pliant.simulation.solve import simulate
from pliant.simulation.state import equilibrium, modes
from pliant.simulation.stepper import Stepper

__all__ = [
    "BaseMotion", "Chirp", "Input", "PointForce", "Pulse", "Step", "Stepper", "Trace", "equilibrium",
    "modes", "ramp", "read_base", "simulate", "triangle",
]
