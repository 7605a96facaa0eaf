"""The rod model of a soft bending actuator: parameters, discretisation and nodal forces."""

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
