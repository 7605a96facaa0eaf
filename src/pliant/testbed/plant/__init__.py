"""The virtual actuator for closed-loop control: `Plant.advance` takes a command and returns a sensor frame."""

from pliant.testbed.plant.plant import Plant, PlantFrame

__all__ = ["Plant", "PlantFrame"]
