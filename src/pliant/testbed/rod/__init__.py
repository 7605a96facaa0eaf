"""The rod: parameters of a soft bending actuator, its discretisation, and the forces on its nodes."""

from pliant.testbed.rod.body import RodBody, build_body, node_position
from pliant.testbed.rod.parameters import ACTUATORS, CHAMBERS, ChamberParameters, RodParameters, actuator

__all__ = [
    "ACTUATORS",
    "CHAMBERS",
    "ChamberParameters",
    "RodBody",
    "RodParameters",
    "actuator",
    "build_body",
    "node_position",
]
