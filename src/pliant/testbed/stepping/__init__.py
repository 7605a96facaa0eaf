"""The time loop: implicit steps of the rod under pressure, tip loads and contact."""

from pliant.testbed.stepping.simulate import RodMotion, settle, simulate

__all__ = ["RodMotion", "settle", "simulate"]
