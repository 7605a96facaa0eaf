"""The virtual actuator stepped in closed loop: a command in, frames of its sensors out."""

from pliant.testbed.plant.plant import Plant, PlantFrame

__all__ = ["Plant", "PlantFrame"]
