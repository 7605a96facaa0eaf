"""A virtual camera that films the virtual actuator and returns the true motion with the film."""

from pliant.testbed.camera.film import Filmed, Scene, Shutter, film, film_motion
from pliant.testbed.camera.scene import Look, View

__all__ = ["Filmed", "Look", "Scene", "Shutter", "View", "film", "film_motion"]
