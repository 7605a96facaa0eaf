"""The virtual actuator stepped in closed loop: a command in, frames of its sensors out."""

from pliant.testbed.plant.plant import Frame, Plant

__all__ = ["Frame", "Plant"]
